"""An environment inside another one, which passes all calls on."""

from collections.abc import Collection
from typing import Any

from forcebound.haptics.environments import (
    Environment,
    EnvironmentModel,
    change_environment,
    open_environment,
)
from forcebound.messages.packets import Contact, SceneObject, Vector


class Wrapped(Environment):
    """An instance of ``model``, for what changes some of its answers."""

    def __init__(self, model: EnvironmentModel, axes: int) -> None:
        self._inner, self._axes = model, axes
        self._users: Collection[str] = ()
        self._opened = open_environment(model, axes)
        self.published = self._opened.published

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        return self._opened.force(user, position, velocity, elapsed)

    def expect(self, users: Collection[str]) -> None:
        self._users = users
        self._opened.expect(users)

    def take_readings(self, user: str, buttons: int | None, measured_force: Vector | None) -> None:
        self._opened.take_readings(user, buttons, measured_force)

    def leave(self, user: str) -> None:
        self._opened.leave(user)

    def contact(self, user: str) -> Contact | None:
        return self._opened.contact(user)

    def scene(self) -> tuple[SceneObject, ...] | None:
        return self._opened.scene()

    def mujoco(self) -> tuple[Any, Any] | None:
        return self._opened.mujoco()

    def change_inner(self, model: EnvironmentModel) -> None:
        """Take over the parameters of another model; ConfigError, and no change, if it fails."""
        if model != self._inner:
            self._opened = change_environment(self._opened, model, self._axes, self._users)
            self.published = self._opened.published
        self._inner = model

    def reset(self) -> bool:
        return self._opened.reset()

    def close(self) -> None:
        self._opened.close()
