"""Triangle meshes from files: STL, OBJ and PLY, and what has to be right about them.

trimesh reads the file; what its triangles mean is decided here.
"""

import hashlib
import io
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from forcebound.errors import ConfigError
from forcebound.files import content_of, read_bytes, reason

Array: TypeAlias = "np.ndarray[Any, Any]"

SUFFIXES = (".stl", ".obj", ".ply")
LARGEST_FILE = 400_000_000  # bytes
MOST_TRIANGLES = 2_000_000  # each million: some 5 s and 700 MB while it is opened
LARGEST, SMALLEST = 2.0, 0.001  # m across; nothing that a hand explores on a desk is beyond
CREASE = 0.77  # cosine of 40 degrees: a sharper edge stays one when normals are smoothed
_ODD = np.array([0x9E3779B97F4A7C15, 0xD1342543DE82EF95, 0xA0761D6478BD642F], np.uint64)


class Mesh(NamedTuple):
    """Triangles that the hand can touch."""

    vertices: Array  # m, shape (n, 3)
    faces: Array  # three vertices of each, counter-clockwise as seen from outside, shape (m, 3)
    is_closed: bool  # whether there is an inside
    digest: str  # sha256 of the file, hex

    @property
    def corners(self) -> Array:
        """Corners of the triangles, in m, shape (m, 3, 3)."""
        corners: Array = self.vertices[self.faces]
        return corners


def read_mesh(file: Path, scale: float | None = None, may_be_open: bool = False) -> Mesh:
    """Return the mesh in a file; equal vertices are one, triangles without three of them go.

    Args:
        file: STL, OBJ or PLY, by its suffix.
        scale: Length of its unit, in m; None: it is in metres, and as large as a hand can explore.
        may_be_open: Whether it may have holes, or triangles that do not agree what is outside.

    Raises:
        ConfigError: If it cannot be read, has no triangles or too many, is too large or too small,
            or is open where it may not be; says where and what to do.
    """
    vertices, faces, digest = _load(file)
    vertices = _scaled(vertices[faces], file, scale)
    vertices, faces = _merged(vertices.reshape(-1, 3))
    if len(faces) == 0:
        raise ConfigError(f"{file} has no triangles: all of them are points or lines", field="file")
    fault = _opening(vertices, faces)
    if fault is not None and not may_be_open:
        raise ConfigError(
            f"{file} is not closed: {fault}, so the tip could get inside; close it with a mesh"
            " editor, or use the kind `mesh` with `may_be_open: true`",
            field="file",
        )
    if fault is None and _volume(vertices[faces]) < 0.0:  # inside out
        faces = faces[:, ::-1]
    return Mesh(vertices, faces, fault is None, digest)


def _load(file: Path) -> tuple[Array, Array, str]:
    """Return vertices, triangles and digest as they stand in the file."""
    import trimesh  # takes a while

    kind = file.suffix.lower()
    if kind not in SUFFIXES:
        expected = ", ".join(SUFFIXES)
        raise ConfigError(f"{file}: expected a mesh ({expected}), got {kind or 'no suffix'}")
    try:
        data = read_bytes(file, LARGEST_FILE)
    except OSError as error:
        raise ConfigError(f"cannot read the mesh {file}: {reason(error)}", field="file") from error
    with content_of(file):
        loaded: Any = trimesh.load_mesh(io.BytesIO(data), file_type=kind[1:], process=False)
        faces = np.asarray(getattr(loaded, "faces", ()), int).reshape(-1, 3)
        vertices = np.asarray(getattr(loaded, "vertices", ()), float).reshape(-1, 3)
        vertices[faces]  # every corner is there
    if len(faces) == 0:
        raise ConfigError(f"{file} has no triangles: expected a mesh, not points", field="file")
    if len(faces) > MOST_TRIANGLES:
        raise ConfigError(
            f"{file} has {len(faces):,} triangles, at most {MOST_TRIANGLES:,} can be used: simplify"
            " it in a mesh editor (a hand does not feel what is smaller than 0.1 mm)",
            field="file",
        )
    (bad,) = np.nonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise ConfigError(
            f"{file} has {len(bad)} vertices whose coordinates are no finite numbers, the first is"
            f" number {bad[0] + 1}: repair it with a mesh editor",
            field="file",
        )
    return vertices, faces, hashlib.sha256(data).hexdigest()


