"""An open world that has a surface: a solid, its proxy and the force between."""

from typing import Protocol

from forcebound.environments import Environment
from forcebound.geometry.proxy import HapticSurface, Solid, Surface
from forcebound.geometry.vectors import cut
from forcebound.messages.packets import Contact, SceneObject, Vector


class Touchable(Protocol):
    """The model of a world with a surface: what its dataclass has."""

    @property
    def stiffness(self) -> float:
        """Return the stiffness of the spring between device and proxy, in N/m."""
        ...

    @property
    def damping(self) -> float:
        """Return the damping along the normal, in N s/m."""
        ...

    @property
    def surface(self) -> Surface:
        """Return how the surface feels."""
        ...

    def solid(self) -> Solid:
        """Return what the proxy slides on, ready for the first question.

        Asked again after a change of parameters: what costs time is kept for the same ones.
        """
        ...

    def scene(self) -> tuple[SceneObject, ...]:
        """Return what there is to draw."""
        ...


class OpenTouchable(Environment):
    """An :class:`forcebound.environments.Environment` of a model with a surface."""

    def __init__(self, model: Touchable, axes: int) -> None:
        self._axes = axes
        self._model = model
        self._surface = HapticSurface(
            model.solid(), model.surface, model.stiffness, model.damping, axes
        )

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the surface's force; see :class:`forcebound.environments.Environment`."""
        return self._surface.touch(position, velocity, elapsed)

    def contact(self, user: str) -> Contact | None:
        """Return what the last question touched; None: free motion."""
        touched = self._surface.touched
        if touched is None:
            return None
        return Contact(cut(touched.proxy, self._axes), cut(touched.normal, self._axes))

    def scene(self) -> tuple[SceneObject, ...]:
        """Return what there is to draw."""
        return self._model.scene()

    def change(self, model: Touchable) -> bool:
        """Take over other parameters; the proxy stays where it is, unless it is inside now."""
        self._surface.change(model.solid(), model.surface, model.stiffness, model.damping)
        self._model = model
        return True
