"""A world in a file, somewhere in space: what meshes, fields and clouds have in common."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from forcebound.environments import EnvironmentModel
from forcebound.environments.touching import OpenTouchable
from forcebound.errors import ConfigError
from forcebound.files import version_of
from forcebound.geometry.proxy import Solid, Surface
from forcebound.geometry.vectors import Quaternion, unit_quaternion
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

RABBIT = Path(__file__).parent.parent / "launch" / "rabbit.ply"

#: Length of a file's unit in m; "metres": it is in metres, and refused if it seems not to be.
Scale: TypeAlias = Annotated[Ratio, POSITIVE] | Literal["metres"]


@dataclass(frozen=True)
class PlacedFile(EnvironmentModel, ABC):
    """A solid from a file that the hand touches.

    Attributes:
        file: The file; null: our rabbit.
        scale: Length of the file's unit in m, such as 0.001; metres: it is in metres, and what is
            beyond 2 m is refused.
        position: Of the file's origin.
        orientation: Of the file's axes, a quaternion w, x, y, z; any length.
        stiffness: Of the spring between the device and the proxy.
        damping: Along the surface's normal; it pushes out and never pulls in.
        surface: How it feels.
    """

    file: Path | None = None
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
        """Read the file, and that of the texture.

        Raises:
            ConfigError: If one will not do.
        """
        self.read()
        self.surface.check_files()

    @abstractmethod
    def read(self) -> object:
        """Read the file, once for the same parameters.

        Raises:
            ConfigError: If it will not do.
        """

    @abstractmethod
    def solid(self) -> Solid:
        """Return what the proxy slides on.

        Raises:
            ConfigError: As :meth:`read`.
        """

    @abstractmethod
    def scene(self) -> tuple[SceneObject, ...]:
        """Return what there is to draw."""

    def drawn(self, shape: Literal["mesh", "points"], digest: str) -> tuple[SceneObject, ...]:
        """Return the file at its place, to draw, under the name of its shape."""
        return (
            SceneObject(
                name=shape,
                shape=shape,
                position=self.position,
                orientation=self.rotation,
                size=(self.unit or 1.0,),
                file=str(self.path),
                digest=digest,
            ),
        )

    def open(self, axes: int) -> OpenTouchable:
        """Return a new instance; see :class:`forcebound.environments.EnvironmentModel`."""
        return OpenTouchable(self, axes)

    @property
    def path(self) -> Path:
        """The file."""
        return RABBIT if self.file is None else self.file

    @property
    def unit(self) -> float | None:
        """Length of the file's unit, in m; None: metres, if the size looks so."""
        return None if isinstance(self.scale, str) else self.scale

    @property
    def rotation(self) -> Quaternion:
        """The orientation, of length 1."""
        return unit_quaternion(self.orientation)

    def version(self) -> tuple[int, int]:
        """Return what tells this content of the file from another one."""
        return version_of(self.path)
