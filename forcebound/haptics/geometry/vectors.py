"""Vectors of three numbers, as tuples: in plain Python and in compiled kernels alike."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

Vector3: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]  # w, x, y, z; of unit length

ZERO: Vector3 = (0.0, 0.0, 0.0)
NO_ROTATION: Quaternion = (1.0, 0.0, 0.0, 0.0)


def add(a: Vector3, b: Vector3) -> Vector3:
    """Return ``a + b``."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a: Vector3, b: Vector3) -> Vector3:
    """Return ``a - b``."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vector3, factor: float) -> Vector3:
    """Return ``factor a``."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def along(a: Vector3, direction: Vector3, distance: float) -> Vector3:
    """Return ``a + distance direction``."""
    return (
        a[0] + distance * direction[0],
        a[1] + distance * direction[1],
        a[2] + distance * direction[2],
    )


def dot(a: Vector3, b: Vector3) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector3, b: Vector3) -> Vector3:
    """Return the vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def norm(a: Vector3) -> float:
    """Return the length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def unit(a: Vector3) -> Vector3:
    """Return the vector of length 1 along ``a``; the zero vector if ``a`` has no length."""
    length = norm(a)
    return scale(a, 1.0 / length) if length > 0.0 else (0.0, 0.0, 0.0)


def tangential(a: Vector3, normal: Vector3) -> Vector3:
    """Return the part of ``a`` across a unit normal."""
    return along(a, normal, -dot(a, normal))


def rotate(rotation: Quaternion, a: Vector3) -> Vector3:
    """Return ``a`` turned by a unit quaternion: a body's coordinates in the world."""
    axis = (rotation[1], rotation[2], rotation[3])
    twice = scale(cross(axis, a), 2.0)
    return add(along(a, twice, rotation[0]), cross(axis, twice))


def rotate_back(rotation: Quaternion, a: Vector3) -> Vector3:
    """Return ``a`` turned back by a unit quaternion: the world's coordinates in a body's."""
    return rotate((rotation[0], -rotation[1], -rotation[2], -rotation[3]), a)


def unit_quaternion(rotation: Sequence[float]) -> Quaternion:
    """Return a quaternion (w, x, y, z) of length 1; no rotation if it has no length."""
    w, x, y, z = map(float, rotation)
    length = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / length, x / length, y / length, z / length) if length > 0.0 else NO_ROTATION


def z_onto(normal: Vector3) -> Quaternion:
    """Return the shortest rotation that turns the z axis onto a unit normal."""
    x, y, z = normal
    return unit_quaternion((1.0 + z, -y, x, 0.0) if z > -1.0 else (0.0, 1.0, 0.0, 0.0))


@dataclass(frozen=True)
class Pose:
    """Pose of a body in the world: origin, in m, and axes of its coordinates."""

    position: Vector3 = ZERO
    orientation: Quaternion = NO_ROTATION

    @cached_property
    def _axes(self) -> tuple[Vector3, Vector3, Vector3]:
        x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
        turn = self.orientation
        return rotate(turn, x), rotate(turn, y), rotate(turn, z)

    def turned(self, a: Vector3) -> Vector3:
        """Return a direction in the body in the world's coordinates."""
        # Written out, as below: several times in each answer of a world.
        (a_x, a_y, a_z), (b_x, b_y, b_z), (c_x, c_y, c_z) = self._axes
        u, v, w = a
        return (
            a_x * u + b_x * v + c_x * w,
            a_y * u + b_y * v + c_y * w,
            a_z * u + b_z * v + c_z * w,
        )

    def turned_back(self, a: Vector3) -> Vector3:
        """Return a direction in the world in the body's coordinates."""
        (a_x, a_y, a_z), (b_x, b_y, b_z), (c_x, c_y, c_z) = self._axes
        u, v, w = a
        return (
            a_x * u + a_y * v + a_z * w,
            b_x * u + b_y * v + b_z * w,
            c_x * u + c_y * v + c_z * w,
        )

    def world(self, point: Vector3) -> Vector3:
        """Return a point of the body in the world's coordinates."""
        return add(self.turned(point), self.position)

    def local(self, point: Vector3) -> Vector3:
        """Return a point of the world in the body's coordinates."""
        return self.turned_back(sub(point, self.position))


def pad3(vector: Sequence[float]) -> Vector3:
    """Return a vector of a device of any number of axes in space: zeros where it has no axis."""
    count = len(vector)
    return (vector[0], vector[1] if count > 1 else 0.0, vector[2] if count > 2 else 0.0)


def cut(vector: Vector3, axes: int) -> tuple[float, ...]:
    """Return a vector in space for a device of ``axes`` axes: zeros beyond the third."""
    return vector[:axes] if axes <= 3 else vector + (0.0,) * (axes - 3)
