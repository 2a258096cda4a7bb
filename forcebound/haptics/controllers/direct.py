"""A controller that commands the environment's force as it is."""

from dataclasses import dataclass

from forcebound.haptics.controllers import Controller, ControllerModel
from forcebound.messages.packets import DeviceState, EnvironmentReply, Vector


@dataclass(frozen=True)
class DirectController(ControllerModel, Controller):
    """Asks about the device's position and passes the environment's force on.

    It keeps no state, so model and instance are one.
    """

    takes_contacts = False

    def open(self, axes: int) -> "DirectController":
        return self

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        return state.position, state.velocity

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> Vector:
        """Return the environment's force."""
        return reply.force
