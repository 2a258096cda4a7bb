"""The proxy of a hand on a triangle mesh: a god-object that stays outside.

The proxy is the centre of a ball so small that nobody feels it: its *clearance*, 1e-7 of the mesh.
It moves in straight lines, each of which is tested against the whole mesh, so within
10 m of it speed does not help to get through, nor does a plate without thickness. Towards a goal:

1. Move until the ball touches a triangle (:func:`first_contact`). Add the plane between the two to
   the planes of this sweep: that of the triangle, or across an edge or a corner.
2. The new target is the point closest to the goal that is behind none of the planes, all of them
   at once (:func:`closest_legal`): on a face, in an edge where two meet, or in a corner of three.
3. Move on towards the target. Where nothing is in the way, begin a new sweep without planes, since
   those of triangles that were left behind hold no more. End when a sweep moves nothing, or two
   bring the proxy no nearer.

A ball is never moved to where it would be nearer to a triangle than half of its clearance. In
doubt (planes that contradict each other, in a crack) it stays. Rounding is 1e-16 of the mesh, nine
powers of ten below the clearance.

Sources: C. Zilles, J. K. Salisbury, A constraint-based god-object method for haptic display, IROS
1995; D. C. Ruspini, K. Kolarov, O. Khatib, The haptic display of complex graphical environments,
SIGGRAPH 1997; M. Ortega, S. Redon, S. Coquillart, A six degree-of-freedom god-object method for
haptic display of rigid bodies with surface properties, IEEE TVCG 13(3), 2007.
"""

import math
from typing import Any

import numpy as np

from forcebound.compiled import jit, outlined
from forcebound.haptics.geometry.bounding_volumes import (
    Tree,
    TriangleTree,
    closest_on,
    first_contact,
)
from forcebound.haptics.geometry.mesh_file import Mesh, smoothed
from forcebound.haptics.geometry.planes import closest_legal
from forcebound.haptics.geometry.triangles import Triangles, corner, is_over
from forcebound.haptics.geometry.vectors import (
    Vector3,
    along,
    cross,
    dot,
    norm,
    scale,
    sub,
    unit,
)

CLEARANCE = 1e-7  # of the mesh's size
PLANES = 8  # of a sweep at most
SLACK = 1e-6  # of the clearance, by which a point may be behind a plane: rounding
SWEEPS = 64  # of a question at most; what is left is done in the next
SHADED = 0.94  # cosine of 20 degrees, half of a crease: the proxy lies on one smooth face
IDLE = 2  # sweeps that bring nothing before it is enough: where many planes meet, each finds others
STILL = 1e-3  # of the clearance: a shorter move is none
# Directions that no edge of a mesh is likely to have. A ray that meets an edge or a corner may slip
# between its triangles by rounding; two do not at the same point.
AWAY = ((0.5419, 0.6127, 0.5753), (-0.7213, 0.2971, 0.6257), (0.1409, -0.8377, 0.5277))


class MeshSolid:
    """A triangle mesh, counter-clockwise as seen from outside: a :class:`.proxy.Solid`.

    Without an inside distances are positive, and the proxy stays on its side of the triangles.
    ``normals`` are smoothed unit normals of the three corners of each triangle, in the order that
    the tree was made of, shape (n, 3, 3); None: there is no shading.
    """

    def __init__(self, tree: TriangleTree, is_closed: bool, normals: Any = None) -> None:
        self.tree = tree
        self.clearance = CLEARANCE * tree.size
        self._is_closed = is_closed
        self._normals = None if normals is None else normals[tree.order]
        self._slide = jit(slide)
        start = (float(tree.highest[0]) + tree.size, 0.0, 0.0)
        self.slide(start, start)  # compiles
        self.closest(start)

    @classmethod
    def of(cls, mesh: Mesh) -> "MeshSolid":
        """Return a mesh as a solid that can be shaded."""
        return cls(TriangleTree(mesh.corners), mesh.is_closed, smoothed(mesh))

    def slide(self, proxy: Vector3, goal: Vector3) -> tuple[Vector3, Vector3 | None]:
        place, normal, is_free = self._slide(*self.tree.data, proxy, goal, self.clearance)
        return (goal, None) if is_free else (place, normal)

    def distance(self, point: Vector3) -> float:
        _, _, distance = self.tree.closest(point)
        return -distance if self._is_inside(point) else distance

    def closest(self, point: Vector3) -> tuple[Vector3, Vector3]:
        index, at, _ = self.tree.closest(point)
        normal, _ = separation(self.tree.data.triangles, index, point)
        if self._is_inside(point):
            normal = scale(normal, -1.0)
        return along(at, normal, 2.0 * self.clearance), normal

    def shade(self, point: Vector3, normal: Vector3) -> Vector3:
        """Return the normal between the smoothed ones of the triangle's corners.

        Where the proxy lies on several faces that meet at a sharp edge, ``normal`` stays.
        """
        if self._normals is None:
            return normal
        place, at, _ = self.tree.closest(point)
        a, b, c = (corner(self.tree.data.triangles, place, k) for k in range(3))
        x, y, z = (barycentric(at, a, b, c) @ self._normals[place]).tolist()
        smooth, side = unit((x, y, z)), dot(unit(cross(sub(b, a), sub(c, a))), normal)
        if not self._is_closed and side < 0.0:
            smooth, side = scale(smooth, -1.0), -side
        return smooth if side > SHADED else normal

    def _is_inside(self, point: Vector3) -> bool:
        """Return whether two of three straight lines lead out of the solid."""
        if not self._is_closed:
            return False
        first, second = (self._leads_out(point, away) for away in AWAY[:2])
        return first if first == second else self._leads_out(point, AWAY[2])

    def _leads_out(self, point: Vector3, away: Vector3) -> bool:
        """Return whether a straight line leaves the first triangle that it meets from behind."""
        reach = math.dist(point, self.tree.lowest) + self.tree.size
        index, _ = self.tree.first_contact(point, along(point, away, reach))
        if index < 0:
            return False
        a, b, c = (corner(self.tree.data.triangles, index, k) for k in range(3))
        return dot(cross(sub(b, a), sub(c, a)), away) > 0.0


