"""Stiffness of a wall that is far away: controllers against each other, and where that ends.

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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import click
import numpy as np

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.haptics.controllers.local_model import LocalModel
from forcebound.haptics.environments.solid import Shape, Solid
from forcebound.haptics.hands.hands import StrokingHand
from forcebound.haptics.hands.paths import TrajectoryHand
from forcebound.lab.cases import grid
from forcebound.lab.engine import Campaign, Row, run_here
from forcebound.lab.views import groups, table
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.contact import count_bounces
from forcebound.results.plots import save
from forcebound.results.samples import Samples
from forcebound.run.virtual import run_virtual

LAWS = ("certified", "certified_fading")
DELAYS = (20, 50)  # ms, each way
SURFACE = 0.010  # m
ONCE, TWICE = "presses once", "touches, then presses"  # hands
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
#: Local models, by what changes of the plane may give.
POWERS = {f"{1e3 * power:g} mW": LocalModel(power=power) for power in (0.0, 0.005, 0.02, 0.05)}
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
    arguments = [
        f"law:={law}",
        f"delay:={delay} ms",
        "controller:=direct",
        "device.hand_speed:=null",
    ]
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


def press(cell: Row) -> tuple[Figures, TelemetryColumns]:
    """Return the figures of a cell of the tables, and its telemetry."""
    controller = {**CONTESTANTS, **POWERS}[cell["controller"]]
    with TemporaryDirectory() as folder:
        hand = touching_hand(Path(folder)) if cell["hand"] == TWICE else None
        return figures(case(cell["law"], cell["delay"], controller, hand))


def measure(cells: Sequence[Row]) -> list[Row]:
    """Run some cells of the tables; return a row for each."""
    return [{**cell, **press(cell)[0]._asdict()} for cell in cells]


def cells_of_tables() -> list[Row]:
    """Return the cells of the tables: of each hand and law, its reference first."""
    found = []
    for start in grid(hand=(ONCE, TWICE), law=LAWS):
        found.append({**start, "delay": 0, "controller": "direct"})
        found += [{**start, **one} for one in grid(delay=DELAYS, controller=[*CONTESTANTS])]
    return found + grid(hand=[TWICE], law=LAWS[:1], delay=DELAYS[-1:], controller=[*POWERS])


def shown(rows: Sequence[Row], reference: Row) -> Iterator[str]:
    """Yield a table of rows, with the share of the reference's stiffness."""
    cells = (
        (
            f"{row['controller']}, {row['delay']} ms",
            f"{row['stiffness']:.0f} ({row['stiffness'] / reference['stiffness']:.2f})",
            row["bounces"],
            f"{row['first'] * 1e3:.1f}",
            f"{row['energy'] * 1e3:.3f}",
        )
        for row in rows
    )
    yield from table(("controller", "stiffness, N/m", "bounces", "first, mm", "energy, mJ"), cells)


def tables(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the tables of the hands and laws, and that of the powers."""
    usual = groups((row for row in rows if row["controller"] in CONTESTANTS), "hand", "law")
    for (hand, law), own in usual.items():
        yield f"\n{hand}, {law}"
        yield from shown(own, own[0])
    yield f"\nlocal_model with other powers, {TWICE}, {LAWS[0]}"
    powers = [row for row in rows if row["controller"] in POWERS]
    yield from shown(powers, usual[TWICE, LAWS[0]][0])


def scene(name: str, controller: str, delay: int) -> GraphConfig:
    """Return one of ``SCENES``; ``delay`` in ms each way."""
    arguments = [
        f"controller:={controller}",
        f"delay:={delay} ms",
        "age_limit:=300 ms",
        "device.hand_speed:=null",
    ]
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


def measure_scenes(cases: Sequence[Row]) -> list[Row]:
    """Run some of the scenes; return a row for each."""
    found = []
    for one in cases:
        error, correlation = error_of(scene(one["scene"], one["controller"], one["delay"]))
        found.append({**one, "cell": f"{error:.2f} N, {correlation:.2f}"})
    return found


def limits() -> Iterator[str]:
    """Yield the table of the scenes: error and correlation of the force."""
    cases = grid(scene=SCENES, delay=(0, 20), controller=DRAWN)
    rows = run_here(Campaign("scenes", cases, measure_scenes, part=1), workers=None).rows
    by_scene = groups(rows, "scene").items()
    heads = [f"{row['controller']}, {row['delay']} ms" for row in rows[: 2 * len(DRAWN)]]
    yield "\ncommanded force against the right one: RMS error, correlation"
    lines = ((name, *(row["cell"] for row in own)) for (name,), own in by_scene)
    yield from table(("scene", *heads), lines)


@click.command()
@click.option("--plot", type=click.Path(path_type=Path), help="Draw the second hand's runs.")
@click.option("--limits", "only_limits", is_flag=True, help="Print only the last table.")
def main(plot: Path | None, only_limits: bool) -> None:
    """Stiffness of a wall that is far away, by controller and delay."""
    if not only_limits:
        cells = cells_of_tables()
        rows = run_here(Campaign("far wall", cells, measure, part=1), workers=None).rows
        click.echo("\n".join(tables(rows)))
    click.echo("\n".join(limits()))
    if plot:
        draw(plot)


def draw(file: Path) -> None:
    """Draw depth and force over time: the second hand, the first law."""
    from forcebound_proofs.drawing import TIME, finish, line, rows_of

    drawing, (depths, forces) = rows_of(2, height=2.7)
    lines = [(0, "direct"), *((delay, name) for delay in DELAYS for name in DRAWN)]
    for number, (delay, controller) in enumerate(lines):
        style: dict[str, Any] = {"linewidth": 1.2 if delay else 2.5, "colour": f"C{number}"}
        cell = {"hand": TWICE, "law": LAWS[0], "delay": delay, "controller": controller}
        _, columns = press(cell)
        name, depth = f"{controller}, {delay} ms", (columns.position[:, 0] - SURFACE) * 1e3
        line(depths, columns.elapsed, depth, name, **style)
        line(forces, columns.elapsed, columns.applied_force[:, 0], name, **style)
    depths.axhspan(-2.0, 0.0, color="0.93")
    drawing.suptitle("Best case: a flat wall that stands still, and was touched before")
    finish(depths, "depth in the wall (mm)", window=(0.0, 2.0))
    depths.set_ylim(-2.0, 6.0)
    finish(forces, "applied force (N)", TIME, window=(0.0, 2.0))
    save(drawing, file)
