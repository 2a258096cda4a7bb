"""Tree of bounding boxes over triangles: closest point, and the first contact of a moving ball.

One question a millisecond finds every cache cold, so a question should touch few lines of memory. A
node holds the boxes of its eight children side by side, 192 bytes: three cache lines. The tree is
balanced, so the places of children and triangles follow from their number alone. Triangles lie in
the order of the leaves; their corners have single precision, which the boxes bound without
rounding, while all arithmetic has double precision. A search begins with the triangle of the answer
before, which is near in most cases.

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
    """What the kernels know of a tree."""

    nodes: Any  # lowest x, y, z, then highest, of eight children, m; shape (n, 6, WIDTH)
    triangles: Triangles  # in the order of the leaves
    depth: int  # levels of nodes


class TriangleTree:
    """Triangles, corners in m of shape (n, 3, 3), that answer where they are; see the module.

    It keeps the place of its last answer, so it serves one user; ``copy.copy`` makes one for
    another.
    """

    def __init__(self, corners: Any) -> None:
        flat = np.ascontiguousarray(np.asarray(corners, np.float32).reshape(-1, 9))
        depth = depth_for(len(flat))
        #: Which triangle, counted as given, has a place in the tree.
        self.order = np.arange(len(flat))
        boxes = flat.reshape(-1, 3, 3)
        centres = (0.5 * boxes.min(axis=1) + 0.5 * boxes.max(axis=1)).T.copy()
        jit(sort_triangles)(centres, self.order, depth)
        nodes = np.empty(((WIDTH**depth - 1) // (WIDTH - 1), 6, WIDTH), np.float32)
        self.data = Tree(nodes, flat[self.order], depth)
        jit(fill_nodes)(self.data)
        self.lowest = np.asarray(nodes[0, :3].min(axis=1), float)
        self.highest = np.asarray(nodes[0, 3:].max(axis=1), float)
        self._closest, self._first_contact = jit(closest), jit(first_contact)
        self._last = 0

    @property
    def size(self) -> float:
        """Return the diagonal of the box around all triangles, in m."""
        return math.dist(self.lowest, self.highest)

    def closest(self, point: Vector3) -> tuple[int, Vector3, float]:
        """Return place in the tree, closest point (m) and distance of the closest triangle."""
        self._last, at, square = self._closest(self.data, point, self._last)
        return self._last, at, math.sqrt(square)

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


def sort_triangles(centres: Any, order: Any, depth: int) -> None:
    """Sort triangles, in place, so that every node has a range of them: medians, level by level.

    ``centres`` has the shape (3, n), and is sorted, too; ``order`` are the numbers of the
    triangles.
    """
    count = len(order)
    leaves = WIDTH**depth
    span = leaves
    while span > 1:
        for first in range(0, leaves, span):
            low, high = first * count // leaves, (first + span) * count // leaves
            if high - low > 1:
                middle = (first + span // 2) * count // leaves
                axis = _longest_axis(centres, low, high)
                _partition(centres, order, axis, low, middle, high)
        span //= 2


def _longest_axis(centres: Any, low: int, high: int) -> int:
    longest, widest = 0, -1.0
    for axis in range(3):
        least, most = centres[axis, low], centres[axis, low]
        for index in range(low, high):
            least, most = min(least, centres[axis, index]), max(most, centres[axis, index])
        if most - least > widest:
            longest, widest = axis, most - least
    return longest


def _partition(centres: Any, order: Any, axis: int, low: int, middle: int, high: int) -> None:
    """Put the smaller ones of ``low`` to ``high`` before ``middle``.

    Source: C. A. R. Hoare, Algorithm 65: Find, Communications of the ACM 4(7), 1961.
    """
    left, right = low, high - 1
    while left < right:
        pivot = centres[axis, (left + right) // 2]
        i, j = left, right
        while i <= j:
            while centres[axis, i] < pivot:
                i += 1
            while centres[axis, j] > pivot:
                j -= 1
            if i <= j:
                for k in range(3):
                    centres[k, i], centres[k, j] = centres[k, j], centres[k, i]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            break


def fill_nodes(tree: Tree) -> None:
    """Write the boxes of all nodes."""
    nodes, triangles, depth = tree
    parents = len(nodes)  # nodes and leaves are numbered level by level
    for child in range(parents + WIDTH**depth - 1, 0, -1):
        parent, side = (child - 1) // WIDTH, (child - 1) % WIDTH
        nodes[parent, :3, side], nodes[parent, 3:, side] = NOTHING, -NOTHING
        if child < parents:
            for axis in range(3):
                nodes[parent, axis, side] = nodes[child, axis].min()
                nodes[parent, 3 + axis, side] = nodes[child, 3 + axis].max()
            continue
        first, last = triangles_of_leaf(tree, child)
        for index in range(first, last):
            for entry in range(9):
                low, high = entry % 3, 3 + entry % 3
                nodes[parent, low, side] = min(nodes[parent, low, side], triangles[index, entry])
                nodes[parent, high, side] = max(nodes[parent, high, side], triangles[index, entry])


def closest(tree: Tree, point: Vector3, guess: int) -> tuple[int, Vector3, float]:
    """Return the closest triangle, its closest point, and the squared distance.

    ``guess`` is a triangle that may be near.
    """
    stack = np.empty(STACK)
    best, at = guess, closest_on(tree.triangles, guess, point)
    nearest = dot(sub(point, at), sub(point, at))
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
    """Return the first triangle that a ball touches on its way, and when; -1 if none."""
    nodes, triangles, stack = tree.nodes, tree.triangles, np.empty(STACK)
    best, earliest = -1, 2.0
    way = sub(end, start)
    inverse = (_inverse(way[0]), _inverse(way[1]), _inverse(way[2]))
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
