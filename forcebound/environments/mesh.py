"""A triangle mesh from a file."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from forcebound.environments.placed_file import PlacedFile
from forcebound.geometry.vectors import Quaternion, Vector3
from forcebound.messages.packets import SceneObject

if TYPE_CHECKING:
    from forcebound.geometry.god_object import MeshSolid
    from forcebound.geometry.mesh_file import Mesh

CACHED = 4  # meshes


@dataclass(frozen=True)
class TriangleMesh(PlacedFile):
    """A triangle mesh that the hand touches: spring, damper and surface around a god-object.

    Attributes:
        file: STL, OBJ or PLY; closed, with 2 million triangles at most. Null: our rabbit.
        may_be_open: Whether the mesh may have holes. The tip gets through them, and nowhere else.
    """

    may_be_open: bool = False

    def read(self) -> "Mesh":
        """Return the mesh; see :class:`forcebound.environments.placed_file.PlacedFile`."""
        return _mesh(self.path, self.version(), self.unit, self.may_be_open)

    def solid(self) -> "MeshSolid":
        """Return what the proxy slides on; see there."""
        return _solid(
            self.path,
            self.version(),
            self.unit,
            self.may_be_open,
            self.position,
            self.rotation,
            self.surface.force_shading,
        ).own()

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the mesh."""
        return self.drawn("mesh", self.read().digest)


@lru_cache(CACHED)
def _mesh(file: Path, version: tuple[int, int], scale: float | None, may_be_open: bool) -> "Mesh":
    from forcebound.geometry.mesh_file import read_mesh

    return read_mesh(file, scale, may_be_open)


@lru_cache(CACHED)
def _solid(
    file: Path,
    version: tuple[int, int],
    scale: float | None,
    may_be_open: bool,
    position: Vector3,
    orientation: Quaternion,
    is_shaded: bool,
) -> "MeshSolid":
    """Return the solid of a mesh at its place."""
    from forcebound.geometry.god_object import placed

    mesh = _mesh(file, version, scale, may_be_open)
    return placed(mesh, position, orientation, is_shaded)
