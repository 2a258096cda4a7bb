"""Leader and follower, measured: transparency by frequency, and the stiffest coupling that is stable.

Usage: python -m experiments.two_hands transparency [--out docs/transparency_two_hands.png]
       python -m experiments.two_hands stability [--out docs/stability_two_hands.png]

Both use the launch files ``leader_follower`` and ``leader_follower_transfer`` in virtual time, with
a wall of 1 N/mm at the follower; the same command gives the same figures. *Transparency*: a shaker
in place of the leader's hand moves it from 1 to 30 Hz while the follower stays in its wall, and the
force of the leader's motor over its way is the stiffness that is felt. *Stability*: a hand pushes
the follower into its wall; stable means that both are at rest at the end. The largest stiffness of
the coupling is searched for by bisection, so that instability between stable ones is not seen.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.haptics.hands.hands import ChirpHand
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
LATE = (0, 2, 5, 10, 20)  # ms, each way
CENTRE, AMPLITUDE = 0.006, 0.0015  # m, of the shaker
SWEEP_TIME = 12.0  # s
SECONDS = 4.0  # s, of a run that shall come to rest
SOFTEST, STIFFEST = 0.05, 20.0  # N/mm, of the coupling
STEPS = 6  # of the bisection: 10 %


class Task(NamedTuple):
    """One run, or one search."""

    label: str
    delay: int  # ms

    def config(self, *arguments: str) -> GraphConfig:
        """Return the graph."""
        file, law = LAWS[self.label]
        return load(file, [f"law:={law}", f"delay:={self.delay} ms", *arguments])


def shake(task: Task) -> tuple[list[float], list[float]]:
    """Return frequencies, in Hz, and the size of the dynamic stiffness felt there, in N/m."""
    config = task.config("gap:=0 mm")
    shaker = ChirpHand(centre=CENTRE, amplitude=AMPLITUDE, highest=30.0, sweep_time=SWEEP_TIME)
    leader = replace(config.hands["leader"], operator=shaker)
    config = replace(config, hands={**config.hands, "leader": leader})
    run = run_virtual_hands(config, SWEEP_TIME)["leader"].columns
    late = run.time > 1.0  # after the follower has gone to where it belongs
    felt = displayed_impedance(run.applied_force[late, 0], run.true_position[late, 0], 1000.0)
    if felt is None:
        return [], []
    size = np.hypot(felt.stiffness, 2.0 * np.pi * felt.frequency * felt.damping)
    return felt.frequency.tolist(), size.tolist()


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


def transparency(workers: int | None) -> Figure:
    """Draw and print the stiffness that is felt by frequency, over delay, for each law."""
    tasks = [Task(label, delay) for label in SHAKEN for delay in DELAYS]
    found = do_all(shake, tasks, workers)
    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    panels = figure.subplots(1, len(SHAKEN), sharex=True, sharey=True)
    for panel, label in zip(panels, SHAKEN, strict=True):
        for delay in DELAYS:
            frequency, size = found[Task(label, delay)]
            panel.loglog(frequency, np.array(size) * 1e-3, marker=".", label=f"{delay} ms")
        panel.axhline(1.0, color="0.5", linewidth=0.8)
        panel.axhline(0.5, color="0.5", linewidth=0.8, linestyle="--")
        panel.set(title=label, xlabel="frequency (Hz)")
        panel.grid(alpha=0.3, which="both")
    panels[0].set_ylabel("stiffness felt (N/mm)")
    panels[0].legend(title="delay, each way", fontsize="small")
    rows = []
    for task, (frequency, size) in found.items():
        near = [
            f"{np.interp(hz, frequency, size) * 1e-3:.2f}" if frequency else "-"
            for hz in (2.0, 5.0, 10.0, 20.0)
        ]
        rows.append((task.label, f"{task.delay} ms", *near))
    print(*table(("law", "delay", "2 Hz", "5 Hz", "10 Hz", "20 Hz"), rows), sep="\n")
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
    print(*table((*head, "error at 1 N/mm, mm RMS", "least energy there, mJ"), rows), sep="\n")
    return figure


FIGURES = {"transparency": transparency, "stability": stability}


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
