"""A guard around a controller of the user's own: its vectors are tuples of floats."""

from collections.abc import Callable, Sequence

from forcebound.controllers import Controller, Notice
from forcebound.messages.packets import DeviceState, EnvironmentReply, Vector


class GuardedController:
    """A controller whose code may answer with lists, arrays or what is no number at all.

    Raises:
        ValueError, TypeError: From every method but ``close``, for an answer that is no vector;
            the node counts it as a failure of the controller.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.close = controller.close
        self.notices: Callable[[], Sequence[Notice]] | None = getattr(controller, "notices", None)

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        """Return position and velocity; see :class:`forcebound.controllers.Controller`."""
        position, velocity = self._controller.query(state)
        return _vector(position), _vector(velocity)

    def on_state(self, state: DeviceState, time_ns: int) -> Vector | None:
        """Return a force or None; see :class:`forcebound.controllers.Controller`."""
        force = self._controller.on_state(state, time_ns)
        return None if force is None else _vector(force)

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> Vector | None:
        """Return a force or None; see :class:`forcebound.controllers.Controller`."""
        force = self._controller.on_reply(reply, time_ns)
        return None if force is None else _vector(force)


def _vector(answer: Vector) -> Vector:
    return tuple(map(float, answer))
