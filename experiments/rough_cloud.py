"""Time of an answer on a cloud of points, by the noise of the points and by friction.

Usage: python experiments/rough_cloud.py

A tip strokes at 0.2 m/s and 3 mm deep over points on a sphere of 30 mm, each moved by noise on
every axis. Processor time of the answers, so that a busy machine counts for little.
"""

import math
import tempfile
import time
from pathlib import Path

import numpy as np

from forcebound.environments.point_cloud import PointCloud
from forcebound.environments.touching import OpenTouchable
from forcebound.geometry.proxy import Surface

RADIUS, POINTS = 0.03, 5000  # m
DEPTH, SPEED = 0.003, 0.2  # m, below the points; m/s
SECONDS = 4.0
NOISES, FRICTIONS = (0.0, 0.0005, 0.001), (0.0, 0.3, 0.8)  # m
STILL = (0.0, 0.0, 0.0)


def sphere(noise: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return points spread evenly over a sphere (Fibonacci's spiral), with noise, in m."""
    number = np.arange(POINTS)
    height = 1.0 - 2.0 * (number + 0.5) / POINTS
    turn = number * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    even = RADIUS * np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
    return even + np.random.default_rng(1).normal(0.0, noise, even.shape)


def times_us(world: OpenTouchable) -> list[float]:
    """Return how long the answers of a stroke take, in us."""
    taken = []
    world.force("", (0.0, 0.0, RADIUS + 0.02), STILL, 0.0)
    for tick in range(round(SECONDS * 1e3)):
        angle = SPEED * tick * 1e-3 / RADIUS
        away = RADIUS - DEPTH * min(tick / 500.0, 1.0)
        place = (away * math.sin(angle), 0.0, away * math.cos(angle))
        begun_ns = time.thread_time_ns()
        world.force("", place, STILL, tick * 1e-3)
        taken.append((time.thread_time_ns() - begun_ns) / 1e3)
    return taken


def main() -> None:
    """Print the table."""
    print("| noise, mm | friction | p50, us | p99, us | max, us |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for noise in NOISES:
            file = Path(folder) / f"{noise}.npy"
            np.save(file, sphere(noise))
            for friction in FRICTIONS:
                surface = Surface(friction=friction)
                model = PointCloud(file, position=STILL, surface=surface)
                taken = np.percentile(times_us(model.open(3)), (50, 99, 100))
                shown = " | ".join(f"{one:.0f}" for one in taken)
                print(f"| {1e3 * noise:g} | {friction:g} | {shown} |", flush=True)


if __name__ == "__main__":
    main()
