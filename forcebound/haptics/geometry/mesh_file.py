"""Triangle meshes and clouds of points from files, and what has to be right about them.

What the triangles of a file mean is decided here; trimesh merges them.
"""

import hashlib
import io
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from forcebound.errors import ConfigError
from forcebound.extras import needed
from forcebound.files import content_of, read_bytes, reason
from forcebound.haptics.geometry.mesh_formats import FLAT, triangles_in

Array: TypeAlias = "np.ndarray[Any, Any]"

LARGEST_FILE = 400_000_000  # bytes
MOST_TRIANGLES = 2_000_000  # each million: some 5 s and 700 MB while it is opened
MOST_POINTS = 5_000_000  # of a cloud
LARGEST, SMALLEST = 2.0, 0.001  # m across; nothing that a hand explores on a desk is beyond
CREASE = 0.77  # cosine of 40 degrees: a sharper edge stays one when normals are smoothed


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


class Cloud(NamedTuple):
    """Points that the hand can touch."""

    points: Array  # m, shape (n, 3)
    digest: str  # sha256 of the file, hex


def read_mesh(file: Path, scale: float | None = None, may_be_open: bool = False) -> Mesh:
    """Return the mesh in an STL, OBJ or PLY file, its equal vertices merged.

    ``scale`` is the length of its unit, in m; None: it is in metres, and as large as a hand can
    explore. ConfigError, with place and what to do, if it cannot be read, has no triangles or too
    many, is too large or too small, or is open where it may not be.
    """
    trimesh = needed("a mesh", "trimesh")  # takes a while

    (points, faces), digest = load_file(file, "mesh", (".stl", ".obj", ".ply"))
    if not 0 < len(faces) <= MOST_TRIANGLES:
        advice = "use the kind `point_cloud`" if len(points) else "export the mesh again"
        if len(faces):
            advice = "simplify it in a mesh editor (a hand does not feel what is below 0.1 mm)"
        raise unusable(
            f"{file} has {len(faces):,} triangles and {len(points):,} points: expected 1 to"
            f" {MOST_TRIANGLES:,} triangles; {advice}"
        )
    corners = _scaled(points[faces].reshape(-1, 3), file, scale)
    mesh: Any = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    mesh.merge_vertices()
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    if len(mesh.faces) == 0:
        raise unusable(f"{file} has no triangles: all of them are points or lines")
    fault = _opening(mesh)
    if fault is not None and not may_be_open:
        raise unusable(
            f"{file} is not closed: {fault}, so the tip could get inside; close it with a mesh"
            " editor, or use the kind `mesh` with `may_be_open: true`"
        )
    if fault is None and _volumes(mesh).sum() < 0.0:  # inside out
        mesh.invert()
    return Mesh(np.array(mesh.vertices), np.array(mesh.faces), fault is None, digest)


def read_points(file: Path, scale: float | None) -> Cloud:
    """Return the points in a file: an array of rows x, y, z (.npy), or the corners in a .ply file.

    ``scale`` and errors as in :func:`read_mesh`.
    """
    loaded, digest = load_file(file, "points", (".npy", ".ply"))
    with content_of(file):
        points = np.asarray(loaded[0] if isinstance(loaded, tuple) else loaded, float)
    if points.ndim != 2 or points.shape[1] != 3 or not 2 <= len(points) <= MOST_POINTS:
        raise unusable(
            f"{file} has the shape {points.shape}: expected 2 to {MOST_POINTS:,} rows of x, y, z"
        )
    return Cloud(_scaled(points, file, scale), digest)


def unusable(words: str, field: str = "file") -> ConfigError:
    """Return the error of a file that will not do."""
    return ConfigError(words, field=field)


