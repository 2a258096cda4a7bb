"""Two hands, measured: a box between them; the transparency of leader and follower.

Usage: python -m experiments.two_hands transparency [--out docs/transparency_two_hands.png]
       python -m experiments.two_hands box [--out docs/gallery/two_hands.png]

*Box*: ``two_hands`` behind 10 ms each way, without a law and with one. *Transparency*: in
``leader_follower`` and ``leader_follower_transfer`` a shaker in place of the leader's hand moves it
from 1 to 30 Hz, the follower holds a spring of 1 N/mm and a damper of 2 N s/m, and the force of the
leader's motor over its displacement is the dynamic stiffness that is felt, with its phase. All runs
are in virtual time: the same command gives the same figures.
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.haptics.hands.hands import ChirpHand, PressingHand
from forcebound.lab.views import table
from forcebound.lab.workers import completed, local_executor
from forcebound.results.spectrum import displayed_impedance
from forcebound.run.progress import progress_bar
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


def shake(task: Task) -> tuple[Any, Any]:
    """Return frequencies, in Hz, and the complex dynamic stiffness felt there, in N/m."""
    config = task.config()
    shaker = ChirpHand(centre=0.0, amplitude=AMPLITUDE, highest=HIGHEST, sweep_time=SWEEP_TIME)
    leader = replace(config.hands["leader"], operator=shaker)
    follower = replace(config.hands["follower"], operator=HELD)
    config = replace(config, hands={"leader": leader, "follower": follower})
    run = run_virtual_hands(config, SWEEP_TIME)["leader"].columns
    felt = displayed_impedance(run.applied_force[:, 0], run.true_position[:, 0], 1000.0)
    if felt is None:
        return np.array([]), np.array([])
    return felt.frequency, felt.stiffness + 2j * np.pi * felt.frequency * felt.damping


def do_all(work: Any, tasks: Sequence[Task], workers: int | None) -> dict[Task, Any]:
    """Return the result of each task."""
    found: dict[Task, Any] = {}
    with local_executor(workers) as executor, progress_bar("runs") as show:
        for index, result in completed(executor, work, tasks):
            found[tasks[index]] = result
            show(len(found), len(tasks))
    return {task: found[task] for task in tasks}


def show(lines: Iterable[str]) -> None:
    """Print lines."""
    sys.stdout.write("\n".join(lines) + "\n")


def ideal(frequency: Any) -> Any:
    """Return the dynamic stiffness of coupling and held spring in series, in N/m."""
    omega = 2j * np.pi * frequency
    coupled = 1000.0 + 4.0 * omega
    held = HELD.stiffness + (HELD.damping + 0.27) * omega + 0.075 * omega**2
    return coupled * held / (coupled + held)


def transparency(workers: int | None) -> Figure:
    """Draw and print the stiffness that is felt by frequency, over delay, for each law."""
    tasks = [Task(label, delay) for label in LAWS for delay in DELAYS]
    found = do_all(shake, tasks, workers)
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    panels = figure.subplots(2, len(LAWS), sharex=True, sharey="row")
    hz = np.geomspace(1.0, HIGHEST, 100)
    for (upper, lower), label in zip(panels.T, LAWS, strict=True):
        for delay in DELAYS:
            frequency, felt = found[Task(label, delay)]
            frequency, felt = (one[frequency <= HIGHEST] for one in (frequency, felt))
            upper.loglog(frequency, abs(felt) * 1e-3, marker=".", label=f"{delay} ms")
            lower.semilogx(frequency, np.angle(felt, deg=True), marker=".")
        upper.loglog(hz, abs(ideal(hz)) * 1e-3, "k:", label="linear, no delay")
        lower.semilogx(hz, np.angle(ideal(hz), deg=True), "k:")
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
    rows = []
    for task, (frequency, felt) in found.items():
        near = [int(np.argmin(abs(frequency - at))) for at in SHOWN] if len(frequency) else []
        cells = [
            f"{abs(felt[i]) * 1e-3:.2f}, {np.angle(felt[i], deg=True):.0f}°"
            if abs(frequency[i] - at) < 0.1 * at
            else "–"
            for i, at in zip(near, SHOWN, strict=True)
        ]
        rows.append((task.label, f"{task.delay} ms", *(cells or ["–"] * len(SHOWN))))
    show(table(("law", "delay", *(f"{at:g} Hz" for at in SHOWN)), rows))
    return figure


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


def main() -> None:
    """Make one of the figures."""
    parser = argparse.ArgumentParser(description="Leader and follower, measured.")
    parser.add_argument("figure", choices=FIGURES)
    parser.add_argument("--out", type=Path, help="default: the picture in docs/")
    parser.add_argument("--workers", type=int, help="processes; default: one per core")
    options = parser.parse_args()
    draw, picture = FIGURES[options.figure]
    out = options.out or Path(picture)
    if not out.parent.is_dir():
        parser.error(f"there is no folder {out.parent}: run it in the clone, or give --out")
    draw(options.workers).savefig(out, dpi=100)


if __name__ == "__main__":
    main()
