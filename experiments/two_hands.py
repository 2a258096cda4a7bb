"""Two hands, measured: a box between them; leader and follower: transparency and stability.

Usage: python -m experiments.two_hands transparency [--out docs/transparency_two_hands.png]
       python -m experiments.two_hands stability [--out docs/stability_two_hands.png]
       python -m experiments.two_hands box [--out docs/gallery/two_hands.png]

*Box*: ``two_hands`` behind 10 ms each way, without a law and with one. The others use the launch
files ``leader_follower`` and ``leader_follower_transfer``. *Transparency*: a shaker in place of the
leader's hand moves it from 1 to 30 Hz, the follower holds a spring of 1 N/mm and a damper of 2
N s/m, and the force of the leader's motor over its way is the dynamic stiffness that is felt, with
its phase. *Stability*: a hand pushes the follower into its wall of 1 N/mm; stable means that both
are at rest at the end. The largest stiffness of the coupling is searched for by bisection, so that
instability between stable ones is not seen. All runs are in virtual time: the same command gives
the same figures.
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
from forcebound.lab.workers import completed, local_executor, progress_bar
from forcebound.results.contact import REST_SPEED, final_speed
from forcebound.results.coupling import coupling
from forcebound.results.spectrum import displayed_impedance
from forcebound.run.results import RunResult
from forcebound.run.virtual import run_virtual_hands

PLAIN, TRANSFER = "leader_follower", "leader_follower_transfer"
LAWS = {  # of a panel or curve: launch file and law
    "none": (PLAIN, "none"),
    "tdpa": (PLAIN, "tdpa"),
    "tdpa, transfer": (TRANSFER, "tdpa"),
    "certified": (PLAIN, "certified"),
    "certified, transfer": (TRANSFER, "certified"),
}
SHAKEN = ("none", "certified", "certified, transfer")
DELAYS = (0, 1, 2, 5, 10)  # ms, each way
LATE = (0, 5, 10)  # ms, each way
AMPLITUDE = 0.003  # m, of the shaker
HELD = PressingHand(mass=0.0, stiffness=1000.0, damping=2.0, start=0.0, end=0.0)  # by the follower
SHOWN = (2.0, 5.0, 10.0, 20.0)  # Hz, in the table
HIGHEST, SWEEP_TIME = 30.0, 12.0  # Hz, s
SHAKES = 2.0  # s, of the box's run
SECONDS = 2.0  # s, of a run that shall come to rest
SOFTEST, STIFFEST = 0.1, 10.0  # N/mm, of the coupling
STEPS = 4  # of the bisection: 33 %


class Task(NamedTuple):
    """One run, or one search."""

    label: str
    delay: int  # ms

    def config(self, *arguments: str) -> GraphConfig:
        """Return the graph."""
        file, law = LAWS[self.label]
        return load(file, [f"law:={law}", f"delay:={self.delay} ms", *arguments])


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


def push(task: Task, stiffness: float) -> tuple[bool, dict[str, Any]]:
    """Return whether both are at rest at the end with a coupling so stiff, in N/mm; figures."""
    results = run_virtual_hands(task.config(f"stiffness:={stiffness} N/mm"), SECONDS)
    columns = {hand: one.columns for hand, one in results.items()}
    documents = {hand: one.document for hand, one in results.items()}
    rests = all(_rests(one) for one in results.values())
    return rests, coupling(columns, documents)


def _rests(run: RunResult) -> bool:
    speed = final_speed(run.columns.time, run.columns.true_position)
    return speed is not None and speed < REST_SPEED


def search(task: Task) -> tuple[float, dict[str, Any], dict[str, Any]]:
    """Return the stiffest stable coupling, in N/mm; its figures, and those of 1 N/mm.

    0 if not even the softest one is stable.
    """
    _, usual = push(task, 1.0)
    stable, found = push(task, STIFFEST)
    if stable:
        return STIFFEST, found, usual
    low, high = SOFTEST, STIFFEST
    stable, found = push(task, low)
    if not stable:
        return 0.0, found, usual
    for _ in range(STEPS):
        middle = float((low * high) ** 0.5)
        stable, figures = push(task, middle)
        if stable:
            low, found = middle, figures
        else:
            high = middle
    return low, found, usual


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
    tasks = [Task(label, delay) for label in SHAKEN for delay in DELAYS]
    found = do_all(shake, tasks, workers)
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    panels = figure.subplots(2, len(SHAKEN), sharex=True, sharey="row")
    hz = np.geomspace(1.0, HIGHEST, 100)
    for (upper, lower), label in zip(panels.T, SHAKEN, strict=True):
        for delay in DELAYS:
            frequency, felt = found[Task(label, delay)]
            frequency, felt = (one[frequency <= HIGHEST] for one in (frequency, felt))
            upper.loglog(frequency, abs(felt) * 1e-3, marker=".", label=f"{delay} ms")
            lower.semilogx(frequency, np.angle(felt, deg=True), marker=".")
        upper.loglog(hz, abs(ideal(hz)) * 1e-3, "k:", label="linear, no delay")
        lower.semilogx(hz, np.angle(ideal(hz), deg=True), "k:")
        lower.axhspan(-180.0, 0.0, color="tab:red", alpha=0.08)
        upper.set(title=label)
        lower.set(xlabel="frequency (Hz)", ylim=(-180.0, 180.0))
        for panel in (upper, lower):
            panel.grid(alpha=0.3, which="both")
    panels[0, 0].set_ylabel("stiffness felt (N/mm)")
    panels[1, 0].set_ylabel("its phase (degrees)")
    panels[0, 0].legend(title="delay, each way", fontsize="small")
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


def stability(workers: int | None) -> Figure:
    """Draw and print the stiffest stable coupling over delay, for each law."""
    tasks = [Task(label, delay) for label in LAWS for delay in LATE]
    found = do_all(search, tasks, workers)
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for label in LAWS:
        own = [found[Task(label, delay)] for delay in LATE]
        left.semilogy(LATE, [stiffness or np.nan for stiffness, _, _ in own], ".-", label=label)
        felt = [
            np.nan if at is None else at * 1e-3
            for at in (usual["transmitted_stiffness_n_per_m"] for _, _, usual in own)
        ]
        right.plot(LATE, felt, ".-", label=label)
    left.set(title="stiffest stable coupling", xlabel="delay, each way (ms)", ylabel="N/mm")
    right.axhline(0.5, color="0.5", linewidth=0.8, linestyle="--")
    right.set(title="felt with a coupling of 1 N/mm", xlabel="delay, each way (ms)", ylabel="N/mm")
    right.legend(fontsize="small")
    for panel in (left, right):
        panel.grid(alpha=0.3)
    rows = []
    for task, (stiffness, there, usual) in found.items():
        limit = f"{'>= ' if stiffness == STIFFEST else ''}{stiffness:.2g}"
        error = usual["position_error_rms_m"]
        felt_there, felt_usual = (
            "-" if one is None else f"{one * 1e-3:.2f}"
            for one in (of["transmitted_stiffness_n_per_m"] for of in (there, usual))
        )
        lowest = f"{usual['energy_min_j'] * 1e3:.2g}"
        cells = (limit, felt_there, felt_usual, f"{error * 1e3:.1f}", lowest)
        rows.append((task.label, f"{task.delay} ms", *cells))
    head = ("law", "delay", "stable, N/mm", "felt there, N/mm", "felt at 1 N/mm, N/mm")
    show(table((*head, "error at 1 N/mm, mm RMS", "least energy there, mJ"), rows))
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


FIGURES = {"transparency": transparency, "stability": stability, "box": box}


def main() -> None:
    """Make one of the figures."""
    parser = argparse.ArgumentParser(description="Leader and follower, measured.")
    parser.add_argument("figure", choices=FIGURES)
    parser.add_argument("--out", type=Path, help="default: docs/FIGURE_two_hands.png")
    parser.add_argument("--workers", type=int, help="processes; default: one per core")
    options = parser.parse_args()
    out = options.out or Path(f"docs/{options.figure}_two_hands.png")
    FIGURES[options.figure](options.workers).savefig(out, dpi=100)


if __name__ == "__main__":
    main()
