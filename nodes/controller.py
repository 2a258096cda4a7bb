"""The controller node: drives a controller between the device and the environment, at its own pace.

:mod:`forcebound.controllers` says what a controller decides, :mod:`forcebound.nodes.lease` which
environment it is connected with.
"""

import logging
from collections.abc import Sequence
from typing import ClassVar

from forcebound.controllers import Controller
from forcebound.messages.packets import (
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    ForceCommand,
    Packet,
    Vector,
)
from forcebound.nodes.events import EventLog
from forcebound.nodes.lease import LEASE_NS, Lease
from forcebound.user_module import describe_user_error

_logger = logging.getLogger(__name__)


class ControllerNode:
    """Asks the environment about each device state and commands what the controller returns.

    A controller that raises is counted, and its command is missing: the force at the device then
    falls to zero by age.

    Args:
        controller: Open; the node closes it.
        lease_ns: See :class:`forcebound.nodes.lease.Lease`.
        dead_lease_ns: See there.
    """

    subscribes: ClassVar[tuple[type[Packet], ...]] = (DeviceState, EnvironmentReply)
    publishes: ClassVar[tuple[type[Packet], ...]] = (EnvironmentQuery, ForceCommand, Event)
    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: ClassVar[None] = None

    def __init__(
        self, controller: Controller, lease_ns: int = LEASE_NS, dead_lease_ns: int | None = None
    ) -> None:
        self._controller = controller
        self._queries = 0
        self._commands = 0
        self.events = EventLog("controller")
        self._lease = Lease(self.events, lease_ns, dead_lease_ns)
        self.faults = 0  # calls that the controller's code failed to answer

    @property
    def environment(self) -> str | None:
        """Name of the environment that serves; None: the first that answers will."""
        return self._lease.holder

    @property
    def rejected(self) -> dict[str, int]:
        """Answers rejected so far, by reason."""
        return {"second_environment": self._lease.rejected} if self._lease.rejected else {}

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Answer every packet; see :class:`forcebound.nodes.Node`."""
        packets: list[Packet] = [*self._lease.check(time_ns)]
        for packet in received:
            if type(packet) is DeviceState:
                self._take_state(packet, time_ns, packets)
            elif type(packet) is EnvironmentReply:
                self._take_reply(packet, time_ns, packets)
        return packets

    def environment_died(self, process: str) -> None:
        """Wait no longer than needed for an environment whose process is gone.

        Args:
            process: Beginning of its name, as far as the launcher knows it.
        """
        self._lease.process_ended(process)

    def close(self) -> None:
        """Close the controller."""
        self._controller.close()

    def _take_state(self, state: DeviceState, time_ns: int, packets: list[Packet]) -> None:
        try:
            force = self._controller.on_state(state, time_ns)
            force = None if force is None else _vector(force)
            position, velocity = map(_vector, self._controller.query(state))
        except Exception as error:
            self._fail("on_state or query", error, time_ns, packets)
            return
        if force is not None:
            packets.append(self._command(state.seq, state.time_ns, force, time_ns))
        seq = self._queries
        self._queries += 1
        packets.append(
            EnvironmentQuery(
                seq,
                time_ns,
                state.seq,
                state.time_ns,
                state.elapsed,
                position,
                velocity,
                self._lease.holder,
            )
        )

    def _take_reply(self, reply: EnvironmentReply, time_ns: int, packets: list[Packet]) -> None:
        counts, events = self._lease.answer(reply.environment, time_ns)
        packets += events
        if not counts:
            return
        try:
            force = self._controller.on_reply(reply, time_ns)
            force = None if force is None else _vector(force)
        except Exception as error:
            self._fail("on_reply", error, time_ns, packets)
            return
        if force is not None:
            packets.append(self._command(reply.device_seq, reply.device_time_ns, force, time_ns))

    def _command(
        self, device_seq: int, device_time_ns: int, force: Vector, time_ns: int
    ) -> ForceCommand:
        seq = self._commands
        self._commands += 1
        return ForceCommand(seq, time_ns, device_seq, device_time_ns, force)

    def _fail(self, method: str, error: Exception, time_ns: int, packets: list[Packet]) -> None:
        self.faults += 1
        if self.faults == 1:
            _logger.error("the controller failed in %s: %s", method, describe_user_error(error))
            message = "the controller failed to answer: its log gives the reason"
            packets.append(self.events.tell(time_ns, "controller_failed", message, is_fault=True))


def _vector(answer: Vector) -> Vector:
    """Return a user's answer, which may be a list or an array, as packets have it."""
    return tuple([float(entry) for entry in answer])
