"""The point of a corner: the closest one to a goal that is behind none of several planes."""

from typing import Any, TypeAlias

from forcebound.compiled import outlined
from forcebound.haptics.geometry.vectors import Vector3, along, cross, dot, scale

#: Rows of a plane ``n . y >= offset``: unit normal into the legal side, offset (m); shape (n, 4).
Planes: TypeAlias = Any

SLACK = 1e-12  # m, by which a point may be behind a plane: rounding
PARALLEL = 1e-9  # smallest determinant of normals that meet in an edge or a corner


def normal_of(planes: Planes, row: int) -> Vector3:
    """Return the normal of one plane."""
    return (planes[row, 0], planes[row, 1], planes[row, 2])


@outlined
def is_legal(point: Vector3, planes: Planes, count: int, slack: float) -> bool:
    """Return whether a point is behind none of the first ``count`` planes."""
    behind = 0
    for row in range(count):
        behind += dot(normal_of(planes, row), point) < planes[row, 3] - slack
    return behind == 0


def onto_plane(goal: Vector3, planes: Planes, row: int) -> tuple[bool, Vector3]:
    """Return whether one plane holds the goal back, and the goal's closest point on it."""
    normal = normal_of(planes, row)
    depth = planes[row, 3] - dot(normal, goal)
    return depth >= 0.0, along(goal, normal, depth)


@outlined
def onto_edge(goal: Vector3, planes: Planes, a: int, b: int) -> tuple[bool, Vector3]:
    """Return whether two planes hold the goal back, and its closest point on their edge."""
    n, m = normal_of(planes, a), normal_of(planes, b)
    both = dot(n, m)
    determinant = 1.0 - both * both
    if determinant < PARALLEL:
        return False, goal
    r, s = planes[a, 3] - dot(n, goal), planes[b, 3] - dot(m, goal)
    push_n, push_m = (r - both * s) / determinant, (s - both * r) / determinant
    return push_n >= 0.0 and push_m >= 0.0, along(along(goal, n, push_n), m, push_m)


@outlined
def onto_corner(goal: Vector3, planes: Planes, a: int, b: int, c: int) -> tuple[bool, Vector3]:
    """Return whether three planes hold the goal back, and their corner."""
    n, m, k = normal_of(planes, a), normal_of(planes, b), normal_of(planes, c)
    determinant = dot(n, cross(m, k))
    if abs(determinant) < PARALLEL:
        return False, goal
    reciprocal_n, reciprocal_m, reciprocal_k = cross(m, k), cross(k, n), cross(n, m)
    from_goal = scale(
        along(
            along(
                scale(reciprocal_n, planes[a, 3] - dot(n, goal)),
                reciprocal_m,
                planes[b, 3] - dot(m, goal),
            ),
            reciprocal_k,
            planes[c, 3] - dot(k, goal),
        ),
        1.0 / determinant,
    )
    # Multipliers: the way from the goal as a sum of pushes along the three normals.
    is_held = (
        dot(from_goal, reciprocal_n) / determinant >= 0.0
        and dot(from_goal, reciprocal_m) / determinant >= 0.0
        and dot(from_goal, reciprocal_k) / determinant >= 0.0
    )
    return is_held, along(goal, from_goal, 1.0)


@outlined
def closest_legal(
    goal: Vector3, planes: Planes, count: int, slack: float = SLACK
) -> tuple[bool, Vector3]:
    """Return the point behind none of the first ``count`` planes that is closest to ``goal``.

    It minimises ``|y - goal|`` with ``n_i . y >= offset_i``: the proxy of a god-object among its
    active constraints. Every set of one, two or three planes is tried, so a dozen planes are the
    most; of a convex problem at most one of them holds the goal back from the outside of all
    planes. False: the planes contradict each other, to rounding.

    Source: C. Zilles, J. K. Salisbury, A constraint-based god-object method for haptic display,
    IROS 1995; D. C. Ruspini, K. Kolarov, O. Khatib, The haptic display of complex graphical
    environments, SIGGRAPH 1997.
    """
    if is_legal(goal, planes, count, slack):
        return True, goal
    for a in range(count):
        is_held, point = onto_plane(goal, planes, a)
        if is_held and is_legal(point, planes, count, slack):
            return True, point
    for a in range(count):
        for b in range(a):
            is_held, point = onto_edge(goal, planes, a, b)
            if is_held and is_legal(point, planes, count, slack):
                return True, point
    for a in range(count):
        for b in range(a):
            for c in range(b):
                is_held, point = onto_corner(goal, planes, a, b, c)
                if is_held and is_legal(point, planes, count, slack):
                    return True, point
    return False, goal
