"""A solid as distances on a grid, from a mesh or an array."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from forcebound.errors import ConfigError
from forcebound.folders import cache_folder
from forcebound.haptics.environments.mesh import TriangleMesh
from forcebound.haptics.environments.touching import PlacedFile
from forcebound.messages.packets import SceneObject
from forcebound.quantities import POSITIVE, Length

if TYPE_CHECKING:
    from forcebound.haptics.geometry.grid import Grid
    from forcebound.haptics.geometry.implicit import ImplicitSolid

SHARE = 100  # spacings in the longest edge of a mesh where nothing is said


@dataclass(frozen=True)
class DistanceField(PlacedFile):
    """Distances on a grid, exact in a narrow band about the surface, that the hand touches.

    Attributes:
        file: A closed mesh (STL, OBJ, PLY), whose grid is made and kept on disk; or a grid of
            distances in m, negative inside, as a numpy array of three axes (.npy). Null: our
            rabbit.
        spacing: Of the grid; null: a hundredth of the mesh's longest edge. What is thinner than a
            few is not felt. An array needs it.
        origin: Of an array, the place of its first number.
    """

    spacing: Annotated[Length, POSITIVE] | None = None
    origin: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self._is_array and self.spacing is None:
            raise ConfigError(f"{self.file} needs `spacing`, between two neighbours", field="file")

    def read(self) -> "Grid":
        from forcebound.haptics.geometry.grid import mesh_grid, read_grid

        if self._is_array:
            assert self.spacing is not None  # __post_init__
            return read_grid(self.path, self.spacing, self.origin)
        mesh = self._mesh().content()
        spacing = self.spacing
        if spacing is None:
            spacing = float((mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)).max()) / SHARE
        return mesh_grid(mesh, spacing, cache_folder("grids"))

    def place(self, content: "Grid") -> "ImplicitSolid":
        from forcebound.haptics.geometry.grid import GRID, grid_data
        from forcebound.haptics.geometry.implicit import ImplicitSolid

        data = grid_data(content, self.position, self.rotation)
        return ImplicitSolid(GRID, data, dip=content.spacing / 20, still=1e-3)

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the mesh; nothing of an array."""
        return () if self._is_array else self._mesh().scene()

    def _mesh(self) -> TriangleMesh:
        return TriangleMesh(self.file, self.scale, self.position, self.orientation)

    @property
    def _is_array(self) -> bool:
        return self.file is not None and self.file.suffix.lower() == ".npy"
