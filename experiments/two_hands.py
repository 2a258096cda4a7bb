"""Two hands, measured: a box between them; the transparency of leader and follower.

*Box*: ``two_hands`` behind 10 ms each way, without a law and with one. *Transparency*: in
``leader_follower`` and ``leader_follower_transfer`` a shaker in place of the leader's hand moves it
from 1 to 30 Hz, the follower holds a spring of 1 N/mm and a damper of 2 N s/m, and the force of the
leader's motor over its displacement is the dynamic stiffness that is felt, with its phase. All runs
are in virtual time: the same command gives the same figures.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from matplotlib.figure import Figure

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.haptics.hands.hands import ChirpHand, PressingHand
from forcebound.lab.engine import Campaign, Row, run_here
from forcebound.lab.views import groups, table
from forcebound.results.spectrum import displayed_impedance
from forcebound.run.virtual import run_virtual_hands

PLAIN, TRANSFER = "leader_follower", "leader_follower_transfer"
LAWS = {  # of a panel: launch file and law
    "none": (PLAIN, "none"),
    "certified": (PLAIN, "certified"),
    "certified, transfer": (TRANSFER, "certified"),
}
DELAYS = (0, 1, 2, 5, 10)  # ms, each way
AMPLITUDE = 0.003  # m, of the shaker
HELD = PressingHand(mass=0.0, stiffness=1000.0, damping=2.0, start=0.0, end=0.0)  # by the follower
SHOWN = (2.0, 5.0, 10.0, 20.0)  # Hz, in the table
FELT = ("frequency", "stiffness", "phase")  # columns of a row of the campaign
HIGHEST, SWEEP_TIME = 30.0, 12.0  # Hz, s
SHAKES = 2.0  # s, of the box's run


class Task(NamedTuple):
    """One run."""

    label: str
    delay: int  # ms

    def config(self) -> GraphConfig:
        """Return the graph."""
        file, law = LAWS[self.label]
        return load(file, [f"law:={law}", f"delay:={self.delay} ms"])


def shake(tasks: Sequence[Task]) -> list[Row]:
    """Return of each task the frequencies, in Hz, with the dynamic stiffness felt, in N/m, deg."""
    return [task._asdict() | dict(zip(FELT, _felt(task), strict=True)) for task in tasks]


def _felt(task: Task) -> tuple[list[float], ...]:
    config = task.config()
    shaker = ChirpHand(centre=0.0, amplitude=AMPLITUDE, highest=HIGHEST, sweep_time=SWEEP_TIME)
    leader = replace(config.hands["leader"], operator=shaker)
    follower = replace(config.hands["follower"], operator=HELD)
    config = replace(config, hands={"leader": leader, "follower": follower})
    run = run_virtual_hands(config, SWEEP_TIME)["leader"].columns
    felt = displayed_impedance(run.applied_force[:, 0], run.true_position[:, 0], 1000.0)
    if felt is None:
        return [], [], []
    complete = felt.stiffness + 2j * np.pi * felt.frequency * felt.damping
    values = np.array([felt.frequency, abs(complete), np.angle(complete, deg=True)])
    return tuple(values[:, felt.frequency <= HIGHEST].tolist())


def ideal(frequency: Any) -> Any:
    """Return the dynamic stiffness of coupling and held spring in series, in N/m."""
    omega = 2j * np.pi * frequency
    coupled = 1000.0 + 4.0 * omega
    held = HELD.stiffness + (HELD.damping + 0.27) * omega + 0.075 * omega**2
    return coupled * held / (coupled + held)


def transparency(workers: int | None) -> Figure:
    """Draw and print the stiffness that is felt by frequency, over delay, for each law."""
    tasks = [Task(label, delay) for label in LAWS for delay in DELAYS]
    rows = run_here(Campaign("transparency", tasks, shake, part=1), workers).rows
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    panels = figure.subplots(2, len(LAWS), sharex=True, sharey="row")
    line = np.geomspace(1.0, HIGHEST, 100)
    for (upper, lower), label in zip(panels.T, LAWS, strict=True):
        for row in groups(rows, "label")[label,]:
            hz, stiffness, phase = np.array([row[name] for name in FELT])
            upper.loglog(hz, stiffness * 1e-3, marker=".", label=f"{row['delay']} ms")
            lower.semilogx(hz, phase, marker=".")
        upper.loglog(line, abs(ideal(line)) * 1e-3, "k:", label="linear, no delay")
        lower.semilogx(line, np.angle(ideal(line), deg=True), "k:")
        lower.axhspan(-180.0, 0.0, color="tab:red", alpha=0.08)
        upper.set(title=label)
        upper.set_yticks((0.2, 0.5, 1.0))
        lower.set_xticks((1.0, 2.0, 5.0, 10.0, 20.0))
        for scale in (upper.yaxis, lower.xaxis):
            scale.set_major_formatter("{x:g}")
            scale.set_minor_formatter("")
        lower.set(xlabel="frequency (Hz)", ylim=(-180.0, 180.0))
        for panel in (upper, lower):
            panel.grid(alpha=0.3, which="both")
    panels[0, 0].set_ylabel("stiffness felt (N/mm)")
    panels[1, 0].set_ylabel("its phase (degrees)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, title="delay, each way", loc="outside right center")
    heads = ("law", "delay", *(f"{at:g} Hz" for at in SHOWN))
    cells = [
        (row["label"], f"{row['delay']} ms", *(_near(row, at) for at in SHOWN)) for row in rows
    ]
    click.echo("\n".join(table(heads, cells)))
    return figure


def _near(row: Row, at: float) -> str:
    """Return the stiffness, in N/mm, and its phase at the frequency nearest to one in Hz."""
    felt = min(
        zip(*(row[name] for name in FELT), strict=True),
        key=lambda one: abs(one[0] - at),
        default=None,
    )
    if felt is None or abs(felt[0] - at) >= 0.1 * at:
        return "–"
    return f"{felt[1] * 1e-3:.2f}, {felt[2]:.0f}°"


def box(_: int | None) -> Figure:
    """Draw two hands at a box that is 10 ms away, without a law and with the certified one."""
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey="row")
    for (upper, lower), law in zip(panels.T, ("none", "certified"), strict=True):
        results = run_virtual_hands(load("two_hands", [f"law:={law}", "delay:=10 ms"]), SHAKES)
        for hand, colour in (("left", "tab:blue"), ("right", "tab:orange")):
            run = results[hand].columns
            upper.plot(run.time, run.true_position[:, 0] * 1e3, colour, label=f"{hand} hand")
            side = f"{hand} side of the box"
            upper.plot(run.time, run.proxy[:, 0] * 1e3, colour, alpha=0.4, lw=3.0, label=side)
            lower.plot(run.time, run.applied_force[:, 0], colour, label=hand)
        upper.set(title=law)
        lower.set(xlabel="time (s)")
        for panel in (upper, lower):
            panel.grid(alpha=0.3)
    panels[0, 0].set_ylabel("position (mm)")
    panels[1, 0].set_ylabel("force of the motor (N)")
    panels[0, 1].legend(fontsize="small")
    return figure


FIGURES = {  # with the picture of each
    "transparency": (transparency, "docs/transparency_two_hands.png"),
    "box": (box, "docs/gallery/two_hands.png"),
}


@click.command()
@click.argument("figure", type=click.Choice(list(FIGURES)))
@click.option("--out", type=click.Path(path_type=Path), help="Default: the picture in docs/.")
@click.option("--workers", type=int, help="Processes; default: one per core.")
def main(figure: str, out: Path | None, workers: int | None) -> None:
    """Draw leader and follower, or a box between two hands."""
    draw, picture = FIGURES[figure]
    out = out or Path(picture)
    if not out.parent.is_dir():
        raise click.UsageError(f"no folder {out.parent}: run it in the clone, or give --out")
    draw(workers).savefig(out, dpi=100)
