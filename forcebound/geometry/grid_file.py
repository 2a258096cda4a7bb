"""Grids of distances from files, and those of meshes kept on disk.

The grid of a mesh takes seconds to make. It is kept in the user's cache folder, under a digest of
the mesh, its scale and the spacing. The file begins with the digest of its own content; one that
does not fit, from whatever cause, is made anew.
"""

import hashlib
import io
import os
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from forcebound.errors import ConfigError
from forcebound.files import content_of, read_bytes, reason
from forcebound.geometry.grid import BAND, Grid, grid_of, grid_shape
from forcebound.geometry.mesh_file import Mesh

MOST_POINTS = 30_000_000  # of a grid: 120 MB
STEEPEST = 1.5  # change of distance over distance; 1 but for rounding
_VERSION = b"forcebound grid 1"
_DIGEST = 32  # bytes


def mesh_grid(mesh: Mesh, spacing: float, folder: Path | None) -> Grid:
    """Return the grid of a mesh.

    Args:
        mesh: A closed one.
        spacing: Between two neighbours, in m.
        folder: Where grids are kept; None: nowhere.

    Raises:
        ConfigError: If it would have too many points.
    """
    shape = grid_shape(mesh.corners, spacing)
    points = shape[0] * shape[1] * shape[2]
    if points > MOST_POINTS:
        least = spacing * (points / MOST_POINTS) ** (1 / 3)
        raise ConfigError(
            f"a spacing of {1e3 * spacing:g} mm makes a grid of {points:,} points, more than"
            f" {MOST_POINTS:,}: use at least {1e3 * least:.2g} mm, or the kind `mesh`",
            field="spacing",
        )
    file = None if folder is None else folder / _name(mesh, spacing)
    low = mesh.corners.min(axis=(0, 1)) - (BAND + 1) * spacing
    origin = (float(low[0]), float(low[1]), float(low[2]))
    values = None if file is None else _read_cached(file, shape)
    if values is not None:
        return Grid(values, origin, spacing)
    grid = grid_of(mesh.corners, spacing)
    if file is not None:
        with suppress(OSError):  # no space: it is made again next time
            _write(file, grid.values.tobytes())
    return grid


def _name(mesh: Mesh, spacing: float) -> str:
    """The name of the file that keeps the grid of a mesh."""
    name = hashlib.sha256(_VERSION)
    name.update(mesh.corners.tobytes())
    name.update(f"{spacing!r} {BAND}".encode())
    return name.hexdigest()


def _read_cached(file: Path, shape: tuple[int, int, int]) -> Any:
    """The distances in a file of the cache; None if there is none or it is damaged."""
    length = 4 * shape[0] * shape[1] * shape[2]
    try:
        data = read_bytes(file, _DIGEST + length)
    except OSError:
        return None
    content = data[_DIGEST:]
    if len(content) != length or hashlib.sha256(content).digest() != data[:_DIGEST]:
        return None
    return np.frombuffer(content, np.float32).reshape(shape)


def _write(file: Path, content: bytes) -> None:
    """Put a file in its place as a whole."""
    descriptor, name = tempfile.mkstemp(dir=file.parent)
    try:
        with os.fdopen(descriptor, "wb") as opened:
            opened.write(hashlib.sha256(content).digest())
            opened.write(content)
        os.replace(name, file)
    except OSError:
        Path(name).unlink(missing_ok=True)
        raise


def read_grid(file: Path, spacing: float, origin: tuple[float, float, float]) -> Grid:
    """Return the distances in a .npy file.

    Args:
        file: An array of three axes, in m; negative: inside.
        spacing: Between two neighbours, in m.
        origin: Place of the first point, in m.

    Raises:
        ConfigError: If it is no such array, or its numbers are no distances; says what to do.
    """
    try:
        data = read_bytes(file, 8 * MOST_POINTS + 1000)
    except OSError as error:
        raise ConfigError(f"cannot read the grid {file}: {reason(error)}", field="file") from error
    with content_of(file):
        values = np.asarray(np.load(io.BytesIO(data), allow_pickle=False), np.float32)
    _check(values, spacing, file)
    return Grid(np.ascontiguousarray(values), origin, spacing)


def _check(values: Any, spacing: float, file: Path) -> None:
    if values.ndim != 3 or min(values.shape) < 2:
        raise ConfigError(
            f"{file} has the shape {values.shape}: expected a grid of three axes with two points"
            " each or more",
            field="file",
        )
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        where = ", ".join(map(str, bad[0].tolist()))
        raise ConfigError(
            f"{file} has {len(bad)} entries that are no finite numbers, the first at [{where}]:"
            f" a distance that is not known may be {BAND} times the spacing, away from the surface",
            field="file",
        )
    if not values.min() < 0.0 < values.max():
        raise ConfigError(
            f"{file} holds distances from {values.min():g} to {values.max():g} m: the surface is"
            " where they change their sign, and there is none; inside is negative",
            field="file",
        )
    steepest = max(float(np.abs(np.diff(values, axis=axis)).max()) for axis in range(3)) / spacing
    if steepest > STEEPEST:
        raise ConfigError(
            f"{file} changes by {steepest:.3g} times the spacing between two neighbours, and a"
            " distance by no more than once: give distance and `spacing` in m, such as 1 mm",
            field="spacing",
        )
