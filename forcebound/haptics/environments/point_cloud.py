"""A cloud of points, such as a depth camera gives."""

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, TypeAlias

from forcebound.errors import ConfigError
from forcebound.haptics.environments.touching import PlacedFile
from forcebound.messages.packets import SceneObject
from forcebound.quantities import POSITIVE, Length

if TYPE_CHECKING:
    from forcebound.haptics.geometry.implicit import ImplicitSolid
    from forcebound.haptics.geometry.mesh_file import Cloud

    Sized: TypeAlias = tuple[Cloud, float]

_logger = logging.getLogger(__name__)

SPARSE = 0.02  # of the points; with more the skin has holes
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

    def read(self) -> "Sized":
        """Return the points, and the radius of each, in m."""
        import numpy as np

        from forcebound.haptics.geometry.mesh_file import read_points
        from forcebound.haptics.geometry.points import FEWEST, MOST_CUBES, cubes_of, neighbourhoods

        cloud = read_points(self.path, self.unit)
        nearest = neighbourhoods(cloud.points)
        closing = max(float(np.median(nearest[:, -1])), 1e-9)
        radius = closing if self.radius is None else self.radius
        cubes = cubes_of(cloud.points, radius)
        if cubes > MOST_CUBES:
            least = radius * (cubes / MOST_CUBES) ** (1 / 3)
            raise ConfigError(
                f"a radius of {1e3 * radius:.3g} mm is too small for points so far apart: say a"
                f" radius of at least {1e3 * least:.2g} mm",
                field="radius",
            )
        share = float(np.mean(nearest[:, :FEWEST][:, -1] > radius))
        if share > SPARSE:
            _logger.warning(
                "%s: the skin has holes that a hand falls through: %.0f %% of the points have too"
                " few neighbours within the radius of %.3g mm; say a larger one, or leave out stray"
                " points (most points need %.3g mm)",
                *(self.path, 1e2 * share, 1e3 * radius, 1e3 * closing),
            )
        return cloud, radius

    def place(self, content: "Sized") -> "ImplicitSolid":
        from forcebound.haptics.geometry.implicit import ImplicitSolid
        from forcebound.haptics.geometry.points import CLOUD, cloud_data

        cloud, radius = content
        data = cloud_data(cloud.points, radius, self.position, self.rotation)
        return ImplicitSolid(CLOUD, data, dip=radius / 20, still=1e-3, steps=STEPS)

    def scene(self) -> tuple[SceneObject, ...]:
        return self.drawn("points", self.content()[0].digest)
