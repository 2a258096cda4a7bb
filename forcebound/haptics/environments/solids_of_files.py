"""Solids from files: triangle meshes, distances on a grid, clouds of points."""

import filecmp
import logging
import math
from abc import abstractmethod
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import version_of
from forcebound.haptics.environments.touching import Touchable
from forcebound.haptics.geometry.proxy import Solid, Surface
from forcebound.haptics.geometry.vectors import NO_ROTATION, ZERO, Pose, unit_quaternion
from forcebound.messages.packets import SceneObject
from forcebound.quantities import POSITIVE, Length, Range, Ratio

if TYPE_CHECKING:  # they need numpy and trimesh, which take a while
    from forcebound.haptics.geometry.grid import Grid
    from forcebound.haptics.geometry.mesh_file import Cloud, Mesh

RABBIT = Path(__file__).parents[2] / "launch_files" / "rabbit.ply"
RABBIT_POSE = Pose((0.055, 0.0, 0.0), (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0))
CACHED = 4  # files, and solids
SHARE = 100  # spacings in the longest edge of a mesh where nothing is said
SPARSE = 0.02  # of the points; with more the skin has holes
STEPS = 400  # of an answer of a cloud, 3 us each

#: Length of a file's unit in m; "metres": it is in metres, and refused if it seems not to be.
Scale: TypeAlias = Annotated[Ratio, POSITIVE] | Literal["metres"]

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PlacedFile(Touchable):
    """A solid from a file that the hand touches, somewhere in space.

    Attributes:
        file: The file; null: our rabbit.
        scale: Length of the file's unit in m, such as 0.001; metres: it is in metres, and what is
            beyond 2 m is refused.
        position: Of the file's origin; null: 0, or where our rabbit has its back at the hand.
        orientation: Of the file's axes, a quaternion w, x, y, z, of any length; null: not turned,
            or as our rabbit stands.
    """

    drawn_as: ClassVar[Literal["mesh", "points"]] = "mesh"

    file: Path | None = None
    scale: Scale = "metres"
    position: tuple[Length, Length, Length] | None = None
    orientation: tuple[Ratio, Ratio, Ratio, Ratio] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.orientation is not None and not any(self.orientation):
            raise ConfigError("orientation must be a rotation, got 0, 0, 0, 0", field="orientation")

    @abstractmethod
    def read(self) -> Any:
        """Return what :meth:`shape` needs of the file; ConfigError if it will not do."""

    @abstractmethod
    def shape(self, content: Any) -> Solid:
        """Return the content of the file as a solid."""

    def check_files(self) -> None:
        super().check_files()
        self.content()

    def content(self) -> Any:
        """Return what :meth:`read` does, kept for the same file and parameters."""
        return _content(self._alone(), version_of(self.path))

    def solid(self) -> Solid:
        return _solid(self._alone(), version_of(self.path))

    def scene(self) -> tuple[SceneObject, ...]:
        return (
            SceneObject(
                name=self.drawn_as,
                shape=self.drawn_as,
                position=self.pose.position,
                orientation=self.pose.orientation,
                size=(self.unit or 1.0,),
                file=str(self.path),
                digest=self.content().digest,
            ),
        )

    def _alone(self) -> "PlacedFile":
        """The same without what is not in the file."""
        still = replace(self, position=ZERO, orientation=NO_ROTATION)
        return replace(still, stiffness=0.0, damping=0.0, surface=Surface())

    @property
    def path(self) -> Path:
        """The file."""
        return RABBIT if self.file is None else self.file

    @property
    def unit(self) -> float | None:
        """Length of the file's unit, in m; None: metres, if the size looks so."""
        return None if isinstance(self.scale, str) else self.scale

    @property
    def pose(self) -> Pose:
        usual = RABBIT_POSE if _is_rabbit(self.path) else Pose()
        place = usual.position if self.position is None else self.position
        turned = usual.orientation if self.orientation is None else self.orientation
        return Pose(place, unit_quaternion(turned))


def _is_rabbit(path: Path) -> bool:
    """Return whether this is our rabbit or a copy; other files keep their coordinates."""
    with suppress(OSError):
        return filecmp.cmp(path, RABBIT, shallow=False)
    return False


@lru_cache(CACHED)
def _content(model: PlacedFile, version: tuple[int, int]) -> Any:
    return model.read()


@lru_cache(CACHED)
def _solid(model: PlacedFile, version: tuple[int, int]) -> Solid:
    return model.shape(model.content())


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

    def shape(self, content: "Mesh") -> Solid:
        from forcebound.haptics.geometry.god_object import MeshSolid

        return MeshSolid.of(content)


@dataclass(frozen=True)
class DistanceField(PlacedFile):
    """Distances on a grid, exact in a narrow band about the surface, that the hand touches.

    Attributes:
        file: A closed mesh (STL, OBJ, PLY), whose grid is made; or a grid of distances in m,
            negative inside, as a numpy array of three axes (.npy). Null: our rabbit.
        spacing: Of the grid; null: a hundredth of the mesh's longest edge. What is thinner than a
            few is not felt. An array needs it.
        origin: Of an array, the place of its first number.
    """

    spacing: Annotated[Length, Range(at_least=1e-6)] | None = None
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
        longest = float((mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)).max())
        return mesh_grid(mesh, self.spacing or longest / SHARE)

    def shape(self, content: "Grid") -> Solid:
        from forcebound.haptics.geometry.grid import GRID
        from forcebound.haptics.geometry.implicit import ImplicitSolid

        return ImplicitSolid(GRID, content, dip=float(content.place[3]) / 20, still=1e-3)

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the mesh; nothing of an array."""
        return () if self._is_array else self._mesh().scene()

    def _mesh(self) -> TriangleMesh:
        return TriangleMesh(self.file, self.scale, self.position, self.orientation)

    @property
    def _is_array(self) -> bool:
        return self.file is not None and self.file.suffix.lower() == ".npy"


@dataclass(frozen=True)
class PointCloud(PlacedFile):
    """A smooth skin around points that the hand touches.

    Attributes:
        file: An array of one row for each point, x, y, z in m (.npy), or the corners in a .ply
            file. Null: those of our rabbit.
        radius: Of each point; null: the median distance to the 16th neighbour. The skin lies a
            little more than that away from the points; gaps wider than twice as much are holes.
    """

    drawn_as: ClassVar[Literal["mesh", "points"]] = "points"

    radius: Annotated[Length, POSITIVE] | None = None

    def read(self) -> "Cloud":
        from forcebound.haptics.geometry.mesh_file import read_points

        return read_points(self.path, self.unit)

    def shape(self, content: "Cloud") -> Solid:
        import numpy as np

        from forcebound.haptics.geometry.implicit import ImplicitSolid
        from forcebound.haptics.geometry.points import CLOUD, FEWEST, cloud_data, neighbourhoods

        nearest = neighbourhoods(content.points)
        spacing = max(float(np.median(nearest[:, -1])), 1e-9)
        radius = spacing if self.radius is None else self.radius
        share = float(np.mean(nearest[:, :FEWEST][:, -1] > radius))
        if share > SPARSE:
            _logger.warning(
                "%s: the skin has holes that a hand falls through: %.0f %% of the points have too"
                " few neighbours within the radius of %.3g mm; say a larger one, or leave out stray"
                " points (most points need %.3g mm)",
                *(self.path, 1e2 * share, 1e3 * radius, 1e3 * spacing),
            )
        data = cloud_data(content.points, radius)
        return ImplicitSolid(CLOUD, data, dip=radius / 20, still=1e-3, steps=STEPS)
