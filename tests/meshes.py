"""Triangle meshes of known shape, as vertices (n, 3), in m, and faces (m, 3), outward."""

from typing import Any, TypeAlias

import numpy as np

from forcebound.haptics.geometry.bounding_volumes import TriangleTree
from forcebound.haptics.geometry.god_object import MeshSolid

Mesh: TypeAlias = tuple[Any, Any]

BOX_FACES = np.array(
    [
        *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
        *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
    ]
)


def rounded(vertices: Any) -> Any:
    """Vertices as the tree rounds them."""
    return np.asarray(vertices, np.float32).astype(float)


def box(x: float = 0.0625, y: float = 0.0625, z: float = 0.0625) -> Mesh:
    """A box around the origin; half of each edge is given."""
    corners = [(i, j, k) for i in (-x, x) for j in (-y, y) for k in (-z, z)]
    return rounded(corners), BOX_FACES


def sphere(radius: float, subdivisions: int) -> Mesh:
    """A sphere of triangles: an octahedron, each face of which is divided in four, repeatedly."""
    vertices = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1.0)])
    faces = np.array(
        [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    )
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [(0, 1), (1, 2), (2, 0)]].reshape(-1, 2), axis=1)
        edges, which = np.unique(edges, axis=0, return_inverse=True)
        middle = len(vertices) + which.reshape(-1, 3)
        vertices = np.vstack([vertices, vertices[edges].mean(axis=1)])
        a, b, c = faces.T
        ab, bc, ca = middle.T
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.vstack([np.stack(part, axis=1) for part in parts])
    return rounded(radius * vertices / np.linalg.norm(vertices, axis=1)[:, None]), faces


def bumpy(subdivisions: int) -> Mesh:
    """A closed mesh with bumps and dents, about 10 cm across."""
    vertices, faces = sphere(1.0, subdivisions)
    x, y, z = vertices.T
    height = 0.1 * np.sin(9 * x) * np.sin(7 * y + z) + 0.02 * np.sin(31 * y) * np.sin(37 * z)
    return rounded(0.05 * vertices * (1.0 + height)[:, None]), faces


def prism(outline: list[tuple[float, float]], height: float) -> Mesh:
    """A convex or star-shaped outline (around its first point), counter-clockwise, along z."""
    count = len(outline)
    vertices = [(x, y, z) for z in (-height, height) for x, y in outline]
    faces = [(0, k + 1, k) for k in range(1, count - 1)]
    faces += [(count, count + k, count + k + 1) for k in range(1, count - 1)]
    for k in range(count):
        n = (k + 1) % count
        faces += [(k, n, count + n), (k, count + n, count + k)]
    return rounded(vertices), np.array(faces)


def solid(mesh: Mesh, is_closed: bool = True) -> MeshSolid:
    """A mesh that the proxy slides on."""
    vertices, faces = mesh
    return MeshSolid(TriangleTree(vertices[faces]), is_closed)
