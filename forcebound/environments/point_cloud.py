"""A cloud of points, such as a depth camera gives."""

import math
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

from forcebound.environments.mesh import RABBIT, Scale, TriangleMesh, unit_of
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
    Version: TypeAlias = tuple[Path, tuple[int, int], float | None, bool]
    from forcebound.geometry.cloud_file import Cloud
    from forcebound.geometry.implicit import ImplicitSolid

RADII = 2.0  # spacings in the radius of a point where nothing is said
CACHED = 4  # clouds
STEPS = 400  # of an answer, 3 us each


@dataclass(frozen=True)
class PointCloud:
    """A smooth skin around points that the hand touches.

    Attributes:
        file: An array of one row for each point, x, y, z in m (.npy), or the corners in a .ply
            file. Nothing: those of our rabbit.
        radius: Of each point; nothing: twice the median distance between neighbours. The skin lies
            a little more than that away from the points; gaps wider than twice as much are holes.
        scale: Length of the file's unit in m, such as 0.001; metres: it is in metres, and a cloud
            beyond 2 m is refused.
        position: Of the file's origin.
        orientation: Of the file's axes, a quaternion w, x, y, z; any length.
        stiffness: Of the spring between the device and the proxy.
        damping: Along the surface's normal; it pushes out and never pulls in.
        surface: How it feels.
    """

    file: Path | None = None
    radius: Annotated[Length, POSITIVE] | None = None
    scale: Scale = "metres"
    position: tuple[Length, Length, Length] = (0.055, 0.0, 0.0)
    orientation: tuple[Ratio, Ratio, Ratio, Ratio] = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.0
    surface: Surface = field(default_factory=Surface)

    def __post_init__(self) -> None:
        check_ranges(self)
        if not any(self.orientation):
            raise ConfigError("orientation must be a rotation, got 0, 0, 0, 0", field="orientation")

    def check_files(self) -> None:
        """Read the points and the texture.

        Raises:
            ConfigError: If one will not do.
        """
        _radius(self._version(), self.radius)
        self.surface.check_files()

    def solid(self) -> "ImplicitSolid":
        """Return what the proxy slides on.

        Raises:
            ConfigError: As :meth:`check_files`.
        """
        orientation = unit_quaternion(self.orientation)
        return _solid(self._version(), self.radius, self.position, orientation)

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the points."""
        return (
            SceneObject(
                name="points",
                shape="points",
                position=self.position,
                orientation=unit_quaternion(self.orientation),
                size=(unit_of(self.scale) or 1.0,),
                file=str(self._path),
                digest=_cloud(self._version()).digest,
            ),
        )

    def open(self, axes: int) -> OpenTouchable:
        """Return a new instance; see :class:`forcebound.environments.StatefulEnvironment`."""
        return OpenTouchable(self, axes)

    @property
    def _path(self) -> Path:
        return RABBIT if self.file is None else self.file

    def _version(self) -> "Version":
        return TriangleMesh(self._path, self.scale).version()


@lru_cache(CACHED)
def _cloud(version: "Version") -> "Cloud":
    from forcebound.geometry.cloud_file import read_points

    return read_points(version[0], version[2])


@lru_cache(CACHED)
def _radius(version: "Version", radius: float | None) -> float:
    """The radius of a point, the one that is given if there is one."""
    from forcebound.geometry.points import MOST_CUBES, cubes_of, spacing_of

    points = _cloud(version).points
    radius = RADII * spacing_of(points) if radius is None else radius
    cubes = cubes_of(points, radius)
    if cubes > MOST_CUBES:
        least = radius * (cubes / MOST_CUBES) ** (1 / 3)
        raise ConfigError(
            f"a radius of {1e3 * radius:.3g} mm is too small for points so far apart: say a radius"
            f" of at least {1e3 * least:.2g} mm",
            field="radius",
        )
    return radius


@lru_cache(CACHED)
def _solid(
    version: "Version", radius: float | None, position: Vector3, orientation: Quaternion
) -> "ImplicitSolid":
    from forcebound.geometry.implicit import ImplicitSolid
    from forcebound.geometry.points import CLOUD, cloud_data

    size = _radius(version, radius)
    data = cloud_data(_cloud(version).points, size, position, orientation)
    return ImplicitSolid(CLOUD, data, dip=size / 20, still=1e-3, steps=STEPS)
