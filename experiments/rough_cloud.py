"""What a hand feels of a cloud of points.

The points are on a sphere of 30 mm, evenly or at random, and have the radius that they get where
nothing is said. The hand presses straight on it at 60 places, until it is 10 mm below the points.
The force must be along the radius; where it is less than half of what 10 mm give, the hand has
fallen through a hole.
"""

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import click
import numpy as np

from forcebound.haptics.environments.solids_of_files import PointCloud
from forcebound.haptics.geometry.points import neighbourhoods
from forcebound.lab.views import table

RADIUS = 0.03  # m
STILL = (0.0, 0.0, 0.0)
COUNTS, PRESSES = (3_000, 10_000, 30_000), 60
DEEPEST, FROM, STEP = 0.010, -0.015, 0.0002  # m below the points
STIFFNESS = 1000.0  # N/m
HEADS = ("points", "radius, mm", "falls through", "off the radius, p50, deg", "p99, deg")

Points: TypeAlias = "np.ndarray[tuple[int, ...], np.dtype[np.float64]]"


def evenly(count: int) -> Points:
    """Return points spread evenly over a sphere (Fibonacci's spiral), in m."""
    number = np.arange(count)
    height = 1.0 - 2.0 * (number + 0.5) / count
    turn = number * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    return RADIUS * np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)


def at_random(count: int, seed: int = 1) -> Points:
    """Return points spread over a sphere at random, in m."""
    drawn = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(RADIUS * drawn / np.linalg.norm(drawn, axis=1, keepdims=True))


def pressed(model: PointCloud) -> tuple[int, list[float]]:
    """Return how many presses fall through, and how far the forces are off the radius, in deg."""
    fallen, angles = 0, []
    for out in at_random(PRESSES, seed=2) / RADIUS:
        world, force = model.open(3), np.zeros(3)
        for depth in np.arange(FROM, DEEPEST + STEP / 2, STEP):
            x, y, z = ((RADIUS - depth) * out).tolist()
            force = np.array(world.force("", (x, y, z), STILL, 0.0))
            size = float(np.linalg.norm(force))
            if depth > 0.0 and size > 0.0:
                angles.append(math.degrees(math.acos(min(abs(float(force @ out)) / size, 1.0))))
        fallen += bool(np.linalg.norm(force) < 0.5 * STIFFNESS * DEEPEST)
    return fallen, angles


def presses(folder: Path) -> Iterator[tuple[str, ...]]:
    """Yield the row of each cloud, under ``HEADS``."""
    for name, spread in (("even", evenly), ("random", at_random)):
        for count in COUNTS:
            file = folder / f"{name}{count}.npy"
            np.save(file, spread(count))
            model = PointCloud(file, position=STILL, stiffness=STIFFNESS)
            fallen, angles = pressed(model)
            p50, p99 = np.percentile(angles, (50, 99))
            radius = np.median(neighbourhoods(model.content().points)[:, -1])
            fell = f"{fallen} of {PRESSES}"
            yield f"{count:,}, {name}", f"{1e3 * radius:.2f}", fell, f"{p50:.1f}", f"{p99:.1f}"


@click.command()
def main() -> None:
    """Print what a hand feels that presses on clouds of points."""
    with tempfile.TemporaryDirectory() as folder:
        for line in table(HEADS, presses(Path(folder))):
            click.echo(line)
