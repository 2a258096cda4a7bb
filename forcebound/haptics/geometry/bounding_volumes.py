"""Tree of bounding boxes over triangles: closest point, and the first contact of a moving ball.

One question a millisecond finds every cache cold, so a question should touch few lines of memory. A
node holds the boxes of its eight children side by side, 192 bytes: three cache lines. The tree is
balanced, so the places of children and triangles follow from their number alone. Triangles lie in
the order of the leaves; their corners have single precision, which the boxes bound without
rounding, while all arithmetic has double precision.

Source of the wide nodes: I. Wald, C. Benthin, S. Boulos, Getting rid of packets: efficient SIMD
single-ray traversal using multi-branching BVHs, IEEE Symposium on Interactive Ray Tracing, 2008.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from forcebound.compiled import jit, outlined
from forcebound.haptics.geometry.triangles import (
    Triangles,
    closest_on_triangle,
    contact_time,
    corner,
)
from forcebound.haptics.geometry.vectors import Vector3, dot, sub

WIDTH = 8  # children of a node; the loops over them become vector instructions
LEAF = 4  # triangles in a leaf, at most
NOTHING = 1e30  # m, box of no triangles: beyond everything, inside out
MAX_DEPTH = 12
STACK = (3, WIDTH * MAX_DEPTH)  # nodes, their keys; scratch


class Tree(NamedTuple):
    """A tree as the kernels see it."""

    nodes: Any  # lowest x, y, z, then highest, of eight children, m; shape (n, 6, WIDTH)
    triangles: Triangles  # in the order of the leaves
    depth: int  # levels of nodes


class TriangleTree:
    """Triangles, corners in m of shape (n, 3, 3), that answer where they are; see the module."""

    def __init__(self, corners: Any) -> None:
        flat = np.asarray(corners, np.float32).reshape(-1, 9)
        depth = depth_for(len(flat))
        #: Which triangle, counted as given, has a place in the tree.
        self.order = leaf_order(flat.reshape(-1, 3, 3), WIDTH**depth)
        triangles = np.ascontiguousarray(flat[self.order])
        nodes = boxes_around(triangles.reshape(-1, 3, 3), depth)
        self.data = Tree(nodes, triangles, depth)
        self.lowest = np.asarray(nodes[0, :3].min(axis=1), float)
        self.highest = np.asarray(nodes[0, 3:].max(axis=1), float)
        self._closest, self._first_contact = jit(closest), jit(first_contact)

    @property
    def size(self) -> float:
        """Return the diagonal of the box around all triangles, in m."""
        return math.dist(self.lowest, self.highest)

    def closest(self, point: Vector3) -> tuple[int, Vector3, float]:
        """Return place in the tree, closest point (m) and distance of the closest triangle."""
        place, at, square = self._closest(self.data, point)
        return place, at, math.sqrt(square)

    def first_contact(
        self, start: Vector3, end: Vector3, clearance: float = 0.0
    ) -> tuple[int, float]:
        """Return the place in the tree of what a moving ball touches first, and when: 0 to 1.

        The ball, of the radius ``clearance``, moves from ``start`` to ``end``, in m; see
        :func:`triangles.contact_time`. Place -1: it touches nothing.
        """
        return self._first_contact(self.data, start, end, clearance)


def depth_for(count: int) -> int:
    """Return the levels of nodes over ``count`` triangles."""
    depth = 1
    while WIDTH**depth * LEAF < count:
        depth += 1
    return depth


def leaf_order(corners: Any, leaves: int) -> Any:
    """Return the order in which every node has a range of triangles, corners of shape (n, 3, 3).

    Level by level, each range is halved across its longest axis.
    """
    centres = 0.5 * corners.min(axis=1) + 0.5 * corners.max(axis=1)
    rows = np.arange(len(centres))
    order, parts = rows, 1
    while parts < leaves:
        starts = np.arange(parts) * len(rows) // parts
        part = np.searchsorted(starts, rows, side="right") - 1
        sorted_ = centres[order]
        extent = np.maximum.reduceat(sorted_, starts) - np.minimum.reduceat(sorted_, starts)
        longest = extent.argmax(axis=1)[part]
        order = order[np.lexsort((sorted_[rows, longest], part))]
        parts *= 2
    return order


def boxes_around(corners: Any, depth: int) -> Any:
    """Return the boxes of all nodes, of triangles in the order of the leaves."""
    starts = np.arange(WIDTH**depth) * len(corners) // WIDTH**depth
    low = np.minimum.reduceat(corners.min(axis=1), starts)
    high = np.maximum.reduceat(corners.max(axis=1), starts)
    is_empty = np.diff(starts, append=len(corners)) == 0
    low[is_empty], high[is_empty] = NOTHING, -NOTHING
    levels = []
    while len(low) > 1:
        low, high = low.reshape(-1, WIDTH, 3), high.reshape(-1, WIDTH, 3)
        levels.append(np.concatenate([low, high], axis=2).swapaxes(1, 2))
        low, high = low.min(axis=1), high.max(axis=1)
    return np.ascontiguousarray(np.concatenate(levels[::-1]))


def closest(tree: Tree, point: Vector3) -> tuple[int, Vector3, float]:
    """Return the closest triangle, its closest point, and the squared distance."""
    stack = np.empty(STACK)
    best, at, nearest = 0, point, math.inf
    stack[0, 0], stack[1, 0], top = 0.0, 0.0, 1
    while top > 0:
        top -= 1
        node = int(stack[0, top])
        if stack[1, top] >= nearest:
            continue
        if node < len(tree.nodes):
            top = push_children_near(tree.nodes, node, point, nearest, stack, top)
            continue
        first, last = triangles_of_leaf(tree, node)
        for index in range(first, last):
            here = closest_on(tree.triangles, index, point)
            square = dot(sub(point, here), sub(point, here))
            if square < nearest:
                best, at, nearest = index, here, square
    return best, at, nearest


def triangles_of_leaf(tree: Tree, leaf: int) -> tuple[int, int]:
    """Return the range of the triangles in a leaf; leaves are numbered after all nodes."""
    place, leaves, count = leaf - len(tree.nodes), WIDTH**tree.depth, len(tree.triangles)
    return place * count // leaves, (place + 1) * count // leaves


@outlined
def push_children_near(
    nodes: Any, node: int, point: Vector3, limit: float, stack: Any, top: int
) -> int:
    """Push the children within a squared distance of a point, the nearest last; return the top."""
    for child in range(WIDTH):
        square = 0.0
        for axis in range(3):
            out = max(
                nodes[node, axis, child] - point[axis],
                point[axis] - nodes[node, 3 + axis, child],
                0.0,
            )
            square += out * out
        stack[2, child] = square
    return _push(stack, top, node, limit)


@outlined
def _push(stack: Any, top: int, node: int, limit: float) -> int:
    """Push those of a node's children whose keys are within the limit, the smallest key last."""
    base = top
    for child in range(WIDTH):
        key = stack[2, child]
        if key <= limit:
            place = top
            while place > base and stack[1, place - 1] < key:
                stack[0, place], stack[1, place] = stack[0, place - 1], stack[1, place - 1]
                place -= 1
            stack[0, place], stack[1, place] = node * WIDTH + 1 + child, key
            top += 1
    return top


