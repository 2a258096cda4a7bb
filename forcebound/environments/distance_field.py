"""A solid as distances on a grid, from a mesh or an array."""

import math
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from forcebound.environments.mesh import Scale, TriangleMesh
from forcebound.environments.touching import OpenTouchable
from forcebound.errors import ConfigError
from forcebound.folders import cache_folder
from forcebound.geometry.proxy import Surface
from forcebound.geometry.vectors import Vector3, unit_quaternion
from forcebound.messages.packets import SceneObject
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Length,
    Ratio,
    Stiffness,
    check_ranges,
)

if TYPE_CHECKING:
    from forcebound.geometry.grid import Grid
    from forcebound.geometry.implicit import ImplicitSolid

CACHED = 4  # grids
SHARE = 100  # spacings in the longest edge of a mesh where nothing is said


@dataclass(frozen=True)
class DistanceField:
    """Distances on a grid, exact in a narrow band about the surface, that the hand touches.

    Attributes:
        file: A closed mesh (STL, OBJ, PLY), whose grid is made and kept on disk; or a grid of
            distances in m, negative inside, as a numpy array of three axes (.npy). Nothing: our
            rabbit.
        spacing: Of the grid; nothing: a hundredth of the mesh's longest edge. What is thinner than
            a few is not felt. An array needs it.
        scale: Length of the mesh's unit in m, such as 0.001; metres: it is in metres.
        origin: Of an array, the place of its first number.
        position: Of the file's origin.
        orientation: Of the file's axes, a quaternion w, x, y, z; any length.
        stiffness: Of the spring between the device and the proxy.
        damping: Along the surface's normal; it pushes out and never pulls in.
        surface: How it feels.
    """

    file: Path | None = None
    spacing: Annotated[Length, POSITIVE] | None = None
    scale: Scale = "metres"
    origin: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    position: tuple[Length, Length, Length] = (0.055, 0.0, 0.0)
    orientation: tuple[Ratio, Ratio, Ratio, Ratio] = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.0
    surface: Surface = field(default_factory=Surface)

    def __post_init__(self) -> None:
        check_ranges(self)
        if not any(self.orientation):
            raise ConfigError("orientation must be a rotation, got 0, 0, 0, 0", field="orientation")
        if self._is_array and self.spacing is None:
            raise ConfigError(f"{self.file} needs `spacing`, between two neighbours", field="file")

    def check_files(self) -> None:
        """Read the array or the mesh, whose grid is made, and the texture.

        Raises:
            ConfigError: If one will not do.
        """
        self._grid()
        self.surface.check_files()

    def solid(self) -> "ImplicitSolid":
        """Return what the proxy slides on.

        Raises:
            ConfigError: As :meth:`check_files`.
        """
        from forcebound.geometry.grid import GRID, grid_data
        from forcebound.geometry.implicit import ImplicitSolid

        grid = self._grid()
        data = grid_data(grid, self.position, unit_quaternion(self.orientation))
        return ImplicitSolid(GRID, data, dip=grid.spacing / 20, still=1e-3)

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the mesh; nothing of an array."""
        if self._is_array:
            return ()
        mesh = TriangleMesh(
            self.file, self.scale, position=self.position, orientation=self.orientation
        )
        return mesh.scene()

    def open(self, axes: int) -> OpenTouchable:
        """Return a new instance; see :class:`forcebound.environments.StatefulEnvironment`."""
        return OpenTouchable(self, axes)

    @property
    def _is_array(self) -> bool:
        return self.file is not None and self.file.suffix.lower() == ".npy"

    def _grid(self) -> "Grid":
        mesh = TriangleMesh(self.file, self.scale)
        return _grid(mesh, mesh.version(), self.spacing, self.origin if self._is_array else None)


@lru_cache(CACHED)
def _grid(
    mesh: TriangleMesh, version: object, spacing: float | None, origin: Vector3 | None
) -> "Grid":
    from forcebound.geometry.grid_file import mesh_grid, read_grid

    if origin is not None:
        assert spacing is not None
        return read_grid(mesh.path, spacing, origin)
    triangles = mesh.mesh()
    if spacing is None:
        corners = triangles.corners.reshape(-1, 3)
        spacing = float((corners.max(axis=0) - corners.min(axis=0)).max()) / SHARE
    return mesh_grid(triangles, spacing, cache_folder("grids"))
