"""A solid as distances on a grid, from a mesh or an array."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated

from forcebound.environments.mesh import TriangleMesh
from forcebound.environments.placed_file import PlacedFile
from forcebound.errors import ConfigError
from forcebound.folders import cache_folder
from forcebound.geometry.vectors import Vector3
from forcebound.messages.packets import SceneObject
from forcebound.quantities import POSITIVE, Length

if TYPE_CHECKING:
    from forcebound.geometry.grid import Grid
    from forcebound.geometry.implicit import ImplicitSolid

CACHED = 4  # grids
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
        """Return the grid; see :class:`forcebound.environments.placed_file.PlacedFile`."""
        origin = self.origin if self._is_array else None
        return _grid(
            TriangleMesh(file=self.file, scale=self.scale), self.version(), self.spacing, origin
        )

    def solid(self) -> "ImplicitSolid":
        """Return what the proxy slides on; see there."""
        from forcebound.geometry.grid import GRID, grid_data
        from forcebound.geometry.implicit import ImplicitSolid

        grid = self.read()
        data = grid_data(grid, self.position, self.rotation)
        return ImplicitSolid(GRID, data, dip=grid.spacing / 20, still=1e-3)

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the mesh; nothing of an array."""
        if self._is_array:
            return ()
        return TriangleMesh(self.file, self.scale, self.position, self.orientation).scene()

    @property
    def _is_array(self) -> bool:
        return self.file is not None and self.file.suffix.lower() == ".npy"


@lru_cache(CACHED)
def _grid(
    mesh: TriangleMesh, version: object, spacing: float | None, origin: Vector3 | None
) -> "Grid":
    from forcebound.geometry.grid_file import mesh_grid, read_grid

    if origin is not None:
        assert spacing is not None
        return read_grid(mesh.path, spacing, origin)
    triangles = mesh.read()
    if spacing is None:
        corners = triangles.corners.reshape(-1, 3)
        spacing = float((corners.max(axis=0) - corners.min(axis=0)).max()) / SHARE
    return mesh_grid(triangles, spacing, cache_folder("grids"))
