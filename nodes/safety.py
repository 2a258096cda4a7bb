"""The safety chain of the device node, from a received packet to a force that may be bounded.

A packet that arrives takes the place of the command in use, or is rejected and counted::

    decode and validate   the runner and the codec; their rejections are counted here
    expected              a force command
    CHECKS                finite, answers a fresh tick, newest; each may name a reason to reject it

At each write, the command in use passes the stages, each of which makes the force smaller, leaves
it, or ends it::

    fresh                 an answer to a state older than the age limit is no answer
    ramp                  from 0 to 1 after the start, a fault, a silence

Saturation and bounder follow in :mod:`forcebound.nodes.bounded_device`; nothing follows the
bounder. The largest force grows with the ramp, too: else an absurd force would saturate in its
first tick.

To add a stage, write a :data:`Stage` and name it in :func:`stages_of`; ``docs/device-safety.md``
has an example. ``replay --verify`` folds the same stages; a sweep runs a case with stages that it
does not know in the graph.

A command is ordered and aged by the tick that it answers, not by its sender's clock or counter: the
device knows when it measured that tick, so neither a restarted or malicious sender nor one with
another clock can make an old command look fresh or block its successor. The echoed
``device_time_ns`` must equal the time that the device remembers, so answers from before a restart
of the device do not match.
"""

import math
from collections.abc import Callable
from typing import Any, TypeAlias

from msgspec import Struct

from forcebound.messages.packets import DeviceState, ForceCommand, Packet, Vector
from forcebound.nodes.servo import ServoSettings

REMEMBERED = 4096  # ticks whose times are kept; more than any sensible age limit at 4 kHz


class Demand(Struct, frozen=True, gc=False):
    """A force on its way through the stages."""

    force: Vector  # N, at the tip
    measured_ns: int  # when the state was measured that it answers
    engagement: float = 1.0  # share of the saturation that it may use, 0 to 1


#: ``(state, demand, time_ns, servo) -> (state, demand)``, a pure function. ``state`` is what it
#: remembers from the write before: None at the first command, and again after every write without
#: force. No demand (None) ends the command: there is no force until the next one.
Stage: TypeAlias = Callable[[Any, Demand, int, ServoSettings], tuple[Any, Demand | None]]


def stages_of(servo: ServoSettings) -> tuple[Stage, ...]:
    """Return the stages that a command passes at each write, in their order."""
    return (fresh, ramp)


def fresh(
    state: None, demand: Demand, time_ns: int, servo: ServoSettings
) -> tuple[None, Demand | None]:
    """End a command that answers a state older than the age limit."""
    return None, demand if time_ns - demand.measured_ns <= servo.age_limit_ns else None


def ramp(
    begun_ns: int | None, demand: Demand, time_ns: int, servo: ServoSettings
) -> tuple[int, Demand]:
    """Let the force grow from zero within the engage time."""
    if begun_ns is None:
        begun_ns = time_ns
    since = time_ns - begun_ns
    if since >= servo.engage_time_ns:
        return begun_ns, demand
    share = since / servo.engage_time_ns
    force = tuple([share * f for f in demand.force])
    return begun_ns, Demand(force, demand.measured_ns, share * demand.engagement)


def fold(
    stages: tuple[Stage, ...], states: list[Any], demand: Demand, time_ns: int, servo: ServoSettings
) -> Demand | None:
    """Return the force that the stages give.

    Args:
        stages: Of :func:`stages_of`.
        states: Of each, after the write before; changed to those after this one.
        demand: What the command in use asks for.
        time_ns: Now, in ns.
        servo: Settings.
    """
    for k, stage in enumerate(stages):
        states[k], given = stage(states[k], demand, time_ns, servo)
        if given is None:
            states[:] = [None] * len(stages)
            return None
        demand = given
    return demand


class SafetyChain:
    """The newest acceptable command, and the force that follows from it.

    Attributes:
        axes: Length of a force.
        servo: Settings.
        command: In use; None: there is none.
        rejected: Packets refused so far, by reason; replaced when it changes, never mutated.
        newest_tick: Last tick that was measured; -1: none.
        tick_times: When the last ``REMEMBERED`` ticks were measured, in ns; by the remainder.
    """

    def __init__(self, axes: int, servo: ServoSettings) -> None:
        self.axes, self.servo = axes, servo
        self.no_force = Demand((0.0,) * axes, 0, 0.0)
        self.command: ForceCommand | None = None
        self.rejected: dict[str, int] = {}
        self.newest_tick = -1
        self.tick_times: list[int] = [-1] * REMEMBERED
        self._stages = stages_of(servo)
        self.disengage()

    def reject(self, reason: str) -> None:
        """Count a rejected packet. The mapping is replaced, so telemetry may keep the old one."""
        self.rejected = {**self.rejected, reason: self.rejected.get(reason, 0) + 1}

    def remember(self, state: DeviceState) -> None:
        """Note when a tick was measured."""
        self.newest_tick = state.seq
        self.tick_times[state.seq % REMEMBERED] = state.time_ns

    def accept(self, packet: Packet, time_ns: int) -> None:
        """Accept a packet that passes every check; count the reason if not."""
        if type(packet) is not ForceCommand:
            self.reject("unexpected")
            return
        for check in CHECKS:
            reason = check(packet, self, time_ns)
            if reason is not None:
                self.reject(reason)
                return
        self.command = packet
        self._demand = Demand(packet.force, packet.device_time_ns)

    def demand(self, time_ns: int) -> Demand:
        """Return the force that the command in use gives at ``time_ns``."""
        if self.command is None:
            self.disengage()
            return self.no_force
        demand = fold(self._stages, self._states, self._demand, time_ns, self.servo)
        if demand is None:
            self.command = None
            return self.no_force
        return demand

    def disengage(self) -> None:
        """Begin every stage again with the next demand."""
        self._states: list[Any] = [None] * len(self._stages)


#: ``(command, chain, time_ns) -> reason to reject the command, or None``; the chain is only read.
Check: TypeAlias = Callable[[ForceCommand, SafetyChain, int], str | None]


def finite(command: ForceCommand, chain: SafetyChain, time_ns: int) -> str | None:
    """Reject a force without one finite number for each axis."""
    if len(command.force) != chain.axes:
        return "wrong_length"
    return None if all(map(math.isfinite, command.force)) else "not_finite"


def answers_fresh_tick(command: ForceCommand, chain: SafetyChain, time_ns: int) -> str | None:
    """Reject an answer to a state that this device did not send, or before the age limit."""
    tick, measured_ns = command.device_seq, command.device_time_ns
    if tick > chain.newest_tick:
        return "from_the_future"
    if chain.newest_tick - tick >= REMEMBERED:
        return "too_old"
    if measured_ns != chain.tick_times[tick % REMEMBERED]:
        return "wrong_echo"
    return "too_old" if time_ns - measured_ns > chain.servo.age_limit_ns else None


def newest(command: ForceCommand, chain: SafetyChain, time_ns: int) -> str | None:
    """Reject what is not newer than the command in use."""
    used = chain.command
    if used is None or (command.device_seq, command.seq) > (used.device_seq, used.seq):
        return None
    return "not_newer"


CHECKS: tuple[Check, ...] = (finite, answers_fresh_tick, newest)
