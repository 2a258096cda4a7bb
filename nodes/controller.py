"""The controller node: connects the device with the environment, at its own pace."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

from forcebound.messages.packets import (
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    ForceCommand,
    Packet,
    Vector,
)


class Controller(Protocol):
    """What a controller node asks of its law of connection."""

    def command(self, reply: EnvironmentReply) -> Vector:
        """Return the force to ask of the device, in N, for what the environment answered."""
        ...


@dataclass(frozen=True)
class DirectController:
    """Passes the environment's force on as it is; the bounder at the device does the rest."""

    def command(self, reply: EnvironmentReply) -> Vector:
        """Return the environment's force; see :class:`Controller`."""
        return reply.force


CONTROLLERS: dict[str, type[Controller]] = {"direct": DirectController}


class ControllerNode:
    """Asks the environment about each device state and commands what it answers."""

    subscribes: ClassVar[tuple[type[Packet], ...]] = (DeviceState, EnvironmentReply)
    publishes: ClassVar[tuple[type[Packet], ...]] = (EnvironmentQuery, ForceCommand)
    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: ClassVar[None] = None

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._queries = 0
        self._commands = 0

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Answer every packet with one; see :class:`forcebound.nodes.Node`."""
        packets: list[Packet] = []
        for packet in received:
            if type(packet) is DeviceState:
                packets.append(self._query(packet, time_ns))
            elif type(packet) is EnvironmentReply:
                packets.append(self._command(packet, time_ns))
        return packets

    def _query(self, state: DeviceState, time_ns: int) -> EnvironmentQuery:
        seq = self._queries
        self._queries += 1
        return EnvironmentQuery(
            seq, time_ns, state.seq, state.time_ns, state.elapsed, state.position, state.velocity
        )

    def _command(self, reply: EnvironmentReply, time_ns: int) -> ForceCommand:
        seq = self._commands
        self._commands += 1
        force = self._controller.command(reply)
        return ForceCommand(seq, time_ns, reply.device_seq, reply.device_time_ns, force)
