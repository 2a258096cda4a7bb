"""A triangle mesh from a file."""

import math
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from forcebound.environments.touching import OpenTouchable
from forcebound.errors import ConfigError
from forcebound.geometry.proxy import Surface
from forcebound.geometry.vectors import Quaternion, Vector3, unit_quaternion
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
    from forcebound.geometry.god_object import MeshSolid
    from forcebound.geometry.mesh_file import Mesh

RABBIT = Path(__file__).parent.parent / "launch" / "rabbit.ply"
CACHED = 4  # meshes

#: Length of a file's unit in m; "metres": it is in metres, and refused if it seems not to be.
Scale: TypeAlias = Annotated[Ratio, POSITIVE] | Literal["metres"]


def unit_of(scale: Scale) -> float | None:
    """Return the length of the unit, in m; None: metres, if the size looks so."""
    return None if isinstance(scale, str) else scale


@dataclass(frozen=True)
class TriangleMesh:
    """A triangle mesh that the hand touches: spring, damper and surface around a god-object.

    Attributes:
        file: STL, OBJ or PLY; closed, with 2 million triangles at most. Nothing: our rabbit.
        scale: Length of the file's unit in m, such as 0.001; metres: it is in metres, and a mesh
            beyond 2 m is refused.
        position: Of the file's origin.
        orientation: Of the file's axes, a quaternion w, x, y, z; any length.
        may_be_open: Whether the mesh may have holes. The tip gets through them, and nowhere else.
        stiffness: Of the spring between the device and the proxy.
        damping: Along the surface's normal; it pushes out and never pulls in.
        surface: How it feels.
    """

    file: Path | None = None
    scale: Scale = "metres"
    position: tuple[Length, Length, Length] = (0.055, 0.0, 0.0)
    orientation: tuple[Ratio, Ratio, Ratio, Ratio] = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
    may_be_open: bool = False
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.0
    surface: Surface = field(default_factory=Surface)

    def __post_init__(self) -> None:
        check_ranges(self)
        if not any(self.orientation):
            raise ConfigError("orientation must be a rotation, got 0, 0, 0, 0", field="orientation")

    def check_files(self) -> None:
        """Read the mesh and the texture.

        Raises:
            ConfigError: If one will not do.
        """
        self.mesh()
        self.surface.check_files()

    def solid(self) -> "MeshSolid":
        """Return what the proxy slides on.

        Raises:
            ConfigError: As :meth:`check_files`.
        """
        place = self.position, unit_quaternion(self.orientation)
        return _solid(*self.version(), *place, self.surface.force_shading).own()

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the mesh."""
        return (
            SceneObject(
                name="mesh",
                shape="mesh",
                position=self.position,
                orientation=unit_quaternion(self.orientation),
                size=(unit_of(self.scale) or 1.0,),
                file=str(self.path),
                digest=self.mesh().digest,
            ),
        )

    def open(self, axes: int) -> OpenTouchable:
        """Return a new instance; see :class:`forcebound.environments.StatefulEnvironment`."""
        return OpenTouchable(self, axes)

    @property
    def path(self) -> Path:
        """The file."""
        return RABBIT if self.file is None else self.file

    def version(self) -> tuple[Path, tuple[int, int], float | None, bool]:
        """Return what tells this content of the file from another one, and how it is read."""
        try:
            status = self.path.stat()
            version = (status.st_mtime_ns, status.st_size)
        except (OSError, ValueError):
            version = (0, 0)  # reading it says what is wrong
        return self.path, version, unit_of(self.scale), self.may_be_open

    def mesh(self) -> "Mesh":
        """Return the mesh, read once.

        Raises:
            ConfigError: As :meth:`check_files`.
        """
        return _mesh(*self.version())


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
