"""The proxy of a hand on a triangle mesh: a god-object that stays outside.

The proxy is the centre of a ball so small that nobody feels it: its *clearance*, 1e-7 of the mesh.
It moves in straight lines, each of which is tested against the whole mesh, so speed does not help
to get through, nor does a plate without thickness. Towards a goal:

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

import copy
import math
from typing import Any

import numpy as np

from forcebound.compiled import jit, outlined
from forcebound.haptics.geometry.bounding_volumes import (
    NOTHING,
    STACK,
    WIDTH,
    Tree,
    TriangleTree,
    closest_on,
    first_contact,
    push_children_near,
    triangles_of_leaf,
)
from forcebound.haptics.geometry.mesh_file import Mesh, smoothed
from forcebound.haptics.geometry.planes import closest_legal
from forcebound.haptics.geometry.triangles import Triangles, corner, is_over
from forcebound.haptics.geometry.vectors import (
    Quaternion,
    Vector3,
    along,
    cross,
    dot,
    norm,
    rotate,
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
FAR = 1e3  # sizes of the mesh; a goal beyond is taken to be there


class MeshSolid:
    """A triangle mesh, counter-clockwise as seen from outside, as a :class:`..proxy.Solid`.

    Without an inside distances are positive, and the proxy stays on its side of the triangles.
    ``normals`` are smoothed unit normals of the three corners of each triangle, in the order that
    the tree was made of, shape (n, 3, 3); None: there is no shading.
    """

    def __init__(self, tree: TriangleTree, is_closed: bool, normals: Any = None) -> None:
        self.tree = tree
        self.clearance = CLEARANCE * tree.size
        self._is_closed = is_closed
        self._normals = None if normals is None else normals[tree.order]
        self._slide, self._pseudonormal = jit(slide), jit(pseudonormal)
        start = (float(tree.highest[0]) + tree.size, 0.0, 0.0)
        self.slide(start, start)  # compiles
        self.closest(start)

    def own(self) -> "MeshSolid":
        """Return the same solid with a tree of its own, as each user needs it."""
        other = copy.copy(self)
        other.tree = copy.copy(self.tree)
        return other

    def slide(self, proxy: Vector3, goal: Vector3) -> tuple[Vector3, Vector3 | None]:
        place, normal, is_free = self._slide(self.tree.data, proxy, goal, self.clearance)
        return (goal, None) if is_free else (place, normal)

    def distance(self, point: Vector3) -> float:
        _, at, distance = self.tree.closest(point)
        if self._is_closed and dot(sub(point, at), self._normal_at(at)) < 0.0:
            return -distance
        return distance

    def closest(self, point: Vector3) -> tuple[Vector3, Vector3]:
        _, at, _ = self.tree.closest(point)
        normal = self._normal_at(at)
        if not self._is_closed and dot(sub(point, at), normal) < 0.0:
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

    def _normal_at(self, at: Vector3) -> Vector3:
        return self._pseudonormal(self.tree.data, at, 0.01 * self.clearance)


def placed(mesh: Mesh, position: Vector3, orientation: Quaternion, is_shaded: bool) -> MeshSolid:
    """Return a mesh, turned by a unit quaternion and then moved (m), as a solid."""
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    axes = np.array([rotate(orientation, axis) for axis in (x, y, z)])
    tree = TriangleTree(mesh.corners @ axes + position)
    normals = smoothed(mesh) @ axes.astype(np.float32) if is_shaded else None
    return MeshSolid(tree, mesh.is_closed, normals)


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
    tree: Tree, proxy: Vector3, goal: Vector3, clearance: float
) -> tuple[Vector3, Vector3, bool]:
    """Return where the proxy comes to, the normal there, and whether it reached the goal."""
    normal = (0.0, 0.0, 0.0)
    is_near, place, goal = _entered(tree.nodes, proxy, goal, clearance)
    if not is_near:
        return goal, normal, True
    nearest, idle = math.inf, 0
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


@outlined
def _entered(
    nodes: Any, proxy: Vector3, goal: Vector3, clearance: float
) -> tuple[bool, Vector3, Vector3]:
    """Return whether the way meets the box around the mesh, where it does, and a goal not too far.

    Numbers beyond are too large for small distances.
    """
    way = sub(goal, proxy)
    first, last, size = 0.0, 1.0, 0.0
    for axis in range(3):
        low, high = NOTHING, -NOTHING
        for child in range(WIDTH):
            low = min(low, 1.0 * nodes[0, axis, child])
            high = max(high, 1.0 * nodes[0, 3 + axis, child])
        size = max(size, high - low)
        low, high = low - 4.0 * clearance, high + 4.0 * clearance
        if way[axis] == 0.0:
            if proxy[axis] < low or proxy[axis] > high:
                return False, proxy, goal
            continue
        one, other = (low - proxy[axis]) / way[axis], (high - proxy[axis]) / way[axis]
        first, last = max(first, min(one, other)), min(last, max(one, other))
    if first > last:
        return False, proxy, goal
    place = along(proxy, way, first)
    left = sub(goal, place)
    return True, place, along(place, left, min(1.0, FAR * size / max(norm(left), 1e-300)))


def pseudonormal(tree: Tree, at: Vector3, reach: float) -> Vector3:
    """Return the outward unit normal at a point of the surface, also at an edge or a corner.

    The sum of the normals of all triangles within ``reach``, weighted by their angles; its sign
    tells on which side of a closed mesh a point is whose closest point is ``at``.

    Source: J. A. Baerentzen, H. Aanaes, Signed distance computation using the angle weighted
    pseudonormal, IEEE TVCG 11(3), 2005.
    """
    stack, total = np.empty(STACK), (0.0, 0.0, 0.0)
    stack[0, 0], stack[1, 0], top = 0.0, 0.0, 1
    while top > 0:
        top -= 1
        node = int(stack[0, top])
        if node < len(tree.nodes):
            top = push_children_near(tree.nodes, node, at, reach * reach, stack, top)
            continue
        first, last = triangles_of_leaf(tree, node)
        for index in range(first, last):
            away = sub(closest_on(tree.triangles, index, at), at)
            if dot(away, away) <= reach * reach:
                angle, normal = _angle_at(tree.triangles, index, at, reach)
                total = along(total, normal, angle)
    return unit(total)


@outlined
def _angle_at(triangles: Triangles, index: int, at: Vector3, reach: float) -> tuple[float, Vector3]:
    """Return the angle that a triangle fills around a point of it, and its unit normal."""
    a, b, c = corner(triangles, index, 0), corner(triangles, index, 1), corner(triangles, index, 2)
    normal = unit(cross(sub(b, a), sub(c, a)))
    for _ in range(3):
        if norm(sub(at, a)) <= reach:
            one, other = sub(b, a), sub(c, a)
            return math.atan2(norm(cross(one, other)), dot(one, other)), normal
        a, b, c = b, c, a
    for _ in range(3):
        edge, from_a = sub(b, a), sub(at, a)
        if norm(cross(edge, from_a)) <= reach * norm(edge):
            return math.pi, normal
        a, b, c = b, c, a
    return 2.0 * math.pi, normal
