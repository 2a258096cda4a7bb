"""Distances of points and segments to one triangle.

Every function holds for slivers and for triangles without area, which count as their edges: a
distance is off by rounding alone, about 1e-16 of the lengths.
"""

import math
from typing import Any, TypeAlias

from forcebound.compiled import outlined
from forcebound.haptics.geometry.vectors import Vector3, along, cross, dot, norm, sub

#: Corners of triangles, in m, in single precision: a, b, c of each as 9 numbers; shape (n, 9).
Triangles: TypeAlias = Any

BISECTIONS = 60  # at most, of the time of a contact
NEAR = 1.001  # times the clearance: near enough of a contact


def corner(triangles: Triangles, index: int, which: int) -> Vector3:
    """Return corner 0, 1 or 2 of a triangle."""
    first = 3 * which
    # Both, since float() leaves what it gets in compiled code, and the product does so in Python.
    return (
        1.0 * float(triangles[index, first]),
        1.0 * float(triangles[index, first + 1]),
        1.0 * float(triangles[index, first + 2]),
    )


def closest_on_segment(point: Vector3, start: Vector3, end: Vector3) -> Vector3:
    """Return the point of a segment that is closest to ``point``."""
    move = sub(end, start)
    length = dot(move, move)
    if length == 0.0:
        return start
    return along(start, move, min(max(dot(sub(point, start), move) / length, 0.0), 1.0))


@outlined
def closest_on_triangle(point: Vector3, a: Vector3, b: Vector3, c: Vector3) -> Vector3:
    """Return the point of a triangle that is closest to ``point``.

    It lies on the face, or on an edge beyond which the point is.
    """
    normal = cross(sub(b, a), sub(c, a))
    area = dot(normal, normal)
    best, nearest = a, math.inf
    for one, other in ((a, b), (b, c), (c, a)):
        if area == 0.0 or dot(cross(normal, sub(other, one)), sub(point, one)) < 0.0:
            here = closest_on_segment(point, one, other)
            square = _square(sub(point, here))
            if square < nearest:
                best, nearest = here, square
    if nearest < math.inf:
        return best
    return along(point, normal, -dot(sub(point, a), normal) / area)


def is_over(point: Vector3, a: Vector3, b: Vector3, c: Vector3, normal: Vector3) -> bool:
    """Return whether a point lies over the face: its foot on the plane is in the triangle."""
    return (
        dot(cross(normal, sub(b, a)), sub(point, a)) >= 0.0
        and dot(cross(normal, sub(c, b)), sub(point, b)) >= 0.0
        and dot(cross(normal, sub(a, c)), sub(point, c)) >= 0.0
    )


def _square(a: Vector3) -> float:
    return dot(a, a)


@outlined
def _between_segments(
    start: Vector3, move: Vector3, a: Vector3, edge: Vector3
) -> tuple[float, float]:
    """Return the squared distance of two segments, and where on the first: 0 to 1.

    Source: C. Ericson, Real-time collision detection, 2005, section 5.1.9.
    """
    between = sub(start, a)
    aa, ee, ae = dot(move, move), dot(edge, edge), dot(move, edge)
    ab, eb = dot(move, between), dot(edge, between)
    if aa == 0.0 and ee == 0.0:
        return dot(between, between), 0.0
    across = aa * ee - ae * ae
    time = min(max((ae * eb - ab * ee) / across, 0.0), 1.0) if across > 0.0 else 0.0
    place = (ae * time + eb) / ee if ee > 0.0 else 0.0
    if place < 0.0 or place > 1.0 or ee == 0.0:
        place = min(max(place, 0.0), 1.0)
        time = min(max((ae * place - ab) / aa, 0.0), 1.0) if aa > 0.0 else 0.0
    return _square(along(along(between, move, time), edge, -place)), time


@outlined
def approach(
    start: Vector3, end: Vector3, a: Vector3, b: Vector3, c: Vector3
) -> tuple[float, float]:
    """Return the squared distance of a segment and a triangle, and where on the segment: 0 to 1."""
    move = sub(end, start)
    normal = cross(sub(b, a), sub(c, a))
    before, behind = dot(sub(start, a), normal), dot(sub(end, a), normal)
    if before * behind <= 0.0 and before != behind:
        time = before / (before - behind)
        if is_over(along(start, move, time), a, b, c, normal):
            return 0.0, time
    nearest, when = _square(sub(start, closest_on_triangle(start, a, b, c))), 0.0
    distance = _square(sub(end, closest_on_triangle(end, a, b, c)))
    if distance < nearest:
        nearest, when = distance, 1.0
    for one, other in ((a, b), (b, c), (c, a)):
        distance, time = _between_segments(start, move, one, sub(other, one))
        if distance < nearest:
            nearest, when = distance, time
    return nearest, when


@outlined
def contact_time(
    start: Vector3, end: Vector3, a: Vector3, b: Vector3, c: Vector3, clearance: float
) -> float:
    """Return when a ball that moves from ``start`` (0) to ``end`` (1) touches a triangle; 2: never.

    Its radius is ``clearance``, in m; 0: when the move crosses the triangle. It touches where its
    centre is nearer than that, if the move comes nearer than half of it: what lies between is slack
    for rounding. A ball that is too near already may move if it comes no nearer. At the time
    returned the ball is still free, by 0.1 % of the clearance at most.
    """
    nearest, late = approach(start, end, a, b, c)
    first = norm(sub(start, closest_on_triangle(start, a, b, c)))
    allowed = min(0.5 * clearance, first * (1.0 - 1e-6))
    if nearest > allowed * allowed:
        return 2.0
    if first <= NEAR * clearance:
        return 0.0
    if clearance == 0.0:
        return late
    move, early = sub(end, start), 0.0
    for _ in range(BISECTIONS):  # the distance to what is convex falls until it is least
        time = 0.5 * (early + late)
        centre = along(start, move, time)
        distance = norm(sub(centre, closest_on_triangle(centre, a, b, c)))
        if distance < clearance:
            late = time
        else:
            early = time
            if distance <= NEAR * clearance:
                break
    return early