def load_file(file: Path, what: str, suffixes: tuple[str, ...]) -> tuple[Any, str]:
    """Return the array in a file, or its points and triangles, and the file's digest."""
    kind = file.suffix.lower()
    if kind not in suffixes:
        expected = f"expected {what} ({', '.join(suffixes)})"
        raise unusable(f"{file}: {expected}, got {kind or 'no suffix'}")
    data = read_data(file, what, LARGEST_FILE)
    with content_of(file):
        if kind == ".npy":
            loaded: Any = np.load(io.BytesIO(data), allow_pickle=False)
        else:
            loaded = triangles_in(file, data)
    return loaded, hashlib.sha256(data).hexdigest()


def read_data(file: Path, what: str, limit: int, field: str = "file") -> bytes:
    """Return the bytes of a file that a parameter names; ConfigError if it cannot be read."""
    try:
        return read_bytes(file, limit)
    except OSError as error:
        raise unusable(f"cannot read the {what} {file}: {reason(error)}", field) from error


def _scaled(points: Array, file: Path, scale: float | None) -> Array:
    """Return points in m."""
    (bad,) = np.nonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise unusable(
            f"{file} has {len(bad)} points whose coordinates are no finite numbers, the first is"
            f" number {bad[0] + 1}: repair it, or leave them out"
        )
    scaled: Array = points * (1.0 if scale is None else scale)
    edges = np.ptp(scaled, axis=0)
    size = " x ".join(f"{edge:.3g}" for edge in edges)
    if scale is None and edges.max() > LARGEST:
        words = "it looks like millimetres; say `scale: 0.001`, or `scale: 1` if it is in metres"
        raise unusable(f"{file} would measure {size} m: {words}", "scale")
    if edges.max() < SMALLEST:
        words = "`scale` is the length of the file's unit in m, 1 for metres"
        raise unusable(f"{file} measures {size} m, less than 1 mm: {words}", "scale")
    return scaled


def _opening(mesh: Any) -> str | None:
    """Return where a mesh is open; None: it is closed, with one side outside.

    Each edge must be passed as often in one direction as in the other. (To trimesh, a mesh is open
    where two parts share an edge.)
    """
    low, high = mesh.edges_sorted.T
    edges, which = np.unique(low * len(mesh.vertices) + high, return_inverse=True)
    (single,) = np.nonzero(np.bincount(which) % 2)
    (uneven,) = np.nonzero(np.bincount(which, np.where(mesh.edges[:, 0] == low, 1, -1)))
    if len(uneven) == 0:
        volumes = _volumes(mesh)
        is_empty = abs(volumes.sum()) < FLAT * abs(volumes).sum()
        both = "its triangles face both ways (each surface is there twice, or a part is inside out)"
        return both if is_empty else None
    edge = edges[[*single, *uneven][0]]
    ends = [edge // len(mesh.vertices), edge % len(mesh.vertices)]
    x, y, z = mesh.vertices[ends].mean(axis=0)
    near = f"one near ({x:.4g}, {y:.4g}, {z:.4g}) m"
    if len(single):
        return f"{len(single)} edges belong to one triangle alone, {near}"
    return f"triangles at {len(uneven)} edges do not agree which side is outside, {near}"


def _volumes(mesh: Any) -> Array:
    """Return what each triangle and the middle enclose, x 6; a scan may be far from its origin."""
    around = mesh.triangles - mesh.bounds.mean(axis=0)
    volumes: Array = np.linalg.det(around)
    return volumes


def smoothed(mesh: Mesh) -> Array:
    """Return unit normals of the corners, in single precision, shape (m, 3, 3).

    Each is the mean of all triangles there, beside a crease that of one. Triangles count by their
    angle at the corner, so that it does not matter how a face is cut.
    """
    trimesh = needed("a mesh", "trimesh")

    shape: Any = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    normals = shape.face_normals
    total = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(total, mesh.faces[:, k], shape.face_angles[:, k, None] * normals)
    lengths = np.linalg.norm(total, axis=1)[:, None]
    mean = (total / np.where(lengths > 0.0, lengths, 1.0))[mesh.faces]
    is_smooth = (normals[:, None, :] * mean).sum(axis=2, keepdims=True) > CREASE
    return np.where(is_smooth, mean, normals[:, None, :]).astype(np.float32)
