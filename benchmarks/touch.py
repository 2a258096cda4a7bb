"""Closest point and first hit on a mesh of 500,000 triangles, against libigl, and a proxy's way.

One question a tick, as a hand asks them, so that the memory is cold. The places are drawn at random
near the surface of a bumpy ball, or lie on a hand's stroke over it. libigl is exact.
"""

import copy
import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from random import Random
from typing import Any, NamedTuple, TypeAlias

import igl
import numpy as np

from benchmarks.harness import Figure, Measured, Result, alternate, at, compare, timed
from forcebound.haptics.geometry.bounding_volumes import TriangleTree
from forcebound.haptics.geometry.god_object import MeshSolid
from forcebound.haptics.geometry.vectors import Vector3
from forcebound.observe.measure import WARMUP, Round, Timing, pace
from forcebound.realtime import Settings

DURATION = 16.0
ASKED = "closest point of a mesh of 500,000 triangles, random places"
TARGET_US = 30.0  # p99
TRIANGLES = 500_000
RADIUS = 0.05  # m, of the ball
SPREAD = 0.04  # of the radius, 2 mm, of the places at random
STROKE_SPEED, STROKE_DEPTH = 0.2, 0.003  # m/s over the surface; m in and out of it
MM = 1e3  # per m

Mesh: TypeAlias = tuple[Any, Any]  # vertices (n, 3) in m, triangles (m, 3)
Question: TypeAlias = tuple[Vector3, Vector3]  # start and end of a way; the end is the place
TASKS = {
    "random": "closest point, places at random",
    "stroke": "closest point, a stroke",
    "hit": "first hit, a stroke",
    "proxy": "proxy, a stroke",
}


class Contestant(NamedTuple):
    """What answers questions about a mesh."""

    ready: Callable[[Question], tuple[Any, ...]]  # its arguments; not timed
    ask: Callable[..., Any]
    read: Callable[[Any], float]  # distance in m, or time on the way (nan: none); not timed


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    tasks = _tasks(bumpy_ball(TRIANGLES))
    answers: dict[str, list[float]] = {
        f"{TASKS[task]}, {name}": [] for task, one in tasks.items() for name in one
    }
    contestants = {
        label: partial(_round, task, contestant, answers[label])
        for label, (task, contestant) in zip(
            answers, [(task, c) for task, one in tasks.items() for c in one.values()], strict=True
        )
    }
    found = {one.label: one for one in alternate(duration, rate, contestants)}
    figures: list[Figure] = []
    for words in TASKS.values():
        is_shown = words == TASKS["random"]
        figures.append(at(found[f"{words}, ours"], "p99", TARGET_US, is_shown))
        if (theirs := f"{words}, libigl") in found:
            figures += _against(words, found, answers[f"{words}, ours"], answers[theirs])
    return list(found.values()), figures


def _against(
    words: str, found: dict[str, Measured], ours: list[float], theirs: list[float]
) -> Iterator[Figure]:
    shown = "libigl (p50)" if words == TASKS["random"] else ""
    yield compare(found[f"{words}, ours"], found[f"{words}, libigl"], "p50", 1.0, shown)
    differences = [
        0.0 if math.isnan(a) and math.isnan(b) else abs(a - b) if a == a and b == b else math.inf
        for a, b in zip(ours, theirs, strict=True)
    ]
    yield Figure(f"{words}, largest difference to libigl", max(differences), "m, or of the way")


def _round(task: str, contestant: Contestant, answers: list[float], timing: Timing) -> Round:
    contestant.ask(*contestant.ready(((0.0, 0.0, 0.0), (RADIUS, 0.0, 0.0))))  # compile
    ways = iter(questions(task, timing[1] + WARMUP + 1, seed=1 + len(answers)))

    def exchange(_: int) -> int:
        ready, found = contestant.ready(next(ways)), []
        took_ns = timed(lambda: found.append(contestant.ask(*ready)))
        answers.append(contestant.read(found[0]))
        return took_ns

    return pace(exchange, Settings(spin_ns=0), timing)


