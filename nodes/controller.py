"""The controller node: connects device and environment through a controller.

:mod:`forcebound.haptics.controllers` says what a controller decides, :mod:`forcebound.nodes.lease`
which environment it is connected with.
"""

import logging
from collections.abc import Collection, Sequence
from itertools import chain
from math import isfinite
from typing import ClassVar

from msgspec import UNSET
from msgspec.structs import replace

from forcebound.haptics.controllers import Controller
from forcebound.haptics.parts import overridden
from forcebound.haptics.parts.signals import Signal
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.control import (
    Accepted,
    Answer,
    ControllerStatus,
    EnvironmentDied,
    Request,
)
from forcebound.messages.events import EventLog
from forcebound.messages.packets import (
    DeviceState,
    EnergyTransfer,
    EnvironmentQuery,
    EnvironmentReply,
    ForceCommand,
    Packet,
    Vector,
)
from forcebound.messages.topology import HAND, node_name
from forcebound.nodes import Node, close_part
from forcebound.nodes.lease import LEASE_NS, Lease
from forcebound.nodes.publishing import Signals
from forcebound.roles import CONTROLLER

_logger = logging.getLogger(__name__)


class ControllerNode(Node):
    """Queries the environment for each device state and sends the forces of the controller.

    If the controller's code raises, the failure is counted and no command is sent; the force at the
    device then falls to zero by its age limit. The node closes the controller.
    """

    wakes_on_arrival: ClassVar[bool] = True
    requests: ClassVar[tuple[type[Request], ...]] = (EnvironmentDied,)
    wake_ns: ClassVar[None] = None

    def __init__(
        self,
        controller: Controller,
        lease_ns: int = LEASE_NS,
        dead_lease_ns: int | None = None,
        hand: str = HAND,
        signals: Collection[Signal] = (),
        has_port: bool = False,
    ) -> None:
        self._hand = hand
        self._has_port = has_port  # at the environment, which takes the signals, too
        self._controller = controller
        self._answers_states = "on_state" in overridden(controller, Controller)
        self._queries = 0
        self._commands = 0
        self.events = EventLog(node_name(hand, CONTROLLER))
        self._signals = Signals(controller, signals, self.events, self.reject)
        self._lease = Lease(self.events, lease_ns, dead_lease_ns)
        self._reply_ns: int | None = None  # device's clock: state that the newest reply answers
        self._failures = 0  # failed calls of the controller's code

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        lease = self._lease
        packets = lease.check(time_ns) if time_ns > lease.due_ns else []
        for packet in received:
            if type(packet) is DeviceState:
                self._take_state(packet, time_ns, packets)
            elif type(packet) is EnvironmentReply:
                self._take_reply(packet, time_ns, packets)
        if self._signals.waiting:
            packets += self._signals.events(time_ns)
        return packets

    def admit(self, packet: Packet, source: str, time_ns: int) -> bool:
        if type(packet) is EnergyTransfer and packet.hand != self._hand:
            is_served = self._lease.is_of(source)  # the partner's comes from who serves this hand
            if not is_served and self._lease.holder is not None:
                self.reject("second_environment")
            return is_served
        if type(packet) is not EnvironmentReply:
            return True
        if self._lease.admit(packet.environment, source, time_ns):
            return True
        self.reject("second_environment")
        return False

    def status(self) -> ControllerStatus:
        return ControllerStatus(
            rejected=dict(self.rejected),
            environment=self._lease.holder,
            failures=self._failures,
        )

    def handle(self, request: EnvironmentDied) -> Answer:
        """Wait no longer than needed for an environment whose process has ended."""
        self._lease.process_ended(request.process)
        return Accepted()

    def close(self) -> None:
        close_part(self._controller.close, CONTROLLER)

    def _take_state(self, state: DeviceState, time_ns: int, packets: list[Packet]) -> None:
        try:
            force = self._controller.on_state(state, time_ns) if self._answers_states else None
            force = None if force is None else _vector(force)
            position, velocity = self._controller.query(state)
            position, velocity = _vector(position), _vector(velocity)
        except Exception as error:
            self._fail("on_state or query", error, time_ns, packets)
            return
        if force is not None:
            packets.append(self._command(state.seq, state.time_ns, force, time_ns, self._reply_ns))
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
                state.orientation,
                state.buttons,
                state.measured_force,
                self._signals.numbers() if self._has_port else UNSET,
                hand=self._hand,
            )
        )

    def _take_reply(self, reply: EnvironmentReply, time_ns: int, packets: list[Packet]) -> None:
        lease = self._lease
        if reply.environment == lease.holder:
            lease.heard_ns = time_ns
        else:
            packets += lease.request(reply.environment, time_ns)
            if reply.environment != lease.holder:
                self.reject("second_environment")
                return
        if not all(map(isfinite, reply.force)):
            # A controller would keep it in its state for ever. The device rejects and counts it.
            packets.append(self._answer(reply, reply.force, time_ns))
            return
        contact = reply.contact
        if contact is not None and not all(map(isfinite, chain(*contact))):
            self.reject("not_finite")
            reply = replace(reply, proxy=None, normal=None)
        try:
            force = self._controller.on_reply(reply, time_ns)
            if force is not None:
                packets.append(self._answer(reply, _vector(force), time_ns))
        except Exception as error:
            self._fail("on_reply", error, time_ns, packets)
            return
        self._reply_ns = max(self._reply_ns or 0, reply.device_time_ns)

    def _answer(self, reply: EnvironmentReply, force: Vector, time_ns: int) -> ForceCommand:
        tick, measured_ns = reply.device_seq, reply.device_time_ns
        return self._command(tick, measured_ns, force, time_ns, measured_ns)

    def _command(
        self, device_seq: int, device_time_ns: int, force: Vector, time_ns: int, reply: int | None
    ) -> ForceCommand:
        seq = self._commands
        self._commands += 1
        signals = self._signals.numbers()
        return ForceCommand(
            seq, time_ns, device_seq, device_time_ns, force, reply, signals, hand=self._hand
        )

    def _fail(self, method: str, error: Exception, time_ns: int, packets: list[Packet]) -> None:
        self._failures += 1
        if self._failures == 1:
            message = f"the controller's code failed in {method}: {describe_user_error(error)}"
            _logger.error("%s", message)
            packets.append(self.events.emit(time_ns, "controller_failed", message, is_fault=True))


def _vector(answer: Vector) -> Vector:
    """Return the answer of a controller, which may have numbers of numpy, as it can be sent."""
    return tuple(map(float, answer))
