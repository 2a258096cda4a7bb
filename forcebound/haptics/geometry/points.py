"""A cloud of points as a solid: a smooth skin around all of them.

Each point is a ball of radius r, and balls flow together over the length l = r / 6::

    f(x) = -l ln( sum_i exp(-|x - p_i| / l) ) - r

Its gradient is a mean of unit vectors away from the points, so that f is nowhere more than the
distance to the skin. The proxy moves on it as on any other solid.

Sources: A. Leeper, S. Chan, K. Salisbury, Point clouds can be represented as implicit surfaces for
constraint-based haptic rendering, ICRA 2012; F. Ryden, H. J. Chizeck, A proxy method for real-time
3-DOF haptic rendering of streaming point cloud data, IEEE Trans. Haptics 6(3), 2013; the sum of
exponentials: J. F. Blinn, A generalization of algebraic surface drawing, ACM Trans. Graphics 1(3),
1982.
"""

import math
from typing import Any

import numpy as np

from forcebound.compiled import outlined
from forcebound.haptics.geometry.implicit import Field
from forcebound.haptics.geometry.vectors import Vector3, add, norm, scale, sub

SMOOTH = 6.0  # radius over the length on which balls flow together
REACH = 2.0  # radii; a point further away counts for nothing, as exp(-6) of the nearest does
MOST_CUBES = 50_000_000
# Among n points spread at random, with m in a disc of the radius on average, some n m exp(-m) discs
# are empty: at m = 16 one in twenty clouds of 30,000 points has a hole. Of a square grid of points
# the 16th neighbour is 2.2 spacings away.
NEIGHBOURS = 16
FEWEST = 4  # neighbours within the radius; of points at random one in ten thousand has fewer


def cloud_data(points: Any, radius: float) -> Any:
    """Return what the functions of ``CLOUD`` know: points sorted by cubes as wide as the reach.

    Points, shape (n, 3), and radius in m. Cubes are wider where they would be too many.
    """
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    edge = REACH * radius
    while np.prod(extent / edge + 1.0) > MOST_CUBES:
        edge *= 2.0
    cells = np.floor((points - low) / edge).astype(np.int64)
    shape = cells.max(axis=0) + 1
    number = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
    order = np.argsort(number, kind="stable")
    starts = np.searchsorted(number[order], np.arange(int(shape.prod()) + 1))
    return np.ascontiguousarray(points[order]), starts, shape, np.array([*low, edge, radius])


def _span(coordinate: float, low: float, edge: float, count: int) -> tuple[int, int]:
    """The cubes along an axis that are within reach: the first, and the one after the last."""
    cube = math.floor(max(min((coordinate - low) / edge, 1e9), -1e9))
    return max(cube - 1, 0), min(cube + 2, count)


@outlined
def skin(data: Any, point: Vector3) -> tuple[float, Vector3]:
    """Return the distance to the skin, or less, and its gradient; far away the zero vector."""
    points, starts, shape, place = data
    edge, radius = place[3], place[4]
    length = radius / SMOOTH
    nearest, total, gradient = REACH * radius, 0.0, (0.0, 0.0, 0.0)
    first_y, after_y = _span(point[1], place[1], edge, shape[1])
    first_z, after_z = _span(point[2], place[2], edge, shape[2])
    for i in range(*_span(point[0], place[0], edge, shape[0])):
        for j in range(first_y, after_y):
            row = (i * shape[1] + j) * shape[2]
            if first_z >= after_z:
                continue
            for n in range(starts[row + first_z], starts[row + after_z]):
                away = sub(point, (points[n, 0], points[n, 1], points[n, 2]))
                distance = norm(away)
                if distance >= REACH * radius:
                    continue
                if distance < nearest:  # all that was summed up counts for less
                    fading = math.exp((distance - nearest) / length) if total > 0.0 else 0.0
                    nearest, total, gradient = distance, total * fading, scale(gradient, fading)
                weight = math.exp((nearest - distance) / length)
                total += weight
                gradient = add(gradient, scale(away, weight / max(distance, 1e-12)))
    if total == 0.0:
        return nearest - radius, gradient
    return nearest - length * math.log(total) - radius, scale(gradient, 1.0 / total)


def distance(data: Any, point: Vector3) -> float:
    """Return the distance to the skin, or less."""
    return skin(data, point)[0]


def gradient(data: Any, point: Vector3) -> Vector3:
    """Return the gradient of that distance."""
    return skin(data, point)[1]


CLOUD = Field(distance, gradient, gradient)


def neighbourhoods(points: Any) -> Any:
    """Return the distances of 200 points to their nearest neighbours, in m, the nearest first.

    Shape ``(200, NEIGHBOURS)``; of a cloud of fewer points smaller.
    """
    chosen = np.random.default_rng(1).permutation(len(points))[:200]
    count = min(NEIGHBOURS, len(points) - 1)
    nearest = []
    for point in points[chosen]:
        squares = np.einsum("ij,ij->i", points - point, points - point)
        nearest.append(np.sqrt(np.sort(np.partition(squares, count)[1 : count + 1])))
    return np.array(nearest)