def _tasks(mesh: Mesh) -> dict[str, dict[str, Contestant]]:
    """Return the contestants of each task."""
    vertices, faces = mesh
    tree = TriangleTree(vertices[faces])
    solid = MeshSolid(copy.copy(tree), is_closed=True)
    closest = {"ours": Contestant(lambda way: way[1:], tree.closest, lambda answer: answer[2])}
    hit = {"ours": Contestant(lambda way: way, copy.copy(tree).first_contact, _time_of_ours)}
    closest["libigl"], hit["libigl"] = _libigl(mesh)
    proxy: Vector3 = (2.0 * RADIUS, 0.0, 0.0)

    def slide(goal: Vector3) -> float:
        nonlocal proxy
        proxy, _ = solid.slide(proxy, goal)
        return 0.0

    moved = {"ours": Contestant(lambda way: way[1:], slide, float)}
    return {"random": closest, "stroke": closest, "hit": hit, "proxy": moved}


def _time_of_ours(answer: tuple[int, float]) -> float:
    return answer[1] if answer[0] >= 0 else math.nan


def _libigl(mesh: Mesh) -> tuple[Contestant, Contestant]:
    """Return libigl for closest points, and for hits."""
    vertices, faces = mesh[0], mesh[1].astype(np.int64)
    in_mm = MM * vertices  # libigl takes small triangles for parallel to a way
    near, across = igl.AABB(), igl.AABB()
    near.init(vertices, faces)
    across.init(in_mm, faces)

    def time_of(answer: Any) -> float:
        index, times, _ = answer
        is_hit = index[0] >= 0 and times[0] <= 1.0
        return float(times[0]) if is_hit else math.nan

    def way_of(way: Question) -> tuple[Any, ...]:
        start, end = np.array(way[:1]), np.array(way[1:])
        return in_mm, faces, MM * start, MM * (end - start)

    return (
        Contestant(
            lambda way: (vertices, faces, np.array(way[1:])),
            near.squared_distance,
            lambda answer: math.sqrt(answer[0][0]),
        ),
        Contestant(way_of, across.intersect_ray_first, time_of),
    )


def bumpy_ball(triangles: int) -> Mesh:
    """Return a closed ball with bumps and dents, of about so many triangles."""
    rows = round(math.sqrt(triangles / 4.0))
    around = 2 * rows
    angle, down = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, around, endpoint=False),
        np.linspace(0.0, np.pi, rows + 1)[1:-1],
    )
    bumps = 0.05 * np.sin(9 * angle) * np.sin(7 * down)
    bumps += 0.01 * np.sin(41 * angle) * np.sin(37 * down)
    across = np.sin(down)
    directions = np.stack([across * np.cos(angle), across * np.sin(angle), np.cos(down)], axis=-1)
    sides = (RADIUS * (1.0 + bumps)[..., None] * directions).reshape(-1, 3)
    vertices = np.vstack([sides, [(0.0, 0.0, RADIUS), (0.0, 0.0, -RADIUS)]])
    index = np.arange(len(sides)).reshape(rows - 1, around)
    beside = np.roll(index, -1, axis=1)
    a, b, c, d = index[:-1], beside[:-1], index[1:], beside[1:]
    top, bottom = np.full(around, len(sides)), np.full(around, len(sides) + 1)
    faces = [(a, c, b), (b, c, d), (top, index[0], beside[0]), (bottom, beside[-1], index[-1])]
    rounded = vertices.astype(np.float32).astype(float)  # as our tree has them
    return rounded, np.vstack([np.stack(one, axis=-1).reshape(-1, 3) for one in faces])


def questions(task: str, count: int, seed: int) -> list[Question]:
    """Return ways of a hand, each from where the one before ended."""
    random = Random(seed)
    places: list[Vector3] = []
    for tick in range(count + 1):
        if task == "random":
            x, y, z = (random.gauss(0.0, 1.0) for _ in range(3))
            radius = RADIUS * (1.0 + random.gauss(0.0, SPREAD))
        else:
            angle = seed + STROKE_SPEED * tick * 1e-3 / RADIUS
            x, y, z = math.cos(angle), math.sin(angle), 0.3 * math.sin(0.37 * angle)
            is_out = task != "proxy" and tick % 2 == 0  # so that every way meets the surface
            radius = RADIUS + (STROKE_DEPTH if is_out else -STROKE_DEPTH)
        factor = radius / math.hypot(x, y, z)
        places.append((factor * x, factor * y, factor * z))
    return list(pairwise(places))
