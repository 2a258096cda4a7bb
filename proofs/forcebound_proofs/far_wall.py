"""Stiffness of a wall that is far away: controllers against each other, and where that ends.

Usage: python -m forcebound_proofs.far_wall [--limits] [--plot docs/far_wall.png]

The walls are the best case of ``local_model``: flat, they stand still, and the second press finds a
wall that was touched before. ``--limits`` prints only what bumps and moving bodies do to it.

The hand of `stiff_wall` presses into its wall of 10 N/mm, in virtual time; and a hand that touches
it, lets go, and presses again from 1 s on. *stiffness*, *energy* and *bounces* are those of the
whole run, and of the second press alone for the second hand: so what was learned at the first
touch is known. *first* is the deepest point of the first contact. The energy is the least that the
hand has put in since the start (ground truth). The third table has the second press with other
powers of the local model. The last table, ``--limits``, compares the commanded force with the one
that the same world gives at the hand at once: RMS of the difference, and correlation.
"""

import argparse
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.haptics.controllers.local_model import LocalModel
from forcebound.haptics.environments.solid import Shape, Solid
from forcebound.haptics.hands.hands import StrokingHand
from forcebound.haptics.hands.paths import TrajectoryHand
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.contact import count_bounces
from forcebound.results.samples import Samples
from forcebound.run.virtual import run_virtual

LAWS = ("certified", "certified_fading")
DELAYS = (20, 50)  # ms, each way
SURFACE = 0.010  # m
AGAIN = 1.0  # s, beginning of the second press
DURATION = 2.5  # s; the stiffness is taken over the last 40 %
TOUCH_AND_PRESS = """time,x
0,-0.010
0.12,0.014
0.5,0.014
0.62,-0.010
1.0,-0.010
1.12,0.014
"""
# Name -> controller; None: direct.
CONTESTANTS: Mapping[str, LocalModel | None] = {
    "direct": None,
    "zero-order hold": LocalModel(prediction="hold", ahead=0.0),
    "phase-compensated hold": LocalModel(prediction="hold"),
    "local model that does not look ahead": LocalModel(ahead=0.0),
    "local_model": LocalModel(),
}
DRAWN = ("direct", "local_model")
POWERS = (0.0, 0.005, 0.02, 0.05)  # W
#: Scenes of ``--limits``: launch files, and a wall of ridges at distances in mm.
SCENES = ("touch_sphere", *(f"ridges {n}" for n in (40, 10, 4, 2)), "touch_mesh", "push_mass")
RIDGE = 4e-4  # m, from the valleys to the ridges


class Figures(NamedTuple):
    """Of one run."""

    stiffness: float  # N/m
    energy: float  # J
    bounces: int
    first: float  # m


def case(law: str, delay: int, controller: LocalModel | None, hand: Any = None) -> GraphConfig:
    """Return the configuration of one run; ``delay`` in ms each way."""
    arguments = [f"law:={law}", f"delay:={delay} ms", "controller:=direct"]
    config = load("far_wall", arguments)
    if controller is not None:
        config = config.with_hand(controller=controller)
    return config if hand is None else config.with_hand(operator=hand)


def touching_hand(folder: Path) -> TrajectoryHand:
    """Return the hand that touches, lets go and presses."""
    file = folder / "touch_and_press.csv"
    file.write_text(TOUCH_AND_PRESS)
    return TrajectoryHand(file)


def figures(config: GraphConfig) -> tuple[Figures, TelemetryColumns]:
    """Return the figures of a run, and its telemetry."""
    result = run_virtual(config, DURATION)
    columns, samples = result.columns, Samples(result.columns, result.document)
    touches_twice = isinstance(config.only.operator, TrajectoryHand)
    depth = columns.position[:, 0] - SURFACE
    since = columns.elapsed >= AGAIN if touches_twice else columns.elapsed > 0.0
    contact = since & (np.cumsum(since & (depth > 0.0)) > 0)
    first = depth[columns.elapsed < AGAIN / 2.0].max()
    energy = float(columns.true_energy[columns.elapsed > 0.0].min())
    bounces = count_bounces(columns.position[contact, 0])
    return Figures(samples.displayed_stiffness or 0.0, energy, bounces, float(first)), columns


def row(name: str, found: Figures, reference: Figures) -> str:
    """Return a row of the table."""
    share = found.stiffness / reference.stiffness
    return (
        f"| {name} | {found.stiffness:.0f} ({share:.2f}) | {found.bounces}"
        f" | {found.first * 1e3:.1f} | {found.energy * 1e3:.3f} |"
    )


def table(law: str, hand: Any) -> dict[str, TelemetryColumns]:
    """Print the table of one law and hand; return the runs of ``DRAWN``."""
    print("| controller | stiffness, N/m | bounces | first, mm | energy, mJ |")
    print("|---|---|---|---|---|")
    near = "direct, 0 ms"
    reference, columns = figures(case(law, 0, None, hand))
    print(row(near, reference, reference))
    runs = {near: columns}
    for delay in DELAYS:
        for name, controller in CONTESTANTS.items():
            found, columns = figures(case(law, delay, controller, hand))
            print(row(f"{name}, {delay} ms", found, reference), flush=True)
            if name in DRAWN:
                runs[f"{name}, {delay} ms"] = columns
    return runs


