"""A triangle mesh from a file."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from forcebound.haptics.environments.touching import PlacedFile
from forcebound.messages.packets import SceneObject

if TYPE_CHECKING:
    from forcebound.haptics.geometry.god_object import MeshSolid
    from forcebound.haptics.geometry.mesh_file import Mesh


@dataclass(frozen=True)
class TriangleMesh(PlacedFile):
    """A triangle mesh that the hand touches: spring, damper and surface around a god-object.

    Attributes:
        file: STL, OBJ or PLY; closed, with 2 million triangles at most. Null: our rabbit.
        may_be_open: Whether the mesh may have holes. The tip gets through them, and nowhere else.
    """

    may_be_open: bool = False

    def read(self) -> "Mesh":
        from forcebound.haptics.geometry.mesh_file import read_mesh

        return read_mesh(self.path, self.unit, self.may_be_open)

    def place(self, content: "Mesh") -> "MeshSolid":
        from forcebound.haptics.geometry.god_object import placed

        return placed(content, self.position, self.rotation, self.surface.force_shading)

    def solid(self) -> "MeshSolid":
        kept: MeshSolid = super().solid()  # type: ignore[assignment]
        return kept.own()

    def scene(self) -> tuple[SceneObject, ...]:
        return self.drawn("mesh", self.content().digest)