def closest_on(triangles: Triangles, index: int, point: Vector3) -> Vector3:
    """Return the closest point of one triangle."""
    return closest_on_triangle(
        point, corner(triangles, index, 0), corner(triangles, index, 1), corner(triangles, index, 2)
    )


@outlined
def first_contact(tree: Tree, start: Vector3, end: Vector3, clearance: float) -> tuple[int, float]:
    """Return the first triangle that a moving ball touches, and when; -1 if none."""
    nodes, triangles, stack = tree.nodes, tree.triangles, np.empty(STACK)
    best, earliest = -1, 2.0
    move = sub(end, start)
    inverse = (_inverse(move[0]), _inverse(move[1]), _inverse(move[2]))
    stack[0, 0], stack[1, 0], top = 0.0, 0.0, 1
    while top > 0:
        top -= 1
        node = int(stack[0, top])
        if stack[1, top] > earliest:
            continue
        if node >= len(nodes):
            first, last = triangles_of_leaf(tree, node)
            for index in range(first, last):
                a, b = corner(triangles, index, 0), corner(triangles, index, 1)
                time = contact_time(start, end, a, b, corner(triangles, index, 2), clearance)
                if time < earliest:
                    best, earliest = index, time
            continue
        for child in range(WIDTH):
            enter, leave = 0.0, 1.0
            for axis in range(3):
                one = (nodes[node, axis, child] - clearance - start[axis]) * inverse[axis]
                other = (nodes[node, 3 + axis, child] + clearance - start[axis]) * inverse[axis]
                enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
            stack[2, child] = enter if enter <= leave else NOTHING
        top = _push(stack, top, node, min(earliest, 1.0))
    return best, earliest


def _inverse(x: float) -> float:
    """Return 1/x, and a large number for 0, which keeps 0 times it a number."""
    return 1.0 / x if abs(x) > 1e-200 else math.copysign(1e200, x)
