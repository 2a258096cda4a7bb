"""The tree of triangles against brute force, exact shapes and libigl."""

import itertools
import math
from random import Random

import igl
import meshes
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from forcebound.haptics.geometry.bounding_volumes import LEAF, WIDTH, TriangleTree, depth_for
from forcebound.haptics.geometry.triangles import closest_on_triangle, contact_time
from forcebound.haptics.geometry.vectors import Vector3, norm, sub

coordinate = st.integers(-6, 6).map(lambda n: 0.25 * n)  # many equal, parallel, in one line
vector = st.tuples(coordinate, coordinate, coordinate)


def points_near(count: int, seed: int = 1) -> list[Vector3]:
    """Points around a body of 10 cm, most of them near its surface."""
    random = Random(seed)
    found = []
    for _ in range(count):
        x, y, z = (random.gauss(0.0, 1.0) for _ in range(3))
        radius = 0.05 * (1.0 + random.gauss(0.0, 0.1)) / math.hypot(x, y, z)
        found.append((radius * x, radius * y, radius * z))
    return found


def test_the_closest_points_of_a_bumpy_mesh_are_those_of_libigl() -> None:
    vertices, faces = meshes.bumpy(6)
    tree = TriangleTree(vertices[faces])
    points = [*points_near(2000), (0.0, 0.0, 0.0), (3.0, -2.0, 1.0)]
    squares, _, _ = igl.point_mesh_squared_distance(np.array(points), vertices, faces)
    for point, square in zip(points, squares, strict=True):
        place, at, distance = tree.closest(point)
        assert distance == pytest.approx(math.sqrt(square), abs=1e-12)
        assert norm(sub(point, at)) == pytest.approx(distance, abs=1e-15)
        on = closest_on_triangle(at, *map(tuple, vertices[faces[tree.order[place]]].tolist()))
        assert norm(sub(on, at)) < 1e-15


def test_the_first_hits_of_a_bumpy_mesh_are_those_of_libigl() -> None:
    vertices, faces = meshes.bumpy(6)
    tree = TriangleTree(vertices[faces])
    rays, in_mm = igl.AABB(), 1e3 * vertices  # libigl takes small triangles for parallel to a ray
    rays.init(in_mm, faces)
    points = points_near(2000)
    hits = 0
    for start, end in itertools.pairwise(points):
        origin, way = 1e3 * np.array([start]), 1e3 * np.array([sub(end, start)])
        hit, time, _ = rays.intersect_ray_first(in_mm, faces, origin, way)
        place, ours = tree.first_contact(start, end)
        is_hit = hit[0] >= 0 and time[0] <= 1.0
        assert (place >= 0) == is_hit
        if is_hit:
            hits += 1
            assert ours == pytest.approx(time[0], abs=1e-6)  # of single precision there
    assert 500 < hits < 1999


@pytest.mark.parametrize("count", [1, 2, 7, 33, 300])
def test_no_triangle_is_lost_in_the_tree(count: int) -> None:
    random = np.random.default_rng(count)
    corners = random.normal(size=(count, 3, 3)).astype(np.float32)
    tree = TriangleTree(corners)
    assert sorted(tree.order) == list(range(count))
    for k in range(count):
        centre = tuple(corners[k].astype(float).mean(axis=0).tolist())
        assert tree.closest(centre)[2] < 1e-7


def test_equal_centres_are_divided_too() -> None:
    tree = TriangleTree(np.repeat(np.eye(3)[None], 5000, axis=0))
    assert tree.closest((1.0, 1.0, 1.0))[2] == pytest.approx(2.0 / math.sqrt(3.0))


@pytest.mark.parametrize("count", [1, 32, 33, 500_000, 3_000_000])
def test_a_leaf_has_few_triangles(count: int) -> None:
    leaves = WIDTH ** depth_for(count)
    assert math.ceil(count / leaves) <= LEAF


@given(vector, vector, vector, vector)
def test_the_closest_point_of_any_triangle_beats_a_fine_grid_of_its_points(
    point: Vector3, a: Vector3, b: Vector3, c: Vector3
) -> None:
    steps = np.linspace(0.0, 1.0, 21)
    u, v = (grid.ravel() for grid in np.meshgrid(steps, steps))
    inside = u + v <= 1.0
    u, v = u[inside][:, None], v[inside][:, None]
    grid = np.array(a) * (1 - u - v) + np.array(b) * u + np.array(c) * v
    distances = np.linalg.norm(grid - np.array(point), axis=1)
    distance = norm(sub(point, closest_on_triangle(point, a, b, c)))
    assert distance <= distances.min() + 1e-12
    assert distance >= distances.min() - 0.2  # half of the grid's step on the longest edge
    away = np.linalg.norm(grid - np.array(closest_on_triangle(point, a, b, c)), axis=1)
    assert away.min() < 0.3  # it is a point of the triangle


@settings(max_examples=200)
@given(vector, vector, vector, vector, vector, st.sampled_from([0.01, 0.1]))
def test_a_moving_ball_stops_before_any_triangle(
    start: Vector3, end: Vector3, a: Vector3, b: Vector3, c: Vector3, radius: float
) -> None:
    """Also before slivers, and triangles that are a line or a point."""
    first = norm(sub(start, closest_on_triangle(start, a, b, c)))
    time = contact_time(start, end, a, b, c, radius)
    until = min(time, 1.0)
    for k in range(101):
        share = 0.01 * k * until
        x, y, z = (p + share * (q - p) for p, q in zip(start, end, strict=True))
        distance = norm(sub((x, y, z), closest_on_triangle((x, y, z), a, b, c)))
        assert distance >= min(0.5 * radius, first) * (1.0 - 1e-5)
    if 0.0 < time <= 1.0:
        x, y, z = (p + time * (q - p) for p, q in zip(start, end, strict=True))
        distance = norm(sub((x, y, z), closest_on_triangle((x, y, z), a, b, c)))
        assert radius <= distance <= 1.002 * radius
