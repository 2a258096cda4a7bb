"""The proxy on meshes: exact places on known shapes, and never inside."""

import math
from random import Random

import igl
import meshes
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from forcebound.haptics.geometry.bounding_volumes import TriangleTree
from forcebound.haptics.geometry.god_object import AWAY, MeshSolid
from forcebound.haptics.geometry.vectors import Vector3, dot, norm, scale, sub, unit

HALF = 0.0625  # m, of the edge of the box
NM = 1e-7  # m, far above the clearance, far below what a hand feels


@pytest.fixture(scope="module")
def box() -> MeshSolid:
    return meshes.solid(meshes.box())


def test_the_proxy_stays_on_a_face_below_which_the_goal_is(box: MeshSolid) -> None:
    proxy, normal = box.slide((0.08, 0.0, 0.0), (0.05, 0.0, 0.0))
    proxy, normal = box.slide(proxy, (0.05, 0.02, -0.01))
    assert proxy == pytest.approx((HALF, 0.02, -0.01), abs=NM)
    assert normal == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)


def test_in_free_space_the_proxy_is_the_goal(box: MeshSolid) -> None:
    goal = (0.07, 0.08, -0.09)
    assert box.slide((0.08, 0.0, 0.0), goal) == (goal, None)
    assert box.slide(goal, goal) == (goal, None)


def test_the_proxy_slides_off_an_edge_and_is_free(box: MeshSolid) -> None:
    proxy, goal = (0.08, 0.0, 0.0), (0.05, 0.0, 0.0)
    for k in range(80):
        goal = (0.05, 0.001 * k, 0.0)
        proxy, normal = box.slide(proxy, goal)
        assert (normal is None) == (goal[1] > HALF)
    assert proxy == goal


@pytest.mark.parametrize(
    ("goal", "expected"),
    [
        ((0.1, 0.01, 0.02), (HALF, 0.01, 0.02)),  # a face
        ((0.1, 0.09, 0.02), (HALF, HALF, 0.02)),  # an edge of two
        ((0.1, 0.09, -0.2), (HALF, HALF, -HALF)),  # a corner of three
    ],
)
def test_inside_a_room_the_proxy_comes_to_wall_edge_and_corner_in_one_answer(
    box: MeshSolid, goal: Vector3, expected: Vector3
) -> None:
    proxy, normal = box.slide((0.0, 0.0, 0.0), goal)
    assert proxy == pytest.approx(expected, abs=NM)
    assert normal == pytest.approx(unit(sub(expected, goal)), abs=1e-4)


@pytest.mark.parametrize("thickness", [1e-3, 1e-6, 0.0])
@pytest.mark.parametrize("speed", [1e-4, 0.03, 10.0])  # m per question
def test_nothing_pops_through_a_thin_plate(thickness: float, speed: float) -> None:
    plate = meshes.solid(meshes.box(0.05, 0.05, 0.5 * thickness))
    proxy, depth = (0.01, 0.01, 0.02), 0.0
    for k in range(20):
        goal = (0.01, 0.01, 0.02 - speed * (k + 1))
        proxy, normal = plate.slide(proxy, goal)
        if goal[2] < 0.5 * thickness:
            depth = norm(sub(proxy, goal))
            assert depth == pytest.approx(0.5 * thickness - goal[2], abs=NM)
            assert normal == pytest.approx((0.0, 0.0, 1.0), abs=1e-5)


def test_the_groove_of_two_slopes_holds_the_proxy_in_its_edge() -> None:
    outline = [(0.0, 0.01), (-0.04, 0.05), (-0.04, -0.03), (0.04, -0.03), (0.04, 0.05)]
    groove = meshes.solid(meshes.prism(outline, 0.05))  # a valley of 90 degrees at x = 0, y = 0.01
    proxy, _ = groove.slide((0.01, 0.05, 0.0), (0.01, -0.02, 0.01))
    assert proxy == pytest.approx((0.0, 0.01, 0.01), abs=NM)
    proxy, normal = groove.slide(proxy, (0.02, 0.01, 0.02))  # below one slope alone
    assert proxy == pytest.approx((0.01, 0.02, 0.02), abs=NM)
    assert normal == pytest.approx((-math.sqrt(0.5), math.sqrt(0.5), 0.0), abs=1e-4)


@pytest.mark.parametrize("degrees", [10, 45, 90, 150])
def test_on_a_wedge_the_depth_is_that_of_its_side(degrees: int) -> None:
    slope = math.radians(degrees) / 2.0
    x, y = 0.05 * math.cos(slope), 0.05 * math.sin(slope)
    wedge = meshes.solid(meshes.prism([(0.0, 0.0), (x, -y), (x, y)], 0.05))
    goal = (0.02, 0.25 * 0.02 * math.tan(slope), 0.0)  # nearer to the upper side
    proxy, normal = wedge.slide((0.0, 0.06, 0.0), goal)
    depth = 0.75 * 0.02 * math.tan(slope) * math.cos(slope)
    assert norm(sub(proxy, goal)) == pytest.approx(depth, rel=1e-4)
    assert normal == pytest.approx((-math.sin(slope), math.cos(slope), 0.0), abs=1e-4)


