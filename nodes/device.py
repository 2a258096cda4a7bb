"""The device node: the servo that reads, queries, bounds and writes.

A tick has two instants at fixed phase. At 0: read the position, publish the state. At
``reply_wait`` of the period: read again, take the newest command (the answer to this tick's
state, if it has arrived), run the safety chain, bound with the position just read, write, publish
telemetry. Writes are strictly periodic, so the hold limit can stay close to the period; the
samples of the law's ledger are the writes.

Late ticks are skipped and counted, never run in a burst: after a stall the node continues with the
tick that is due, and a tick whose write would have been due before the last one is skipped, too.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

from forcebound.bounding import Dissipation, ForceBounder
from forcebound.devices import Device, DeviceModel
from forcebound.errors import DeviceError
from forcebound.messages.packets import (
    DeviceState,
    Event,
    ForceCommand,
    Packet,
    Telemetry,
    Vector,
)
from forcebound.nodes.closing import close_part
from forcebound.nodes.events import STATE_INTERVAL_NS, EventLog
from forcebound.nodes.late_ticks import Lateness, LateTicks
from forcebound.nodes.overload import Overload
from forcebound.nodes.safety import SafetyChain
from forcebound.nodes.velocity import low_pass, low_pass_gain
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Frequency,
    Range,
    Ratio,
    Time,
    check_ranges,
)

_logger = logging.getLogger(__name__)


class _Unknown(NamedTuple):
    """The ground truth of hardware."""

    energy: None = None
    position: None = None
    hand_force: None = None


_UNKNOWN = _Unknown()


SLOWEST, FASTEST = 0.1, 1e6  # Hz; beyond, a period in whole ns is coarse, or no servo
LONGEST_HOLD = 1e6  # periods


@dataclass(frozen=True)
class ServoSettings:
    """Settings of the servo of the device node.

    Attributes:
        law: Bounding law, a key of ``forcebound.bounding.LAWS``.
        rate: Of the servo.
        reply_wait: Share of the period between reading and writing.
        hold_limit: Periods that a force may be held: T_max.
        age_limit: An answer to an older state gives no force.
        engage_time: From no force to full force.
        velocity_cutoff: Of the low-pass on the backward difference.
        late_ticks: Late ticks on purpose, for experiments.
    """

    law: str = "certified"
    rate: Annotated[Frequency, Range(at_least=SLOWEST, at_most=FASTEST)] = 1000.0
    reply_wait: Annotated[Ratio, Range(at_least=0, below=1)] = 0.4
    hold_limit: Annotated[Ratio, Range(at_least=1, at_most=LONGEST_HOLD)] = 1.25
    age_limit: Annotated[Time, POSITIVE] = 0.1
    engage_time: Annotated[Time, NOT_NEGATIVE] = 0.1
    velocity_cutoff: Annotated[Frequency, POSITIVE] = 100.0
    late_ticks: LateTicks | None = None

    def __post_init__(self) -> None:
        check_ranges(self)

    @property
    def period_ns(self) -> int:
        """Sampling period, in ns."""
        return round(1e9 / self.rate)

    @property
    def longest_hold(self) -> float:
        """Longest time that a force may be held, T_max, in s."""
        return round(self.hold_limit * self.period_ns) * 1e-9


def dissipation_of(model: DeviceModel, servo: ServoSettings) -> Dissipation:
    """Return the dissipation on which laws rely, for this device at this rate."""
    return Dissipation(
        damping=model.damping,
        friction=model.friction,
        resolution=model.resolution,
        period=servo.period_ns * 1e-9,
        hold_limit=servo.longest_hold,
        saturation=model.saturation,
    )


class DeviceNode:
    """The servo of one device; the module's docstring defines a tick.

    It publishes states and writes zero force from its first step on; the force engages, and a
    simulated hand begins to move, after :meth:`engage`.
    """

    subscribes: ClassVar[tuple[type[Packet], ...]] = (ForceCommand,)
    publishes: ClassVar[tuple[type[Packet], ...]] = (DeviceState, Telemetry, Event)
    wakes_on_arrival: ClassVar[bool] = False
    requests: ClassVar[tuple[str, ...]] = ("engage",)

    def __init__(self, device: Device, dissipation: Dissipation, servo: ServoSettings) -> None:
        self._device = device
        self._servo = servo
        self._period_ns = servo.period_ns
        self._reply_wait_ns = round(servo.reply_wait * servo.period_ns)
        self._bounder = ForceBounder(servo.law, dissipation, device.axes)
        self._chain = SafetyChain(
            axes=device.axes,
            age_limit_ns=round(servo.age_limit * 1e9),
            engage_time_ns=round(servo.engage_time * 1e9),
            saturation=dissipation.saturation,
        )
        self._zero: Vector = (0.0,) * device.axes
        self._start_ns: int | None = None  # of tick 0
        self._tick = 0
        self._writes_next = False
        self._is_first_write = True
        self._wake_ns = 0
        self._engage_requested = False
        self._engaged_ns: int | None = None
        self._stopped = False
        self._applied = self._zero
        self._position = self._zero
        self._velocity = self._zero
        self._read_ns = 0
        self._is_answered = False
        self._next_event_ns = 0
        late = servo.late_ticks
        self._lateness = None if late is None else Lateness(late, servo.period_ns * 1e-9)
        self._overload = Overload(servo.period_ns)
        self.deadline_misses = 0
        self.events = EventLog("device")

    @property
    def wake_ns(self) -> int:
        """When the next instant of a tick is due, in ns."""
        return self._wake_ns

    @property
    def needs_packets(self) -> bool:
        """Whether the next instant is the write; a command serves nothing before it."""
        return self._writes_next

    @property
    def is_engaged(self) -> bool:
        """Whether force may be applied: engaged and not stopped."""
        return self._engaged_ns is not None and not self._stopped

    def engage(self) -> None:
        """Let the force engage, and a simulated hand move, from the next tick on."""
        self._engage_requested = True

    def reject(self, reason: str) -> None:
        """Count a packet that was rejected before it reached the node."""
        self._chain.reject(reason)

    def status(self) -> dict[str, Any]:
        """Return ``engaged``, ``deadline_misses`` and ``rejected``."""
        return {
            "rejected": dict(self._chain.rejected),
            "engaged": self.is_engaged,
            "deadline_misses": self.deadline_misses,
        }

    def handle(self, request: Mapping[str, Any]) -> dict[str, Any] | None:
        """Answer ``engage``; see :class:`forcebound.nodes.Node`."""
        if request.get("request") != "engage":
            return None
        self.engage()
        return {"engaged": True}

    def stop(self, time_ns: int) -> None:
        """Write zero force, now and from now on; if that fails, the device's watchdog remains."""
        self._stopped = True
        self._chain.disengage()
        try:
            self._device.write(time_ns, self._zero)
        except DeviceError as error:
            _logger.warning("could not write the last zero force to the device: %s", error)

    def close(self) -> None:
        """Close the device."""
        close_part(self._device, "device")

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Run the instant that is due; see :class:`forcebound.nodes.Node`."""
        for packet in received:
            self._chain.accept(packet, time_ns)
        if time_ns < self._wake_ns:
            return []
        if self._writes_next:
            packets: list[Packet] = [self._write(time_ns)]
            if self.is_engaged:
                packets += self._describe(time_ns)
            return packets
        return [self._sample(time_ns)]

    def _sample(self, time_ns: int) -> DeviceState:
        if self._start_ns is None:
            self._start_ns = self._read_ns = time_ns
            self._position = self._device.read(time_ns)
        tick = (time_ns - self._start_ns) // self._period_ns
        if tick > self._tick:
            self.deadline_misses += tick - self._tick
            self._tick = tick
        if self._engage_requested and self._engaged_ns is None:
            self._engaged_ns = time_ns
            self._device.engage(time_ns)
        position = self._device.read(time_ns)
        self._estimate_velocity(position, time_ns)
        state = DeviceState(
            self._tick, time_ns, self._elapsed(time_ns), position, self._velocity, self._applied
        )
        self._chain.remember(state)
        self._writes_next = True
        self._wake_ns = self._start_ns + self._tick * self._period_ns + self._reply_wait_ns
        if self._lateness is not None:
            early_ns = max(self._wake_ns - time_ns, 0) // 2  # at most: reading comes first
            self._wake_ns += max(self._lateness.draw_ns(), -early_ns)
        return state

    def _write(self, time_ns: int) -> Telemetry:
        assert self._start_ns is not None
        device, bounder, chain = self._device, self._bounder, self._chain
        is_engaged = self.is_engaged
        position = device.read(time_ns)
        commanded = chain.force(time_ns) if is_engaged else self._zero
        if self._is_first_write:  # the ledger begins here, with no force held
            bounder.start(time_ns, position)
            self._is_first_write = False
            bounded = self._zero
        else:
            bounded = bounder.bound(time_ns, position, commanded)
        self._applied = applied = device.write(time_ns, bounded)
        bounder.settle(applied)
        answered = chain.answered_tick if is_engaged else None
        truth = device.truth() or _UNKNOWN
        telemetry = Telemetry(
            self._tick,
            time_ns,
            self._elapsed(time_ns),
            position,
            commanded,
            applied,
            bounder.limit,
            bounder.estimated_energy,
            truth.energy,
            truth.position,
            truth.hand_force,
            chain.engagement,
            answered,
            None if answered is None else (time_ns - chain.answered_ns) * 1e-9,
            self.deadline_misses,
            chain.rejected,
        )
        self._writes_next = False
        self._begin_next_tick(time_ns)
        return telemetry

    def _begin_next_tick(self, time_ns: int) -> None:
        """Skip the ticks whose writes are overdue: two writes at once would serve nothing."""
        assert self._start_ns is not None
        next_tick = self._tick + 1
        write_ns = self._start_ns + next_tick * self._period_ns + self._reply_wait_ns
        if write_ns <= time_ns:
            overdue = 1 + (time_ns - write_ns) // self._period_ns
            self.deadline_misses += overdue
            next_tick += overdue
        self._tick = next_tick
        self._wake_ns = max(self._start_ns + next_tick * self._period_ns, time_ns)

    def _describe(self, time_ns: int) -> list[Packet]:
        """Return events about answers that end or begin, and about missed ticks."""
        events: list[Packet] = []
        is_answered = self._chain.answered_tick is not None
        if self._is_answered != is_answered and time_ns >= self._next_event_ns:
            events.append(self._describe_answers(time_ns))
        warning = self._overload.observe(time_ns, self.deadline_misses)
        if warning is not None:
            events.append(self.events.emit(time_ns, "ticks_missed", warning, is_fault=True))
        return events

    def _describe_answers(self, time_ns: int) -> Event:
        """Return an event when the force goes to zero or returns; limited in rate."""
        self._next_event_ns = time_ns + STATE_INTERVAL_NS
        self._is_answered = not self._is_answered
        if self._is_answered:
            return self.events.emit(time_ns, "force_engages", "replies received; ramping force up")
        limit = self._servo.age_limit * 1e3
        message = f"no answer younger than the age limit of {limit:g} ms: zero force"
        return self.events.emit(time_ns, "force_released", message, is_fault=True)

    def _elapsed(self, time_ns: int) -> float:
        return 0.0 if self._engaged_ns is None else (time_ns - self._engaged_ns) * 1e-9

    def _estimate_velocity(self, position: Vector, time_ns: int) -> None:
        dt = (time_ns - self._read_ns) * 1e-9
        if dt > 0.0:
            gain = low_pass_gain(self._servo.velocity_cutoff, dt)
            self._velocity = tuple(
                [
                    low_pass(v, (q - p) / dt, gain)
                    for v, q, p in zip(self._velocity, position, self._position, strict=True)
                ]
            )
        self._position = position
        self._read_ns = time_ns
