"""Points from files."""

import hashlib
import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from forcebound.errors import ConfigError
from forcebound.files import content_of, read_bytes, reason

LARGEST_FILE = 200_000_000  # bytes
MOST = 5_000_000  # points
LARGEST = 2.0  # m across; nothing that a hand explores on a desk is beyond


class Cloud(NamedTuple):
    """Points that the hand can touch."""

    points: Any  # m, shape (n, 3)
    digest: str  # sha256 of the file, hex


def read_points(file: Path, scale: float | None) -> Cloud:
    """Return the points in a file.

    Args:
        file: An array of rows x, y, z (.npy), or the corners in a .ply file.
        scale: Length of its unit, in m; None: it is in metres, and as large as a hand can explore.

    Raises:
        ConfigError: If it holds no such points; says what to do.
    """
    kind = file.suffix.lower()
    if kind not in (".npy", ".ply"):
        raise ConfigError(
            f"{file}: expected points (.npy, .ply), got {kind or 'no suffix'}", field="file"
        )
    try:
        data = read_bytes(file, LARGEST_FILE)
    except OSError as error:
        message = f"cannot read the points {file}: {reason(error)}"
        raise ConfigError(message, field="file") from error
    with content_of(file):
        read: Any = _corners(data) if kind == ".ply" else np.load(io.BytesIO(data))
        points = np.asarray(read, float)
    if points.ndim != 2 or points.shape[1] != 3 or not 2 <= len(points) <= MOST:
        raise ConfigError(
            f"{file} has the shape {points.shape}: expected 2 to {MOST:,} rows of x, y and z",
            field="file",
        )
    bad = int((~np.isfinite(points)).any(axis=1).sum())
    if bad:
        raise ConfigError(
            f"{file} has {bad} points without finite coordinates: leave these rows out",
            field="file",
        )
    points = points * (1.0 if scale is None else scale)
    extent = float(np.ptp(points, axis=0).max())
    if scale is None and extent > LARGEST:
        raise ConfigError(
            f"{file} would measure {extent:.3g} m: it looks like millimetres; say `scale: 0.001`,"
            " or `scale: 1` if it is in metres",
            field="scale",
        )
    return Cloud(points, hashlib.sha256(data).hexdigest())


def _corners(data: bytes) -> Any:
    import trimesh  # takes a while

    loaded: Any = trimesh.load(io.BytesIO(data), file_type="ply", process=False)
    return loaded.vertices if isinstance(loaded, trimesh.Trimesh | trimesh.PointCloud) else ()