def test_depth_and_direction_on_a_sphere_are_exact_within_its_facets() -> None:
    radius = 0.05
    vertices, faces = meshes.sphere(radius, 6)
    ball = meshes.solid((vertices, faces))
    edges = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
    tilt = np.linalg.norm(edges, axis=2).max() / math.sqrt(3.0) / radius  # rad, of a facet
    low = radius * (1.0 - math.cos(tilt))  # m, of a facet below the sphere
    assert tilt < 0.025
    random = Random(2)
    for _ in range(100):
        direction = unit((random.gauss(0, 1), random.gauss(0, 1), random.gauss(0, 1)))
        goal = scale(direction, radius - 0.004)
        proxy, normal = ball.slide(scale(direction, 0.06), goal)
        assert normal is not None
        assert norm(sub(proxy, goal)) == pytest.approx(0.004, abs=low + NM)
        assert math.acos(min(1.0, dot(normal, direction))) < tilt + 1e-6
        assert ball.distance(goal) == pytest.approx(-0.004, abs=low + NM)
        assert ball.distance(scale(direction, 0.06)) == pytest.approx(0.01, abs=low + NM)


def test_from_far_away_the_proxy_stops_where_it_does_from_near(box: MeshSolid) -> None:
    proxy, normal = box.slide((10.0, 0.0, 0.0), (-10.0, 0.05, 0.0))
    assert proxy[0] == pytest.approx(HALF, abs=NM)
    assert normal is not None
    assert box.slide((10.0, 1.0, 0.0), (-10.0, 1.0, 0.0)) == ((-10.0, 1.0, 0.0), None)
    assert box.slide(proxy, (0.05, 0.02, -0.01))[0] == pytest.approx((HALF, 0.02, -0.01), abs=NM)


@pytest.mark.parametrize("count", [1, 4])  # subdivisions
def test_inside_is_what_the_winding_number_says(count: int) -> None:
    vertices, faces = meshes.bumpy(count)
    ball = meshes.solid((vertices, faces))
    random = np.random.default_rng(1)
    places = random.uniform(-0.07, 0.07, (1000, 3))
    aimed = np.array(vertices)[random.integers(len(vertices), size=300)]  # rays that meet a corner
    places = np.concatenate(
        [places, aimed - np.array(AWAY[0]) * random.uniform(1e-3, 0.02, (300, 1))]
    )
    around = igl.winding_number(vertices, faces, places)
    ours = np.array([ball.distance((x, y, z)) < 0.0 for x, y, z in places.tolist()])
    assert (ours == (around > 0.5)).all()
    assert 100 < ours.sum() < 1200


def walk(solid: MeshSolid, ticks: int, step: float, pull: float, seed: int) -> list[Vector3]:
    """The proxies of a goal that walks at random, drawn to the middle; every tenth."""
    random = Random(seed)
    goal = proxy = (0.7 * solid.tree.size, 0.0, 0.0)
    proxies = []
    for tick in range(ticks):
        x, y, z = (one + random.gauss(0.0, step) - pull * one for one in goal)
        goal = (x, y, z)
        proxy, _ = solid.slide(proxy, goal)
        if tick % 10 == 0:
            proxies.append(proxy)
    return proxies


def never_inside(mesh: meshes.Mesh, proxies: list[Vector3]) -> None:
    vertices, faces = mesh
    around = igl.winding_number(vertices, faces, np.array(proxies))
    assert np.abs(around).max() < 1e-6


@pytest.mark.parametrize(("step", "pull"), [(1e-3, 1e-3), (2e-2, 0.1)])  # m a tick; share
@pytest.mark.parametrize("mesh", [meshes.box(), meshes.box(z=1e-6), meshes.bumpy(4)])
def test_a_random_walk_never_gets_inside(mesh: meshes.Mesh, step: float, pull: float) -> None:
    never_inside(mesh, walk(meshes.solid(mesh), 5000, step, pull, seed=3))


@pytest.mark.slow
def test_a_long_random_walk_never_gets_inside() -> None:
    mesh = meshes.bumpy(5)
    never_inside(mesh, walk(meshes.solid(mesh), 100_000, 1e-3, 1e-3, seed=4))


coordinate = st.integers(-4, 4).map(lambda n: 0.25 * n)
corner = st.tuples(coordinate, coordinate, coordinate)


@settings(max_examples=100)
@given(
    st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=12),
    st.lists(st.tuples(*[st.floats(-2.0, 2.0)] * 3), min_size=1, max_size=10),
)
def test_any_triangles_hold_the_proxy_and_give_numbers(
    triangles: list[tuple[Vector3, Vector3, Vector3]], goals: list[Vector3]
) -> None:
    """Slivers, points, lines, the same twice: the way of the proxy crosses none of them."""
    corners = np.array(triangles)
    assume(np.ptp(corners) > 0.0)
    solid = MeshSolid(TriangleTree(corners), is_closed=False)
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    proxy: Vector3 = (3.0, 0.1, 0.2)
    for goal in goals:
        proxy, normal = solid.slide(proxy, goal)
        assert all(map(math.isfinite, proxy))
        square, _, _ = igl.point_mesh_squared_distance(
            np.array([proxy]), corners.reshape(-1, 3), faces
        )
        assert math.sqrt(square[0]) > 0.4 * solid.clearance or normal is None
        assert normal is None or norm(normal) == pytest.approx(1.0)