def print_powers(hand: Any) -> None:
    """Print the second press, 50 ms each way, by what changes of the plane may give."""
    reference, _ = figures(case(LAWS[0], 0, None, hand))
    for power in POWERS:
        found, _ = figures(case(LAWS[0], DELAYS[-1], LocalModel(power=power), hand))
        print(row(f"{power * 1e3:g} mW", found, reference), flush=True)


def scene(name: str, controller: str, delay: int) -> GraphConfig:
    """Return one of ``SCENES``; ``delay`` in ms each way."""
    arguments = [f"controller:={controller}", f"delay:={delay} ms", "age_limit:=300 ms"]
    if name == "touch_sphere":
        hand = StrokingHand(start=(-0.01, 0.0, 0.0), end=(0.014, 0.0, 0.0), stroke=(0, 0, 0.012))
        return load(name, [*arguments, "stiffness:=2 N/mm"]).with_hand(operator=hand)
    if not name.startswith("ridges"):
        return load(name, arguments)
    pitch = 1e-3 * float(name.split()[1])
    radius = (0.25 * pitch**2 + RIDGE**2) / (2.0 * RIDGE)
    row = range(-round(0.024 / pitch), round(0.024 / pitch) + 1)
    places = [(SURFACE + radius, pitch * k, 0.0) for k in row]
    shapes = tuple(Shape("cylinder", place, radius=radius, length=0.1) for place in places)
    config = load("sliding_friction", arguments)
    world = replace(config.environment, model=Solid(shapes, stiffness=1000.0))
    return replace(config, environment=world)


def error_of(config: GraphConfig) -> tuple[float, float]:
    """Return RMS error, in N, and correlation of the commanded force, from 1 s on.

    The right force is what the same world gives where the hand is, without any delay.
    """
    columns = run_virtual(config, DURATION).columns
    axes = columns.position.shape[1]
    world, still = config.environment.model.open(axes), (0.0,) * axes
    asked = zip(columns.position.tolist(), columns.elapsed.tolist(), strict=True)
    right = np.array([world.force("", tuple(place), still, time) for place, time in asked])
    force, right = (one[columns.elapsed > 1.0] for one in (columns.commanded_force, right))
    error = float(np.sqrt(np.mean(np.sum((force - right) ** 2, axis=1))))
    deviations = [(one - one.mean(axis=0)).ravel() for one in (force, right)]
    return error, float(np.corrcoef(*deviations)[0, 1])


def print_limits() -> None:
    """Print the error of each of ``SCENES``."""
    cases = [(name, delay) for delay in (0, 20) for name in DRAWN]
    print(f"| scene | {' | '.join(f'{name}, {delay} ms' for name, delay in cases)} |")
    print("|---" * (1 + len(cases)) + "|")
    for name in SCENES:
        errors = (error_of(scene(name, *one)) for one in cases)
        cells = (f"{error:.2f} N, {correlation:.2f}" for error, correlation in errors)
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description="Stiffness of a wall that is far away.")
    parser.add_argument("--plot", type=Path, help="draw the second hand's runs into this file")
    parser.add_argument("--limits", action="store_true", help="print only the last table")
    options = parser.parse_args()
    if options.limits:
        print_limits()
        return
    with tempfile.TemporaryDirectory() as folder:
        hands = {"presses once": None, "touches, then presses": touching_hand(Path(folder))}
        runs = {}
        for name, hand in hands.items():
            for law in LAWS:
                print(f"\n{name}, {law}")
                runs[name, law] = table(law, hand)
        print("\nlocal_model with other powers, touches, then presses, 50 ms, certified")
        print_powers(hands["touches, then presses"])
    print("\ncommanded force against the right one: RMS error, correlation")
    print_limits()
    if options.plot:
        draw(runs["touches, then presses", LAWS[0]], options.plot)


def draw(runs: Mapping[str, TelemetryColumns], file: Path) -> None:
    """Draw depth and force of runs over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 6.0), layout="constrained")
    depths, forces = figure.subplots(2, 1, sharex=True)
    for name, columns in runs.items():
        width = 2.5 if name == "direct, 0 ms" else 1.2
        depth = (columns.position[:, 0] - SURFACE) * 1e3
        depths.plot(columns.elapsed, depth, linewidth=width, label=name)
        forces.plot(columns.elapsed, columns.applied_force[:, 0], linewidth=width)
    depths.set(ylabel="depth in the wall (mm)", ylim=(-2.0, 6.0))
    depths.axhspan(-2.0, 0.0, color="0.93")
    depths.legend(loc="upper right", ncols=2)
    figure.suptitle("Best case: a flat wall that stands still, and was touched before")
    forces.set(ylabel="applied force (N)", xlabel="time since the force engaged (s)", xlim=(0, 2))
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main()
