"""Height maps: the fine relief of a surface.

A map repeats over the three planes of the coordinates; a point of the surface takes from each as
much as the square of its normal's component across that plane, which sum up to one. On a face
across an axis that is the map itself.

The surface lies at the highest points of the map, everything else is a valley of height h <= 0. A
tip that presses to a depth d feels a spring of energy ``k (d + h)^2 / 2``: along the normal ``k (d
+ h)``, across it ``k (d + h)`` times the slope of h. A force with an energy gives back no more than
it took.

Source: C.-H. Ho, C. Basdogan, M. A. Srinivasan, Efficient point-based rendering techniques for
haptic display of virtual objects, Presence 8(5), 1999, section 5.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from forcebound.compiled import jit
from forcebound.errors import ConfigError
from forcebound.extras import needed
from forcebound.files import version_of
from forcebound.haptics.geometry.mesh_file import read_data
from forcebound.haptics.geometry.vectors import Vector3, tangential

LARGEST = 130_000_000  # bytes of a file
MOST = 16_000_000  # heights of a map


def relief(heights: Any, size: float, u: float, v: float) -> Vector3:
    """Return height (m) and slopes along u and v of a map that repeats every ``size`` meters.

    Between the points of the map it is bilinear.
    """
    rows, columns = heights.shape
    along_u, along_v = u / size * columns, v / size * rows
    column, row = math.floor(along_u), math.floor(along_v)
    s, t = along_u - column, along_v - row
    left, right = int(column % columns), int((column + 1) % columns)
    low, high = int(row % rows), int((row + 1) % rows)
    a, b = heights[low, left], heights[low, right]
    c, d = heights[high, left], heights[high, right]
    height = (a * (1 - s) + b * s) * (1 - t) + (c * (1 - s) + d * s) * t
    slope_u = ((b - a) * (1 - t) + (d - c) * t) * columns / size
    slope_v = ((c - a) * (1 - s) + (d - b) * s) * rows / size
    return (height, slope_u, slope_v)


def relief_in_space(
    heights: Any, size: float, point: Vector3, normal: Vector3
) -> tuple[float, Vector3]:
    """Return the height at a point of a surface, and its gradient in space."""
    x, y, z = point
    on_x, on_y, on_z = normal[0] ** 2, normal[1] ** 2, normal[2] ** 2
    across_x = relief(heights, size, y, z)
    across_y = relief(heights, size, z, x)
    across_z = relief(heights, size, x, y)
    height = on_x * across_x[0] + on_y * across_y[0] + on_z * across_z[0]
    gradient = (
        on_y * across_y[2] + on_z * across_z[1],
        on_x * across_x[1] + on_z * across_z[2],
        on_x * across_x[2] + on_y * across_y[1],
    )
    return height, gradient


@dataclass(frozen=True, eq=False)
class Texture:
    """A height map on a surface: heights (m, at most 0) on a tile, whose edge is ``size`` (m)."""

    heights: Any
    size: float
    _relief: Callable[[Any, float, Vector3, Vector3], tuple[float, Vector3]]

    @classmethod
    def read(cls, path: Path, height: float, size: float) -> "Texture":
        """Read a map from a picture or a .npy file, ``height`` (m) from lowest to highest point."""
        heights = _read(path, version_of(path))
        relief = jit(relief_in_space)
        relief(heights, size, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))  # compiled before the first answer
        return cls(heights * height, size, relief)

    def at(self, point: Vector3, normal: Vector3) -> tuple[float, Vector3]:
        """Return the height at a point of the surface, in m, and its slope across the normal."""
        height, gradient = self._relief(self.heights, self.size, point, normal)
        return height, tangential(gradient, normal)


@lru_cache(maxsize=4)
def _read(path: Path, version: tuple[int, int]) -> Any:
    """The map, from -1 to 0; read again when the file has another version."""
    advice = "give a picture (.png) or a numpy array (.npy) of rows and columns of heights"
    data = read_data(path, "height map", LARGEST, "surface.texture")
    try:
        if path.suffix == ".npy":
            raw = np.asarray(np.load(BytesIO(data), allow_pickle=False), float)
        else:
            image = needed("a picture as height map", "PIL.Image")
            with image.open(BytesIO(data)) as picture:  # brightness, by the weights of ITU-R 601
                raw = np.asarray(picture.convert("F"), float)[::-1]  # its lowest row first
    except Exception as error:  # of bytes that are no such file
        words = f"the height map {path} cannot be read ({type(error).__name__}): {advice}"
        raise ConfigError(words, field="surface.texture") from error
    if raw.ndim != 2 or not 0 < raw.size <= MOST or not np.isfinite(raw).all():
        raise ConfigError(
            f"the height map {path} has the shape {raw.shape}"
            + ("" if np.isfinite(raw).all() else " and entries that are no finite numbers")
            + f"; {advice}, {MOST:,} at most, all finite",
            field="surface.texture",
        )
    lowest, highest = float(raw.min()), float(raw.max())
    span = highest - lowest
    return np.ascontiguousarray((raw - highest) / (span if span > 0.0 else 1.0))
