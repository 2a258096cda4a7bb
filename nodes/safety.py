"""The safety chain of the device node, from a received packet to a force that may be bounded.

A packet that arrives takes the place of the command in use, or is rejected and counted::

    decode and validate   the runner and the codec; their rejections are counted here
    acceptance            a finite force command that answers a fresh tick, newer than the last

At each write, the command in use passes a list of stages, each of which changes the force or ends
the command::

    fresh                 ends a command that answers a state older than the age limit
    ramp                  from 0 to 1 after the start, a fault, a silence

While the dead-man button is released, there is no demand, and the stages begin again.

Saturation and bounder follow in :mod:`forcebound.nodes.bounded_device`; nothing follows the
bounder. The saturation grows with the ramp, too: otherwise an absurdly large command would reach
full force in its first tick.

To add a stage, write a :data:`Stage` and name it in :func:`stages_of`; ``docs/write-your-own.md``
has an example. ``replay --verify`` passes recorded commands through the same stages; a sweep runs a
case with stages that it does not know in the graph.

A command is ordered and aged by the tick that it answers, not by its sender's clock or counter: the
device knows when it measured that tick, so neither a restarted or malicious sender nor one with
another clock can make an old command look fresh or block answers to later ticks. The echoed
``device_time_ns`` must equal the time that the device remembers, so answers from before a restart
of the device do not match.
"""

import math
from collections.abc import Callable
from typing import Any, TypeAlias

from msgspec import Struct

from forcebound.graph.servo import ServoSettings
from forcebound.messages.packets import DeviceState, ForceCommand, Packet, Vector

REMEMBERED = 4096  # ticks whose times are kept; more than any sensible age limit at 4 kHz

LARGEST_FORCE = 1e100  # N; sums and squares of what is less stay finite


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


class SafetyChain:
    """The newest acceptable command, and the force that follows from it."""

    def __init__(self, axes: int, servo: ServoSettings) -> None:
        self._axes, self._servo, self._stages = axes, servo, stages_of(servo)
        self._tick_times: list[int] = [-1] * REMEMBERED
        self._newest_tick = -1
        self.command: ForceCommand | None = None
        self.rejected: dict[str, int] = {}  # by reason; replaced, never mutated
        self.no_force = self._demand = Demand((0.0,) * axes, 0, 0.0)
        self.states: list[Any] = []  # of the stages, after the write before
        self.is_held = True  # the dead-man button at the last reading, or there is none
        self.disengage()

    def reject(self, reason: str) -> None:
        """Count a rejected packet. The mapping is replaced, so telemetry may keep the old one."""
        self.rejected = {**self.rejected, reason: self.rejected.get(reason, 0) + 1}

    def remember(self, state: DeviceState) -> None:
        """Note when a tick was measured, and whether the dead-man button is held."""
        self._newest_tick = state.seq
        self._tick_times[state.seq % REMEMBERED] = state.time_ns
        button = self._servo.dead_man
        if button is not None:
            self.is_held = bool((state.buttons or 0) >> button & 1)
            if not self.is_held:
                self.disengage()

    def accept(self, packet: Packet, time_ns: int) -> None:
        """Use a packet, or reject it and count the reason."""
        if type(packet) is not ForceCommand:
            self.reject("unexpected")
            return
        reason = self._rejection(packet, time_ns)
        if reason is None:
            self.use(packet)
        else:
            self.reject(reason)

    def use(self, command: ForceCommand) -> None:
        """Let a command give the force from now on."""
        self.command = command
        self._demand = Demand(command.force, command.device_time_ns)

    def demand(self, time_ns: int) -> Demand:
        """Return the force that the command in use gives at ``time_ns``."""
        if self.command is not None:
            demand, states, servo = self._demand, self.states, self._servo
            for k, stage in enumerate(self._stages):
                states[k], given = stage(states[k], demand, time_ns, servo)
                if given is None:
                    break
                demand = given
            else:
                return demand
            self.command = None
        self.disengage()
        return self.no_force

    def disengage(self) -> None:
        """Begin every stage again at the next demand."""
        self.states = [None] * len(self._stages)

    def _rejection(self, command: ForceCommand, time_ns: int) -> str | None:
        """Return the reason to reject a command."""
        if len(command.force) != self._axes:
            return "wrong_length"
        if not math.hypot(*command.force) < LARGEST_FORCE:
            return "not_finite"
        tick, measured_ns = command.device_seq, command.device_time_ns
        if tick > self._newest_tick:
            return "from_the_future"
        if self._newest_tick - tick >= REMEMBERED:
            return "too_old"
        if measured_ns != self._tick_times[tick % REMEMBERED]:
            return "wrong_echo"
        if time_ns - measured_ns > self._servo.age_limit_ns:
            return "too_old"
        used = self.command
        if used is not None and (tick, command.seq) <= (used.device_seq, used.seq):
            return "not_newer"
        return None
