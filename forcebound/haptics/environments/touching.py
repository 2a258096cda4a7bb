"""Worlds with a surface: a solid, its proxy and the force between; solids from files."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import version_of
from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.haptics.geometry.proxy import HapticSurface, Solid, Surface
from forcebound.haptics.geometry.vectors import Quaternion, cut, unit_quaternion
from forcebound.messages.packets import Contact, SceneObject, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Length,
    Ratio,
    Stiffness,
    check_ranges,
)

RABBIT = Path(__file__).parents[2] / "launch_files" / "rabbit.ply"
CACHED = 4  # files, and solids

#: Length of a file's unit in m; "metres": it is in metres, and refused if it seems not to be.
Scale: TypeAlias = Annotated[Ratio, POSITIVE] | Literal["metres"]


@dataclass(frozen=True, kw_only=True)
class Touchable(EnvironmentModel, ABC):
    """A solid that the hand touches.

    Attributes:
        stiffness: Of the spring between the device and the proxy.
        damping: Along the surface's normal; it pushes out and never pulls in.
        surface: How it feels.
    """

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.0
    surface: Surface = field(default_factory=Surface)

    def __post_init__(self) -> None:
        check_ranges(self)

    @abstractmethod
    def solid(self) -> Solid:
        """Return what the proxy slides on; ConfigError if the file will not do."""

    @abstractmethod
    def scene(self) -> tuple[SceneObject, ...]:
        """Return what there is to draw."""

    def check_files(self) -> None:
        self.surface.check_files()

    def open(self, axes: int) -> "OpenTouchable":
        return OpenTouchable(self, axes)


class OpenTouchable(Environment):
    """An open world with a surface."""

    def __init__(self, model: Touchable, axes: int) -> None:
        self._axes, self._model = axes, model
        self._surface = HapticSurface(
            model.solid(), model.surface, model.stiffness, model.damping, axes
        )

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        return self._surface.touch(position, velocity)

    def contact(self, user: str) -> Contact | None:
        touched = self._surface.touched
        if touched is None:
            return None
        return Contact(cut(touched.proxy, self._axes), cut(touched.normal, self._axes))

    def scene(self) -> tuple[SceneObject, ...]:
        return self._model.scene()

    def change(self, model: Touchable) -> bool:
        """Take over other parameters; the proxy stays where it is, unless it is inside now."""
        self._surface.change(model.solid(), model.surface, model.stiffness, model.damping)
        self._model = model
        return True


@dataclass(frozen=True)
class PlacedFile(Touchable):
    """A solid from a file that the hand touches, somewhere in space.

    Attributes:
        file: The file; null: our rabbit.
        scale: Length of the file's unit in m, such as 0.001; metres: it is in metres, and what is
            beyond 2 m is refused.
        position: Of the file's origin.
        orientation: Of the file's axes, a quaternion w, x, y, z; any length.
    """

    file: Path | None = None
    scale: Scale = "metres"
    position: tuple[Length, Length, Length] = (0.055, 0.0, 0.0)
    orientation: tuple[Ratio, Ratio, Ratio, Ratio] = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.orientation):
            raise ConfigError("orientation must be a rotation, got 0, 0, 0, 0", field="orientation")

    @abstractmethod
    def read(self) -> Any:
        """Return what :meth:`place` needs of the file; ConfigError if it will not do."""

    @abstractmethod
    def place(self, content: Any) -> Solid:
        """Return the content of the file at its place."""

    def check_files(self) -> None:
        super().check_files()
        self.content()

    def content(self) -> Any:
        """Return what :meth:`read` does, kept for the same file and parameters."""
        unplaced = replace(self._without_feel(), position=(0, 0, 0), orientation=(1, 0, 0, 0))
        return _content(replace(unplaced, surface=Surface()), version_of(self.path))

    def solid(self) -> Solid:
        return _solid(self._without_feel(), version_of(self.path))

    def _without_feel(self) -> "PlacedFile":
        surface = Surface(force_shading=self.surface.force_shading)
        return replace(self, stiffness=0.0, damping=0.0, surface=surface)

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


@lru_cache(CACHED)
def _content(model: PlacedFile, version: tuple[int, int]) -> Any:
    return model.read()


@lru_cache(CACHED)
def _solid(model: PlacedFile, version: tuple[int, int]) -> Solid:
    return model.place(model.content())