def _scaled(corners: Array, file: Path, scale: float | None) -> Array:
    """Return corners in m."""
    scaled: Array = corners * (1.0 if scale is None else scale)
    edges = np.ptp(scaled.reshape(-1, 3), axis=0)
    size = " x ".join(f"{edge:.3g}" for edge in edges)
    if scale is None and edges.max() > LARGEST:
        raise ConfigError(
            f"{file} would measure {size} m: it looks like millimetres; say `scale: 0.001`, or"
            " `scale: 1` if it is in metres",
            field="scale",
        )
    if edges.max() < SMALLEST:
        raise ConfigError(
            f"{file} measures {size} m, less than {1e3 * SMALLEST:g} mm: `scale` is the length of"
            " the file's unit in m, 1 for metres",
            field="scale",
        )
    return scaled


def _merged(vertices: Array) -> tuple[Array, Array]:
    """Return the different vertices, in single precision, and the triangles that have three."""
    rounded = vertices.astype(np.float32) + np.float32(0.0)  # -0 is 0
    keys = (rounded.view(np.uint32).astype(np.uint64) * _ODD).sum(axis=1, dtype=np.uint64)
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    different = rounded[first]
    if not np.array_equal(
        different[which], rounded
    ):  # two keys are equal by chance: take it slowly
        different, which = np.unique(rounded, axis=0, return_inverse=True)
    faces = which.reshape(-1, 3)
    a, b, c = faces.T
    return different.astype(float), faces[(a != b) & (b != c) & (c != a)]


def _opening(vertices: Array, faces: Array) -> str | None:
    """Return where a mesh is open; None: it is closed, with one side outside.

    Each edge must be passed as often in one direction as in the other.
    """
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = ends.min(axis=1), ends.max(axis=1)
    edges, which = np.unique(low * len(vertices) + high, return_inverse=True)
    passed = np.bincount(which)
    balance = np.bincount(which, np.where(ends[:, 0] == low, 1, -1))
    (open_edges,) = np.nonzero(balance)
    if len(open_edges) == 0:
        return None
    (single,) = np.nonzero(passed % 2)
    edge = edges[single[0] if len(single) else open_edges[0]]
    x, y, z = vertices[[edge // len(vertices), edge % len(vertices)]].mean(axis=0)
    near = f"near ({x:.4g}, {y:.4g}, {z:.4g}) m"
    if len(single):
        return f"{len(single)} edges belong to one triangle alone, one {near}"
    return f"triangles at {len(open_edges)} edges do not agree which side is outside, two {near}"


def _volume(corners: Array) -> float:
    a, b, c = np.moveaxis(corners - corners.mean(axis=(0, 1)), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def smoothed(mesh: Mesh) -> Array:
    """Return unit normals of the corners, in single precision, shape (m, 3, 3).

    Each is the mean of all triangles there, or beside a crease its own. Triangles count by their
    angle at the corner, so that it does not matter how a face is cut.
    """
    vertices, faces, corners = mesh.vertices, mesh.faces, mesh.corners
    own = _units(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    total = np.zeros_like(vertices)
    for k in range(3):
        one, other = (_units(corners[:, k - j] - corners[:, k]) for j in (1, 2))
        angles = np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
        for axis in range(3):
            total[:, axis] += np.bincount(faces[:, k], angles * own[:, axis], len(vertices))
    mean = _units(total)[faces]
    is_smooth = (own[:, None, :] * mean).sum(axis=2, keepdims=True) > CREASE
    return np.where(is_smooth, mean, own[:, None, :]).astype(np.float32)


def _units(vectors: Array) -> Array:
    lengths = np.linalg.norm(vectors, axis=1)[:, None]
    return vectors / np.where(lengths > 0.0, lengths, 1.0)
