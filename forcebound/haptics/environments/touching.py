"""Worlds with a surface: a solid, its proxy and the force between."""

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass, field
from typing import Annotated

from forcebound.haptics.environments import Environment, EnvironmentModel, within_reach
from forcebound.haptics.geometry.proxy import HapticSurface, Solid, Surface
from forcebound.haptics.geometry.vectors import Pose, cut, pad3
from forcebound.messages.packets import Contact, SceneObject, Vector
from forcebound.quantities import NOT_NEGATIVE, Damping, Ranged, Stiffness


@dataclass(frozen=True, kw_only=True)
class Touchable(Ranged, EnvironmentModel, ABC):
    """A solid that the hand touches.

    Attributes:
        stiffness: Of the spring between the device and the proxy.
        damping: Along the surface's normal; it pushes out and never pulls in.
        surface: How it feels.
    """

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.0
    surface: Surface = field(default_factory=Surface)

    @property
    def pose(self) -> Pose:
        """Pose of the coordinates of the solid."""
        return Pose()

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
        self._untouched = HapticSurface(*_what(model))
        self._surfaces: dict[str, HapticSurface] = {}  # by hand: one proxy each
        self._scene: tuple[SceneObject, ...] | None = None  # as soon as somebody asks

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        x, y, z = map(within_reach, pad3(position))
        surface = self._surfaces.get(user)
        if surface is None:
            surface = self._surfaces[user] = copy(self._untouched)
        return cut(surface.touch((x, y, z), pad3(velocity)), self._axes)

    def contact(self, user: str) -> Contact | None:
        surface = self._surfaces.get(user)
        touched = None if surface is None else surface.touched
        if touched is None:
            return None
        return Contact(cut(touched.proxy, self._axes), cut(touched.normal, self._axes))

    def scene(self) -> tuple[SceneObject, ...]:
        if self._scene is None:
            self._scene = self._model.scene()
        return self._scene

    def change(self, model: Touchable) -> bool:
        """Take over other parameters; a proxy stays where it is, unless it is inside now."""
        what = _what(model)
        for surface in (self._untouched, *self._surfaces.values()):
            surface.change(*what)
        self._model, self._scene = model, None
        return True


def _what(model: Touchable) -> tuple[Solid, Surface, float, float, Pose]:
    return model.solid(), model.surface, model.stiffness, model.damping, model.pose
