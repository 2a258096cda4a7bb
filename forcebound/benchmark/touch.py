"""Benchmark of meshes: closest point and first hit on 500,000 triangles, against libigl.

One question a tick, as a hand asks them, so that the memory is cold. The places are drawn at random
near the surface of a bumpy ball, or lie on a hand's stroke over it; the yardstick is exact, and the
largest difference of the answers is told. vtk takes part where it is installed.
"""

import importlib
import math
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from random import Random
from typing import Any, NamedTuple, TypeAlias

from forcebound.benchmark.figures import Measured, compare, judge, plan, report
from forcebound.benchmark.workers import conditions
from forcebound.errors import RunError
from forcebound.geometry.bounding_volumes import TriangleTree
from forcebound.geometry.god_object import MeshSolid
from forcebound.geometry.vectors import Vector3
from forcebound.realtime import wait_until

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
UNITS = {"random": "m", "stroke": "m", "hit": "of the way"}


class Contestant(NamedTuple):
    """Who answers questions about a mesh."""

    ready: Callable[[Question], tuple[Any, ...]]  # what it is asked with; not timed
    ask: Callable[..., Any]
    read: Callable[[Any], float]  # distance in m, or time on the way (nan: none); not timed


def run(duration: float, rate: float, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run the benchmark; see :meth:`forcebound.benchmark.Benchmark.run`."""
    progress("building the trees")
    mesh = bumpy_ball(TRIANGLES)
    tasks = _tasks(mesh)
    measured = {
        f"{task}_{who}": Measured(f"{TASKS[task]}, {who}") for task in tasks for who in tasks[task]
    }
    furthest = dict.fromkeys(tasks, 0.0)
    rounds, count = plan(duration, len(measured), rate)
    for number in range(rounds):
        progress(f"round {number + 1} of {rounds}")
        for task, contestants in tasks.items():
            ways = questions(task, count, seed=number + 1)
            answers = {
                who: _timed(measured[f"{task}_{who}"], contestant, ways, rate)
                for who, contestant in contestants.items()
            }
            if "libigl" in answers:
                here = _difference(answers["ours"], answers["libigl"])
                furthest[task] = max(furthest[task], here)
    comparisons = {}
    for task, contestants in tasks.items():
        ours = measured[f"{task}_ours"]
        p99 = ours.at("p99") / 1e3
        comparisons[f"{task}_p99"] = judge(f"{ours.label}, p99", p99, "us", TARGET_US)
        if "libigl" in contestants:
            libigl = measured[f"{task}_libigl"]
            comparisons[f"{task}_ratio"] = compare(ours, libigl, "p50", 1.0)
            what = f"{TASKS[task]}, largest difference to libigl, {UNITS[task]}"
            comparisons[f"{task}_difference"] = judge(what, furthest[task], "ratio", None)
    surroundings = conditions() | {"triangles": len(mesh[1])}
    return report("touch", duration, rate, measured, comparisons, surroundings)


def _tasks(mesh: Mesh) -> dict[str, dict[str, Contestant]]:
    """Return who does what."""
    vertices, faces = mesh
    tree = TriangleTree(vertices[faces])
    solid = MeshSolid(tree.own(), is_closed=True)
    closest = {"ours": Contestant(lambda way: way[1:], tree.closest, lambda answer: answer[2])}
    hit = {"ours": Contestant(lambda way: way, tree.own().first_contact, _time_of_ours)}
    for name, locate in (("libigl", _libigl), ("vtk", _vtk)):
        both = locate(mesh)
        if both is not None:
            closest[name], hit[name] = both
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
    """Return the yardstick for closest points and hits.

    Raises:
        RunError: If it is not installed.
    """
    import numpy as np

    try:
        import igl
    except ImportError:
        raise RunError(
            "the yardstick of this benchmark is libigl: `pip install libigl` installs it"
        ) from None
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


def _vtk(mesh: Mesh) -> tuple[Contestant, Contestant] | None:
    """Return vtk's answers; None where it is not installed: it has some hundred megabytes."""
    import numpy as np

    try:
        core, model, support = (
            importlib.import_module(f"vtkmodules.{name}")
            for name in ("vtkCommonCore", "vtkCommonDataModel", "util.numpy_support")
        )
    except ImportError:
        return None
    points, triangles, surface = core.vtkPoints(), model.vtkCellArray(), model.vtkPolyData()
    points.SetData(support.numpy_to_vtk(mesh[0], deep=True))
    ends = np.arange(0, 3 * len(mesh[1]) + 1, 3, dtype=np.int64)
    corners = mesh[1].astype(np.int64).ravel()
    triangles.SetData(*(support.numpy_to_vtkIdTypeArray(one, 1) for one in (ends, corners)))
    surface.SetPoints(points)
    surface.SetPolys(triangles)
    locator, cell = model.vtkStaticCellLocator(), model.vtkGenericCell()
    locator.SetDataSet(surface)
    locator.BuildLocator()
    time_on_way, index, part, square = map(core.mutable, (0.0, 0, 0, 0.0))
    place, weights = [0.0] * 3, [0.0] * 3

    def closest(point: Vector3) -> float:
        locator.FindClosestPoint(point, place, cell, index, part, square)
        return math.sqrt(square.get())

    def hit(start: Vector3, end: Vector3) -> float:
        found = locator.IntersectWithLine(start, end, 0.0, time_on_way, place, weights, part, index)
        return float(time_on_way.get()) if found else math.nan

    return (
        Contestant(lambda way: way[1:], closest, float),
        Contestant(lambda way: way, hit, float),
    )


def bumpy_ball(triangles: int) -> Mesh:
    """Return a closed ball with bumps and dents, of about so many triangles."""
    import numpy as np

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


def _timed(
    measured: Measured, contestant: Contestant, ways: Sequence[Question], rate: float
) -> list[float]:
    period_ns = round(1e9 / rate)
    contestant.ask(*contestant.ready(ways[0]))  # the first call compiles
    times_ns, answers = [], []
    processor_ns, start_ns = time.process_time_ns(), time.monotonic_ns()
    for tick, way in enumerate(ways):
        ready = contestant.ready(way)
        wait_until(start_ns + tick * period_ns, 0)
        begun_ns = time.monotonic_ns()
        answer = contestant.ask(*ready)
        times_ns.append(time.monotonic_ns() - begun_ns)
        answers.append(contestant.read(answer))
    processor_ns = time.process_time_ns() - processor_ns
    measured.add(times_ns, 0, processor_ns, time.monotonic_ns() - start_ns)
    return answers


def _difference(ours: Sequence[float], others: Sequence[float]) -> float:
    """Return the largest difference; infinity where one has an answer and the other none."""
    pairs = zip(ours, others, strict=True)
    return max(
        0.0 if math.isnan(a) and math.isnan(b) else abs(a - b) if a == a and b == b else math.inf
        for a, b in pairs
    )
