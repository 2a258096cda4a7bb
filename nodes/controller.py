"""The controller node: connects the device with the environment, at its own pace.

One environment serves a graph at a time. The first one that answers gets the *lease*: every query
names it, and answers of others are refused. The lease ends when its holder has been silent for
longer than ``lease_ns``; or, if it is known to be dead, for longer than ``dead_lease_ns``. Both are
longer than the age limit of a force: so the force is zero between two environments, and returns
over the engage ramp.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from forcebound.messages.packets import (
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    ForceCommand,
    Packet,
    Vector,
)
from forcebound.nodes import Node
from forcebound.nodes.events import EventLog


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


LEASE_NS = 1_000_000_000  # by default; twice the age limit where that is more
TELL_INTERVAL_NS = 1_000_000_000  # between two events about refused environments


class ControllerNode(Node):
    """Asks the environment about each device state and commands what it answers.

    Args:
        controller: What it commands.
        lease_ns: Silence after which another environment may serve, in ns.
        dead_lease_ns: The same if the process of the one that served is known to be gone; None: no
            shorter.

    Attributes:
        environment: Name of the environment that serves; None: the first that answers will.
    """

    subscribes: ClassVar[tuple[type[Packet], ...]] = (DeviceState, EnvironmentReply)
    publishes: ClassVar[tuple[type[Packet], ...]] = (EnvironmentQuery, ForceCommand, Event)
    wakes_on_arrival: ClassVar[bool] = True
    requests: ClassVar[tuple[str, ...]] = ("environment_died",)
    wake_ns: ClassVar[None] = None

    def __init__(
        self, controller: Controller, lease_ns: int = LEASE_NS, dead_lease_ns: int | None = None
    ) -> None:
        self._controller = controller
        self._lease_ns = lease_ns
        self._dead_lease_ns = lease_ns if dead_lease_ns is None else dead_lease_ns
        self._is_dead = False  # whether the environment that serves is known to be
        self._queries = 0
        self._commands = 0
        self._heard_ns = 0
        self._told_ns: int | None = None
        self.events = EventLog("controller")
        self.environment: str | None = None
        self._rejected: dict[str, int] = {}

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Answer every packet with one; see :class:`forcebound.nodes.Node`."""
        packets: list[Packet] = []
        lease_ns = self._dead_lease_ns if self._is_dead else self._lease_ns
        if self.environment is not None and time_ns - self._heard_ns > lease_ns:
            packets.append(self._lost(time_ns))
        for packet in received:
            if type(packet) is DeviceState:
                packets.append(self._query(packet, time_ns))
            elif type(packet) is EnvironmentReply:
                if packet.environment == self.environment:
                    self._heard_ns = time_ns
                elif self.environment is None:
                    packets.append(self._take(packet.environment, time_ns))
                else:
                    packets += self._refuse(packet.environment, time_ns)
                    continue
                packets.append(self._command(packet, time_ns))
        return packets

    def reject(self, reason: str) -> None:
        """Count a packet that was rejected; see :class:`forcebound.nodes.Node`."""
        self._rejected[reason] = self._rejected.get(reason, 0) + 1

    def status(self) -> dict[str, Any]:
        """Return ``environment``, which serves (None: nobody yet), and ``rejected``."""
        return {"rejected": dict(self._rejected), "environment": self.environment}

    def handle(self, request: Mapping[str, Any]) -> dict[str, Any] | None:
        """Answer ``environment_died``: the process of an environment is known to be gone.

        ``process`` is the beginning of the environment's name, as far as it is known. The node
        waits no longer than needed for it.
        """
        if request.get("request") != "environment_died":
            return None
        process = request.get("process")
        if not process:
            return {"error": "environment_died needs process: the beginning of the name"}
        if self.environment is not None and self.environment.startswith(str(process)):
            self._is_dead = True
        return {"noted": True}

    def _query(self, state: DeviceState, time_ns: int) -> EnvironmentQuery:
        seq = self._queries
        self._queries += 1
        return EnvironmentQuery(
            seq,
            time_ns,
            state.seq,
            state.time_ns,
            state.elapsed,
            state.position,
            state.velocity,
            self.environment,
        )

    def _command(self, reply: EnvironmentReply, time_ns: int) -> ForceCommand:
        seq = self._commands
        self._commands += 1
        force = self._controller.command(reply)
        return ForceCommand(seq, time_ns, reply.device_seq, reply.device_time_ns, force)

    def _take(self, environment: str, time_ns: int) -> Event:
        self.environment = environment
        self._heard_ns = time_ns
        message = f"environment {environment} serves now"
        return self.events.emit(
            time_ns, "environment_serves", message, {"environment": environment}
        )

    def _lost(self, time_ns: int) -> Event:
        environment, self.environment = self.environment or "", None
        silence = (time_ns - self._heard_ns) * 1e-9
        how = "is gone" if self._is_dead else f"has been silent for {silence:.1f} s"
        self._is_dead = False
        message = f"environment {environment} {how}; the next that answers will serve"
        return self.events.emit(
            time_ns, "environment_lost", message, {"environment": environment}, is_fault=True
        )

    def _refuse(self, environment: str, time_ns: int) -> list[Packet]:
        """Count an answer of an environment that does not serve; tell it now and then."""
        self.reject("second_environment")
        if self._told_ns is not None and time_ns - self._told_ns < TELL_INTERVAL_NS:
            return []
        self._told_ns = time_ns
        message = f"refused environment {environment}: {self.environment} serves this graph"
        return [
            self.events.emit(
                time_ns, "environment_refused", message, {"environment": environment}, is_fault=True
            )
        ]
