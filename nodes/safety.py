"""The safety chain of the device node, from a received packet to a force that may be bounded.

In this order, each stage only ever rejecting a packet or making the force smaller::

    decode and validate   the runner and the codec; rejections are counted here
    expected              a force command with one finite number per axis
    newest                by the device's own tick number that the command echoes
    age limit             an answer to a state older than the limit is no answer
    engage ramp           from 0 to 1 after the start, a fault, a silence

Saturation and bounder follow in :mod:`forcebound.nodes.bounded_device`; nothing follows the
bounder. The largest force grows with the ramp, too: else an absurd force would saturate in its
first tick.

A command is ordered and aged by the tick that it answers, not by its sender's clock or counter: the
device knows when it measured that tick, so neither a restarted or malicious sender nor one with
another clock can make an old command look fresh or block its successor. The echoed
``device_time_ns`` must equal the time that the device remembers, so answers from before a restart
of the device do not match.
"""

import math

from forcebound.messages.packets import DeviceState, ForceCommand, Packet, Vector

REMEMBERED = 4096  # ticks whose times are kept; more than any sensible age limit at 4 kHz


class SafetyChain:
    """The newest acceptable command, and the force that follows from it.

    Attributes:
        answered_tick: Tick whose state the command in use answers; None while there is none.
        answered_ns: When that state was measured, in ns; meaningless while there is none.
        reply_ns: When the state was measured that the environment's reply in use answers, in ns, as
            the controller says; None: not known. Only for telemetry.
        engagement: Factor of the engage ramp, 0 to 1.
        rejected: Packets refused so far, by reason; replaced when it changes, never mutated.
    """

    def __init__(self, axes: int, age_limit_ns: int, engage_time_ns: int) -> None:
        self._axes = axes
        self._age_limit_ns = age_limit_ns
        self._engage_time_ns = engage_time_ns
        self._zero: Vector = (0.0,) * axes
        self._tick_times: list[int] = [-1] * REMEMBERED
        self._newest_tick = -1
        self._command: ForceCommand | None = None
        self.answered_tick: int | None = None
        self.answered_ns = 0
        self.reply_ns: int | None = None
        self._ramp_start_ns: int | None = None
        self.engagement = 0.0
        self.rejected: dict[str, int] = {}

    def reject(self, reason: str) -> None:
        """Count a rejected packet. The mapping is replaced, so telemetry may keep the old one."""
        self.rejected = {**self.rejected, reason: self.rejected.get(reason, 0) + 1}

    def remember(self, state: DeviceState) -> None:
        """Note when a tick was measured."""
        self._newest_tick = state.seq
        self._tick_times[state.seq % REMEMBERED] = state.time_ns

    def accept(self, packet: Packet, time_ns: int) -> None:
        """Accept a packet that passes every stage; count the reason if not."""
        if type(packet) is not ForceCommand:
            self.reject("unexpected")
        elif len(packet.force) != self._axes:
            self.reject("wrong_length")
        elif not all(map(math.isfinite, packet.force)):
            self.reject("not_finite")
        else:
            reason = self._order(packet, time_ns)
            if reason is None:
                self._command = packet
                self.answered_tick = packet.device_seq
                self.answered_ns = packet.device_time_ns
                self.reply_ns = packet.reply_time_ns
            else:
                self.reject(reason)

    def force(self, time_ns: int) -> Vector:
        """Return the commanded force at ``time_ns``, in N; zero without a fresh command."""
        command = self._command
        if command is not None and time_ns - self.answered_ns > self._age_limit_ns:
            command = self._command = self.answered_tick = None
        if command is None:
            self.disengage()
            return self._zero
        if self._ramp_start_ns is None:
            self._ramp_start_ns = time_ns
        since = time_ns - self._ramp_start_ns
        if since >= self._engage_time_ns:
            self.engagement = 1.0
        else:
            self.engagement = since / self._engage_time_ns
        return ramped(command.force, self.engagement)

    def disengage(self) -> None:
        """Restart the ramp at the next fresh command."""
        self._ramp_start_ns = None
        self.engagement = 0.0

    def _order(self, command: ForceCommand, time_ns: int) -> str | None:
        tick = command.device_seq
        if tick > self._newest_tick:
            return "from_the_future"
        if self._newest_tick - tick >= REMEMBERED:
            return "too_old"
        measured_ns = self._tick_times[tick % REMEMBERED]
        if measured_ns != command.device_time_ns:
            return "wrong_echo"
        if time_ns - measured_ns > self._age_limit_ns:
            return "too_old"
        held = self._command
        if held is not None and (tick, command.seq) <= (held.device_seq, held.seq):
            return "not_newer"
        return None


def ramped(force: Vector, engagement: float) -> Vector:
    """Return a command's force after the engage ramp, in N."""
    return force if engagement == 1.0 else tuple([engagement * f for f in force])
