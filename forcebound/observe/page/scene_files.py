"""What pages draw of the files of a scene: meshes with fewer triangles, clouds with fewer points.

Vertices of a mesh that lie close together become one.

Source: J. Rossignac, P. Borrel, Multi-resolution 3D approximations for rendering complex scenes,
in Modeling in Computer Graphics, Springer 1993.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from forcebound.haptics.geometry.mesh_file import Array, Mesh, read_mesh, read_points

MOST = 3000  # triangles, or points, that a browser without a graphics card draws 30 times a second
FINEST = 256  # cells along the longest edge of the mesh, at first
COARSER = 0.8  # times as many at each further attempt
DIGITS = 6  # of a length in m: nobody sees less than 1 um


def content(thing: Mapping[str, Any]) -> dict[str, object] | None:
    """Return what the file of an object of a scene has to draw, in m; None: it is another one now.

    ``corners`` of the triangles of a mesh, shape (n, 3, 3), or ``points`` of a cloud, shape (n, 3).

    Raises:
        ConfigError: If it cannot be read.
    """
    file, scale = Path(thing["file"]), thing["size"][0] if thing.get("size") else None
    if thing["shape"] == "points":
        cloud = read_points(file, scale)
        points = cloud.points[:: math.ceil(len(cloud.points) / MOST)].round(DIGITS)
        return {"points": points.tolist()} if cloud.digest == thing["digest"] else None
    mesh = read_mesh(file, scale, may_be_open=True)
    corners = coarse(mesh).round(DIGITS)
    return {"corners": corners.tolist()} if mesh.digest == thing["digest"] else None


def coarse(mesh: Mesh, most: int = MOST) -> Array:
    """Return corners of at most ``most`` triangles that look like a mesh, in m, shape (n, 3, 3)."""
    vertices, faces = mesh.vertices, mesh.faces
    low = vertices.min(axis=0)
    length = float((vertices.max(axis=0) - low).max())
    cells = float(FINEST)
    while len(faces) > most:
        places = np.floor((mesh.vertices - low) * (cells / length)).astype(np.int64)
        _, cell, count = np.unique(places, axis=0, return_inverse=True, return_counts=True)
        cell = cell.reshape(-1)
        sums = [np.bincount(cell, weights=column) for column in mesh.vertices.T]
        vertices = np.stack(sums, axis=1) / count[:, None]
        a, b, c = cell[mesh.faces].T
        faces = cell[mesh.faces][(a != b) & (b != c) & (c != a)]
        cells *= COARSER
    corners: Array = vertices[faces]
    return corners
