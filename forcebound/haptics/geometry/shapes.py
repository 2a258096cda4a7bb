"""Plane, sphere, box and cylinder, added to and removed from each other.

Each shape has its exact signed distance (J. C. Hart, Sphere tracing, The Visual Computer 12, 1996).
In their order, a shape that is added makes the distance the smaller of both, one that is removed
the larger of it and the negative of its distance. The result is never more than the true distance
(A. Ricci, A constructive geometry for computer graphics, The Computer Journal 16(2), 1973).
"""

import math
from typing import Any

from forcebound.compiled import outlined
from forcebound.haptics.geometry.implicit import Field
from forcebound.haptics.geometry.vectors import Vector3, rotate, rotate_back, scale, sub

PLANE, SPHERE, BOX, CYLINDER = 0.0, 1.0, 2.0, 3.0
#: Row of a shape: kind; 1 if it is removed, else 0; position; orientation w x y z; size x y z (m).
#: Size: of a sphere the radius; of a box half its edges; of a cylinder radius and half its length.
COLUMNS = 12


def _corner_distance(x: float, y: float, z: float, is_removed: bool) -> float:
    """Distance to a box's surface from the excess over each of its half edges.

    The edges of what is removed are hollow: behind them each face counts for itself.
    """
    if is_removed:
        return max(x, max(y, z))
    out_x, out_y, out_z = max(x, 0.0), max(y, 0.0), max(z, 0.0)
    outside = math.sqrt(out_x * out_x + out_y * out_y + out_z * out_z)
    return outside + min(max(x, max(y, z)), 0.0)


def _in_shape(shapes: Any, row: int, point: Vector3) -> Vector3:
    """Return a point in the coordinates of a shape."""
    position = (shapes[row, 2], shapes[row, 3], shapes[row, 4])
    turn = (shapes[row, 5], shapes[row, 6], shapes[row, 7], shapes[row, 8])
    return rotate_back(turn, sub(point, position))


def shape_distance(shapes: Any, row: int, point: Vector3) -> float:
    """Return the signed distance to one shape, in m."""
    x, y, z = _in_shape(shapes, row, point)
    kind, is_removed = shapes[row, 0], shapes[row, 1] > 0.0
    if kind == PLANE:
        return z
    radius: float = shapes[row, 9]
    if kind == SPHERE:
        return math.sqrt(x * x + y * y + z * z) - radius
    if kind == BOX:
        return _corner_distance(
            abs(x) - shapes[row, 9], abs(y) - shapes[row, 10], abs(z) - shapes[row, 11], is_removed
        )
    radial = math.sqrt(x * x + y * y) - radius
    return _corner_distance(radial, abs(z) - shapes[row, 10], -math.inf, is_removed)


def _corner_gradient(x: float, y: float, z: float, is_removed: bool) -> Vector3:
    """Gradient of ``_corner_distance``; on an edge, of the face that it is least behind."""
    out_x, out_y, out_z = max(x, 0.0), max(y, 0.0), max(z, 0.0)
    outside = math.sqrt(out_x * out_x + out_y * out_y + out_z * out_z)
    if outside > 0.0 and not is_removed:
        return (out_x / outside, out_y / outside, out_z / outside)
    if x >= y and x >= z:
        return (1.0, 0.0, 0.0)
    return (0.0, 1.0, 0.0) if y >= z else (0.0, 0.0, 1.0)


@outlined
def shape_gradient(shapes: Any, row: int, point: Vector3) -> Vector3:
    """Return the gradient of the distance to one shape, of length 1."""
    x, y, z = _in_shape(shapes, row, point)
    kind, is_removed = shapes[row, 0], shapes[row, 1] > 0.0
    if kind == PLANE:
        normal = (0.0, 0.0, 1.0)
    elif kind == SPHERE:
        length = math.sqrt(x * x + y * y + z * z)
        normal = (x / length, y / length, z / length) if length > 0.0 else (0.0, 0.0, 1.0)
    elif kind == BOX:
        u, v, w = _corner_gradient(
            abs(x) - shapes[row, 9], abs(y) - shapes[row, 10], abs(z) - shapes[row, 11], is_removed
        )
        normal = (math.copysign(u, x), math.copysign(v, y), math.copysign(w, z))
    else:
        across = math.sqrt(x * x + y * y)
        u, v, w = _corner_gradient(
            across - shapes[row, 9], abs(z) - shapes[row, 10], -math.inf, is_removed
        )
        cosine, sine = (x / across, y / across) if across > 0.0 else (1.0, 0.0)
        normal = (u * cosine, u * sine, math.copysign(v, z))
    turn = (shapes[row, 5], shapes[row, 6], shapes[row, 7], shapes[row, 8])
    return rotate(turn, normal)


@outlined
def nearest_shape(shapes: Any, point: Vector3) -> tuple[float, int]:
    """Return the distance to all shapes together, and the row of the one that it comes from."""
    distance, nearest = math.inf, 0
    for row in range(shapes.shape[0]):
        signed = shape_distance(shapes, row, point)
        if shapes[row, 1] > 0.0:
            if -signed > distance:
                distance, nearest = -signed, row
        elif signed < distance:
            distance, nearest = signed, row
    return distance, nearest


def distance(shapes: Any, point: Vector3) -> float:
    """Return the signed distance to all shapes together, or less."""
    return nearest_shape(shapes, point)[0]


def gradient(shapes: Any, point: Vector3) -> Vector3:
    """Return the gradient of that distance, of length 1."""
    _, row = nearest_shape(shapes, point)
    return scale(shape_gradient(shapes, row, point), 1.0 - 2.0 * shapes[row, 1])


SHAPES = Field(distance, gradient, gradient)
