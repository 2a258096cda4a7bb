"""Distances on a grid: between its points they are interpolated.

Distances are exact within a *narrow band* of a few cells about the surface; beyond they stay at the
band's width. Beyond the grid the value at its nearest point holds, so that what touches the border
goes on there.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from forcebound.compiled import jit, outlined
from forcebound.files import content_of
from forcebound.haptics.geometry.implicit import Field
from forcebound.haptics.geometry.mesh_file import Mesh, load_file, unusable
from forcebound.haptics.geometry.triangles import closest_on_triangle
from forcebound.haptics.geometry.vectors import Vector3, along, norm, scale, sub

BAND = 4  # cells on each side of the surface in which distances are exact
MOST_POINTS = 30_000_000  # of a grid: 120 MB
STEEPEST = 1.5  # change of distance over distance; 1 but for rounding


class Grid(NamedTuple):
    """Distances on the points of a grid: what the functions of ``GRID`` know."""

    values: Any  # m, single precision; negative: inside; shape (x, y, z)
    place: Any  # m: first point x, y, z, and the spacing between neighbours; shape (4,)


def _cell(along_axis: float, count: int) -> tuple[int, float]:
    """The point before a coordinate, in points, and the share of the way to the next."""
    inside = min(max(along_axis, 0.0), count - 1.0)
    before = min(int(inside), count - 2)
    return before, inside - before


@outlined
def interpolated(grid: Grid, point: Vector3) -> tuple[float, Vector3]:
    """Return distance and slope at a point, by its 8 neighbours; the slope jumps between cells."""
    values, place = grid
    i, u = _cell((point[0] - place[0]) / place[3], values.shape[0])
    j, v = _cell((point[1] - place[1]) / place[3], values.shape[1])
    k, w = _cell((point[2] - place[2]) / place[3], values.shape[2])
    a, e = 1.0 * values[i, j, k], 1.0 * values[i, j, k + 1]
    b, f = 1.0 * values[i + 1, j, k], 1.0 * values[i + 1, j, k + 1]
    c, g = 1.0 * values[i, j + 1, k], 1.0 * values[i, j + 1, k + 1]
    d, h = 1.0 * values[i + 1, j + 1, k], 1.0 * values[i + 1, j + 1, k + 1]
    low_near, low_far = a + (b - a) * u, c + (d - c) * u
    high_near, high_far = e + (f - e) * u, g + (h - g) * u
    low, high = low_near + (low_far - low_near) * v, high_near + (high_far - high_near) * v
    slope = (
        ((b - a) * (1 - v) + (d - c) * v) * (1 - w) + ((f - e) * (1 - v) + (h - g) * v) * w,
        (low_far - low_near) * (1 - w) + (high_far - high_near) * w,
        high - low,
    )
    return low + (high - low) * w, scale(slope, 1.0 / place[3])


def distance(grid: Grid, point: Vector3) -> float:
    """Return the distance at a point."""
    return interpolated(grid, point)[0]


def gradient(grid: Grid, point: Vector3) -> Vector3:
    """Return the slope of the distance; it jumps where cells meet."""
    return interpolated(grid, point)[1]


def smooth_gradient(grid: Grid, point: Vector3) -> Vector3:
    """Return the slope of the distance over a cell to each side, without jumps."""
    step = grid.place[3]
    x, y, z = point
    return (
        (distance(grid, (x + step, y, z)) - distance(grid, (x - step, y, z))) / step / 2,
        (distance(grid, (x, y + step, z)) - distance(grid, (x, y - step, z))) / step / 2,
        (distance(grid, (x, y, z + step)) - distance(grid, (x, y, z - step))) / step / 2,
    )


GRID = Field(distance, gradient, smooth_gradient)


def mesh_grid(mesh: Mesh, spacing: float) -> Grid:
    """Return the distances to a closed mesh; ConfigError for too many points."""
    corners = mesh.corners
    low = corners.min(axis=(0, 1)) - (BAND + 1) * spacing
    edges = np.ptp(corners.reshape(-1, 3), axis=0).tolist()
    shape = tuple([math.ceil(edge / spacing) + 2 * (BAND + 1) + 1 for edge in edges])
    if math.prod(shape) > MOST_POINTS:
        least = spacing * (math.prod(shape) / MOST_POINTS) ** (1 / 3)
        raise unusable(
            f"a spacing of {1e3 * spacing:g} mm makes a grid of {math.prod(shape):,} points, more"
            f" than {MOST_POINTS:,}: use at least {1e3 * least:.2g} mm, or the kind `mesh`",
            "spacing",
        )
    grid = Grid(np.full(shape, BAND * spacing, np.float32), np.array([*low, spacing]))
    jit(fill)(np.ascontiguousarray(corners.reshape(-1, 9)), *grid, np.zeros(shape, np.int32))
    return grid


def read_grid(file: Path, spacing: float, origin: Vector3) -> Grid:
    """Return the distances in a .npy file, an array of three axes, in m; negative: inside.

    ConfigError, with what to do, if it is no such array, or its numbers are no distances.
    """
    loaded, _ = load_file(file, "grid", (".npy",))
    with content_of(file):
        values = np.ascontiguousarray(loaded, np.float32)
    if values.ndim != 3 or not 8 <= values.size <= MOST_POINTS or min(values.shape) < 2:
        raise unusable(
            f"{file} has the shape {values.shape}: expected a grid of three axes with two points"
            f" each or more, {MOST_POINTS:,} in all"
        )
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        raise unusable(
            f"{file} has {len(bad)} entries that are no finite numbers, the first at"
            f" {bad[0].tolist()}: a distance that is not known may be {BAND} times the spacing,"
            " away from the surface"
        )
    if not values.min() < 0.0 < values.max():
        raise unusable(
            f"{file} holds distances from {values.min():g} to {values.max():g} m: the surface is"
            " where they change their sign, and there is none; inside is negative"
        )
    steepest = max(float(np.abs(np.diff(values, axis=axis)).max()) for axis in range(3)) / spacing
    if steepest > STEEPEST:
        raise unusable(
            f"{file} changes by {steepest:.3g} times the spacing between two neighbours, and a"
            " distance by no more than once: give distance and `spacing` in m, such as 1 mm",
            "spacing",
        )
    return Grid(values, np.array([*origin, spacing]))


def fill(triangles: Any, values: Any, place: Any, crossings: Any) -> None:
    """Fill a grid with the distances to triangles; inside is what their windings enclose."""
    for row in range(triangles.shape[0]):
        near_triangle(triangles[row], values, place)
        cross_triangle(triangles[row], crossings, place)
    for j in range(values.shape[1]):
        for k in range(values.shape[2]):
            winding = 0
            for i in range(values.shape[0]):
                winding += crossings[i, j, k]
                if winding != 0:
                    values[i, j, k] = -values[i, j, k]


def _corner(triangle: Any, which: int) -> Vector3:
    return (triangle[3 * which], triangle[3 * which + 1], triangle[3 * which + 2])


def _reach(triangle: Any, axis: int, place: Any, band: float, count: int) -> tuple[int, int]:
    """First point within a band of a triangle along an axis, and the one after the last."""
    a, b, c = triangle[axis], triangle[3 + axis], triangle[6 + axis]
    low = (min(a, min(b, c)) - band - place[axis]) / place[3]
    high = (max(a, max(b, c)) + band - place[axis]) / place[3]
    return max(math.ceil(low), 0), min(math.floor(high) + 1, count)


@outlined
def near_triangle(triangle: Any, values: Any, place: Any) -> None:
    """Lower the distances near one triangle."""
    a, b, c = _corner(triangle, 0), _corner(triangle, 1), _corner(triangle, 2)
    band = BAND * place[3]
    first, after = _reach(triangle, 0, place, band, values.shape[0])
    first_y, after_y = _reach(triangle, 1, place, band, values.shape[1])
    first_z, after_z = _reach(triangle, 2, place, band, values.shape[2])
    origin = (place[0], place[1], place[2])
    for i in range(first, after):
        for j in range(first_y, after_y):
            for k in range(first_z, after_z):
                point = along(origin, (1.0 * i, 1.0 * j, 1.0 * k), place[3])
                away = norm(sub(point, closest_on_triangle(point, a, b, c)))
                values[i, j, k] = min(values[i, j, k], away)


@outlined
def cross_triangle(triangle: Any, crossings: Any, place: Any) -> None:
    """Count where the lines along x go into (1) and out of (-1) the solid through a triangle.

    The lines pass the points of the grid by a little, so that they meet no edge: meshes like round
    numbers.
    """
    (ax, ay, az), (bx, by, bz) = _corner(triangle, 0), _corner(triangle, 1)
    cx, cy, cz = _corner(triangle, 2)
    double = (by - ay) * (cz - az) - (bz - az) * (cy - ay)  # x of the outward normal
    if double == 0.0:
        return
    first_y, after_y = _reach(triangle, 1, place, place[3], crossings.shape[1])
    first_z, after_z = _reach(triangle, 2, place, place[3], crossings.shape[2])
    for j in range(first_y, after_y):
        y = place[1] + (j + 1.2345e-5) * place[3]
        for k in range(first_z, after_z):
            z = place[2] + (k + 2.3571e-5) * place[3]
            at_a = ((by - y) * (cz - z) - (bz - z) * (cy - y)) / double
            at_b = ((cy - y) * (az - z) - (cz - z) * (ay - y)) / double
            at_c = 1.0 - at_a - at_b
            if at_a >= 0.0 and at_b >= 0.0 and at_c >= 0.0:
                x = at_a * ax + at_b * bx + at_c * cx
                i = min(max(math.ceil((x - place[0]) / place[3]), 0), crossings.shape[0] - 1)
                crossings[i, j, k] += 1 if double < 0.0 else -1
