"""A cloud of points, such as a depth camera gives."""

import logging
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

from forcebound.environments.placed_file import PlacedFile
from forcebound.errors import ConfigError
from forcebound.geometry.vectors import Quaternion, Vector3
from forcebound.messages.packets import SceneObject
from forcebound.quantities import POSITIVE, Length

if TYPE_CHECKING:
    Version: TypeAlias = tuple[Path, tuple[int, int], float | None]
    from forcebound.geometry.cloud_file import Cloud
    from forcebound.geometry.implicit import ImplicitSolid

_logger = logging.getLogger(__name__)

SPARSE = 0.02  # of the points; with more the skin has holes
CACHED = 4  # clouds
STEPS = 400  # of an answer, 3 us each


@dataclass(frozen=True)
class PointCloud(PlacedFile):
    """A smooth skin around points that the hand touches.

    Attributes:
        file: An array of one row for each point, x, y, z in m (.npy), or the corners in a .ply
            file. Null: those of our rabbit.
        radius: Of each point; null: the median distance to the 16th neighbour. The skin lies a
            little more than that away from the points; gaps wider than twice as much are holes.
    """

    radius: Annotated[Length, POSITIVE] | None = None

    def read(self) -> float:
        """Return the radius; see :class:`forcebound.environments.placed_file.PlacedFile`."""
        return _radius(self._content(), self.radius)

    def solid(self) -> "ImplicitSolid":
        """Return what the proxy slides on; see there."""
        return _solid(self._content(), self.radius, self.position, self.rotation)

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the points."""
        return self.drawn("points", _cloud(self._content()).digest)

    def _content(self) -> "Version":
        return self.path, self.version(), self.unit


@lru_cache(CACHED)
def _cloud(version: "Version") -> "Cloud":
    from forcebound.geometry.cloud_file import read_points

    return read_points(version[0], version[2])


@lru_cache(CACHED)
def _radius(version: "Version", radius: float | None) -> float:
    """The radius of a point, the one that is given if there is one."""
    import numpy as np

    from forcebound.geometry.points import FEWEST, MOST_CUBES, cubes_of, neighbourhoods

    points = _cloud(version).points
    nearest = neighbourhoods(points)
    closing = max(float(np.median(nearest[:, -1])), 1e-9)
    radius = closing if radius is None else radius
    cubes = cubes_of(points, radius)
    if cubes > MOST_CUBES:
        least = radius * (cubes / MOST_CUBES) ** (1 / 3)
        raise ConfigError(
            f"a radius of {1e3 * radius:.3g} mm is too small for points so far apart: say a radius"
            f" of at least {1e3 * least:.2g} mm",
            field="radius",
        )
    share = float(np.mean(nearest[:, :FEWEST][:, -1] > radius))
    if share > SPARSE:
        _logger.warning(
            "%s: the skin has holes that a hand falls through: %.0f %% of the points have too few"
            " neighbours within the radius of %.3g mm; say a larger one, or leave out stray points"
            " (most points need %.3g mm)",
            *(version[0], 1e2 * share, 1e3 * radius, 1e3 * closing),
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