def barycentric(point: Vector3, a: Vector3, b: Vector3, c: Vector3) -> Any:
    """Return the weights of the corners at a point of a triangle, shape (3,)."""
    normal = cross(sub(b, a), sub(c, a))
    area = dot(normal, normal)
    if area == 0.0:
        return np.full(3, 1.0 / 3.0)
    second = dot(cross(sub(point, a), sub(c, a)), normal) / area
    third = dot(cross(sub(b, a), sub(point, a)), normal) / area
    return np.array((1.0 - second - third, second, third))


def slide(
    nodes: Any, triangles: Triangles, depth: int, proxy: Vector3, goal: Vector3, clearance: float
) -> tuple[Vector3, Vector3, bool]:
    """Return where the proxy comes to, the normal there, and whether it reached the goal.

    The parts of a :class:`Tree` come one by one: numba takes over a named tuple slowly.
    """
    tree, normal = Tree(nodes, triangles, depth), (0.0, 0.0, 0.0)
    place, nearest, idle = proxy, math.inf, 0
    for _ in range(SWEEPS):
        before = place
        place, normal, count = _sweep(tree, before, goal, clearance)
        if count == 0:
            return goal, normal, True
        distance = norm(sub(place, goal))
        if distance < nearest - STILL * clearance:
            nearest, idle = distance, 0
        else:
            idle += 1
        if idle == IDLE or norm(sub(place, before)) <= STILL * clearance:
            break
    pull = sub(place, goal)
    if norm(pull) > 10.0 * clearance:
        normal = unit(pull)
    return place, normal, False


def _sweep(
    tree: Tree, before: Vector3, goal: Vector3, clearance: float
) -> tuple[Vector3, Vector3, int]:
    """Return where a sweep ends, the normal of the last plane, and how many planes there were."""
    planes = np.empty((PLANES, 4))
    place, target, normal, count = before, goal, (0.0, 0.0, 0.0), 0
    while count < PLANES:
        index, time = first_contact(tree, place, target, clearance)
        if index < 0:
            return target, normal, count
        place = along(place, sub(target, place), time)
        normal, gap = separation(tree.triangles, index, place)
        planes[count, 0], planes[count, 1], planes[count, 2] = normal
        # Seen from where the sweep began: there numbers are small.
        planes[count, 3] = clearance - gap + dot(normal, sub(place, before))
        count += 1
        is_found, offset = closest_legal(sub(goal, before), planes, count, SLACK * clearance)
        target = along(before, offset, 1.0)
        if not is_found or norm(sub(target, place)) <= STILL * clearance:
            break
    return place, normal, count


@outlined
def separation(triangles: Triangles, index: int, place: Vector3) -> tuple[Vector3, float]:
    """Return the unit normal of the plane between a triangle and a place, and their distance."""
    a, b, c = corner(triangles, index, 0), corner(triangles, index, 1), corner(triangles, index, 2)
    face = cross(sub(b, a), sub(c, a))
    if dot(face, face) > 0.0 and is_over(place, a, b, c, face):
        normal = unit(face)
        height = dot(sub(place, a), normal)
        return (normal, height) if height >= 0.0 else (scale(normal, -1.0), -height)
    away = sub(place, closest_on(triangles, index, place))
    return unit(away), norm(away)
