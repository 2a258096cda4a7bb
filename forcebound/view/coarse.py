"""A mesh with fewer triangles, to be drawn: vertices that lie close together become one.

Source: J. Rossignac, P. Borrel, Multi-resolution 3D approximations for rendering complex scenes,
in Modeling in Computer Graphics, Springer 1993.
"""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from forcebound.geometry.mesh_file import Array, Mesh

MOST = 3000  # triangles that a browser without a graphics card draws 30 times a second
FINEST = 256  # cells along the longest edge of the mesh, at first
COARSER = 0.8  # times as many at each further attempt


def coarse(mesh: "Mesh", most: int = MOST) -> "Array":
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
