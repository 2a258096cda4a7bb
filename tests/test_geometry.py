import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forcebound.haptics.geometry import planes, vectors
from forcebound.haptics.geometry.planes import closest_legal
from forcebound.haptics.geometry.vectors import Vector3

_numbers = st.floats(-1.0, 1.0)
_points = st.tuples(_numbers, _numbers, _numbers)


def _turned(angle: float) -> vectors.Quaternion:
    return (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))


def test_a_quarter_turn_about_z_takes_x_to_y_and_back() -> None:
    quarter = _turned(math.pi / 2)
    assert vectors.rotate(quarter, (1.0, 0.0, 0.5)) == pytest.approx((0.0, 1.0, 0.5))
    assert vectors.rotate_back(quarter, (0.0, 1.0, 0.5)) == pytest.approx((1.0, 0.0, 0.5))


@pytest.mark.parametrize("axes", range(1, 7))
def test_a_vector_of_any_number_of_axes_goes_to_space_and_back(axes: int) -> None:
    vector = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)[:axes]
    there = vectors.pad3(vector)
    assert there == (1.0, 2.0 if axes > 1 else 0.0, 3.0 if axes > 2 else 0.0)
    assert vectors.cut(there, axes) == (*vector[:3], 0.0, 0.0, 0.0)[:axes]


@pytest.mark.parametrize(
    ("goal", "corner"),
    [
        ((0.0, 0.0, 0.0), (0.1, 0.2, 0.3)),
        ((0.0, 0.5, 0.0), (0.1, 0.5, 0.3)),
        ((0.0, 0.5, 0.7), (0.1, 0.5, 0.7)),
        ((0.2, 0.5, 0.7), (0.2, 0.5, 0.7)),
    ],
)
def test_all_walls_that_a_goal_is_behind_hold_it_back(goal: Vector3, corner: Vector3) -> None:
    walls = np.array([[1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 1, 0.3]], float)
    found, point = closest_legal(goal, walls, 3)
    assert found
    assert point == pytest.approx(corner)


def test_planes_that_contradict_each_other_are_told() -> None:
    walls = np.array([[1, 0, 0, 0.1], [-1, 0, 0, 0.1]], float)
    assert not closest_legal((0.0, 0.0, 0.0), walls, 2)[0]


@given(st.lists(st.tuples(_points, _points), min_size=1, max_size=6), _points)
def test_nothing_legal_is_closer(rows: list[tuple[Vector3, Vector3]], goal: Vector3) -> None:
    # Planes beside the origin, which therefore is legal.
    known = [(vectors.unit(n), abs(offset[0])) for n, offset in rows if vectors.norm(n) > 0.1]
    table = np.array([[*n, -offset] for n, offset in known]).reshape(-1, 4)
    found, point = closest_legal(goal, table, len(table), 1e-9)
    assert found
    assert planes.is_legal(point, table, len(table), 1e-9)
    # Of a convex set: the angle at the closest point to any other is not acute.
    away = vectors.sub(goal, point)
    for other in np.random.default_rng(1).uniform(-1.0, 1.0, (50, 3)):
        if planes.is_legal(tuple(other), table, len(table), 0.0):
            assert vectors.dot(away, vectors.sub(tuple(other), point)) <= 1e-6
