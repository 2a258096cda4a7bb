"""The device node: the servo that reads, queries, bounds and writes.

A tick has two instants at fixed phase. At 0: read the position, publish the state. At
``reply_wait`` of the period: read again, take the newest command (the answer to this tick's
state, if it has arrived), run the safety chain, bound with the position just read, write, publish
telemetry. Writes are strictly periodic, so the hold limit can stay close to the period; the
samples of the law's ledger are the writes.

Late ticks are skipped and counted, never run in a burst: after a stall the node continues with the
tick that is due, and a tick whose write would have been due before the last one is skipped, too.

Where two readings take too long for a tick (``reads_once``), the bounder takes that of the state.

Where a write is an exchange with the device, a slow one makes the next state late, and its
force took effect as late. So there the next write waits until a late state can have its answer: it
still comes about a period after the force before.
"""

import logging
from collections.abc import Callable, Collection, Sequence
from math import isfinite
from typing import ClassVar

from msgspec import UNSET
from msgspec.structs import replace

from forcebound.errors import ConfigError, DeviceError
from forcebound.graph.servo import ServoSettings
from forcebound.haptics.devices import Device
from forcebound.haptics.laws import LAWS, Dissipation
from forcebound.haptics.parts import overridden
from forcebound.haptics.parts.signals import Signal
from forcebound.messages import control
from forcebound.messages.events import TAKES_HOLD_LIMIT, EventLog
from forcebound.messages.packets import (
    DeviceState,
    EnergyTransfer,
    Event,
    Packet,
    Telemetry,
    Vector,
)
from forcebound.messages.topology import HAND, node_name
from forcebound.nodes import Node, close_part
from forcebound.nodes.bounded_device import BoundedDevice
from forcebound.nodes.device_events import DeviceEvents
from forcebound.nodes.energy_exchange import EnergyExchange
from forcebound.nodes.publishing import Signals
from forcebound.nodes.safety import SafetyChain
from forcebound.nodes.velocity import low_pass, low_pass_gain
from forcebound.roles import DEVICE

_logger = logging.getLogger(__name__)

LEAST_WAIT = 0.3  # periods, from a state that a slow exchange made late to the write


class DeviceNode(Node):
    """The servo of one device, opened; the module's docstring defines a tick.

    It publishes states and writes zero force from its first step on; the force engages, and a
    simulated hand begins to move, after :meth:`engage`. ``clock`` gives the time, in ns, of a
    device without stamps (None: virtual time), ``lateness`` how late the next write is to be on
    purpose, in ns. ``process`` is its number in an exchange of energy.
    """

    wakes_on_arrival: ClassVar[bool] = False
    requests: ClassVar[tuple[type[control.Request], ...]] = (
        control.Engage,
        control.Point,
        control.Release,
    )
    wake_ns: int = 0  # of the next instant

    def __init__(
        self,
        device: Device,
        dissipation: Dissipation,
        servo: ServoSettings,
        clock: Callable[[], int] | None = None,
        lateness: Callable[[], int] | None = None,
        hand: str = HAND,
        signals: Collection[Signal] = (),
        process: int = 0,
        reads_once: bool = False,
    ) -> None:
        if servo.dead_man is not None and device.buttons() is None:
            device.close()
            raise ConfigError("dead_man: this device has no buttons", field="dead_man")
        self.hand = hand
        self._device = device
        self._servo = servo
        self._buttons, self._measured_force = device.buttons, device.measured_force
        turns = "orientation" in overridden(device, Device)
        self._orientation = device.orientation if turns else None
        self._is_dragged = False
        self._period_ns = servo.period_ns
        self._reply_wait_ns = servo.reply_wait_ns
        least_ns = round(LEAST_WAIT * servo.period_ns) if device.is_exchange else 0
        self._least_wait_ns = min(least_ns, self._reply_wait_ns)
        learns = servo.hold_limit == "auto"
        self._exchange: EnergyExchange | None = None
        if exchanges := bool(servo.energy_partner):
            self._exchange = EnergyExchange(hand, process, servo.partner_limit)
        self._bounded = BoundedDevice(
            device, servo.law, dissipation, learns, clock, exchanges, reads_once
        )
        self._next_law: str | None = None  # to be taken as soon as no force is held
        self._energy_before = 0.0  # J, ground truth when the law of now began, without its motion
        if clock is not None:  # live: a short run in virtual time, or one of a sweep, needs no log
            _logger.info("%s", self._bounded.describe())
        self._chain = SafetyChain(device.axes, servo)
        self._zero: Vector = (0.0,) * device.axes
        # Of the ticks, after whole periods of the clock; None: any.
        self.phase_ns: int | None = None
        self._start_ns: int | None = None  # of tick 0
        self._tick = 0
        self._writes_next = False
        self._engage_requested = False
        self._engaged_ns: int | None = None
        self._stopped = self._is_released = False
        self._is_answered = False  # at the last write with the dead-man button held
        self._applied = self._zero
        self._position = self._zero
        self._velocity = self._zero
        self._read_ns, self._lateness = 0, lateness
        self.deadline_misses = self._device_misses = 0
        self._busy_before_ns = 0  # of reads and writes, at the last state
        self.events = EventLog(node_name(hand, DEVICE))
        self._signals = Signals(device, signals, self.events, self.reject)
        # Of a simulated device and of hardware of this package, verification knows it.
        is_unknown = self._bounded.takes_limit and device.truth() is None
        about = {TAKES_HOLD_LIMIT: "true"} if is_unknown else {}
        self._reports = DeviceEvents(self.events, servo, about)

    @property
    def needs_packets(self) -> bool:
        """True if the next instant is the write; a command serves nothing before it."""
        return self._writes_next

    @property
    def awaits_requests(self) -> bool:
        """True if somebody drags its hand; only after a write, when the loop rests."""
        return self._is_dragged and not self._writes_next

    @property
    def is_engaged(self) -> bool:
        """True if force may be applied: engaged, not stopped, not released."""
        return self._engaged_ns is not None and not (self._stopped or self._is_released)

    def engage(self) -> None:
        """Let the force engage, and a simulated hand move, from the next tick on."""
        self._engage_requested = True

    def reject(self, reason: str) -> None:
        self._chain.reject(reason)

    def status(self) -> control.DeviceStatus:
        return control.DeviceStatus(
            rejected=dict(self._chain.rejected),
            engaged=self.is_engaged,
            law=self._bounded.law,
            energy_before=self._energy_before,
            deadline_misses=self.deadline_misses,
            bounder=self._report(),
        )

    def _report(self) -> control.BounderReport:
        return replace(self._bounded.report(), device_misses=self._device_misses)

    def handle(self, request: control.Engage | control.Point | control.Release) -> control.Answer:
        if isinstance(request, control.Point):
            return self._point(request.target)
        self._is_released = isinstance(request, control.Release)
        if self._is_released:
            self._chain.disengage()
            return control.Accepted()
        self.engage()
        return control.Engaged()

    def set(self, law: str) -> None:
        """Let another law bound as soon as no force is held; the force returns over the ramp.

        ConfigError, and no change, for a law that does not come with forcebound.
        """
        if not LAWS.is_shipped(law):
            raise ConfigError(f"a running device takes no law of one's own, got {law!r}")
        if self._exchange is not None and not LAWS[law].exchanges:
            partner = self._servo.energy_partner
            raise ConfigError(f"law {law} cannot exchange energy with energy_partner {partner}")
        self._next_law = law
        self._chain.disengage()

    def _point(self, target: Vector) -> control.Pointed | control.Refused:
        if len(target) > len(self._zero) or not all(map(isfinite, target)):
            return control.Refused(f"target: expected 1 to {len(self._zero)} finite numbers in m")
        place = self._device.point(target)
        if place is None:
            return control.Refused("no hand follows a pointer here: set operator: {kind: pointer}")
        self._is_dragged = True
        return control.Pointed(tuple(place), self.wake_ns)

    def stop(self, time_ns: int) -> None:
        """Write zero force, now and from now on; if that fails, the device's watchdog remains."""
        self._stopped = True
        self._chain.disengage()
        try:
            self._device.write(time_ns, self._zero)
        except DeviceError as error:
            _logger.warning("could not write the last zero force to the device: %s", error)

    def last_events(self, time_ns: int) -> Sequence[Event]:
        return [self._reports.bounder(time_ns, self._report())]

    def close(self) -> None:
        close_part(self._device.close, DEVICE)

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        for packet in received:
            if self._exchange is not None and type(packet) is EnergyTransfer:
                self._exchange.take(packet)
            else:
                self._chain.accept(packet, time_ns)
        if time_ns < self.wake_ns:
            return []
        if not self._writes_next:
            return [self._sample(time_ns)]
        packets: list[Packet] = [self._write(time_ns)]
        if self.is_engaged:
            if self._chain.is_held:
                self._is_answered = self._chain.command is not None
            is_answered, reports, bounded = self._is_answered, self._reports, self._bounded
            if (
                is_answered is not reports.is_answered
                or bounded.bounder.refused_readings != reports.refused
                or time_ns >= reports.overload.end_ns
            ):
                refused, missed = bounded.refused_readings, self.deadline_misses
                late = missed, self._device_misses, self._bounded.report().device_time
                packets += reports.look(time_ns, is_answered, refused, *late)
        if self._next_law is not None and not self._bounded.holds_force:
            packets.append(self._change_law(self._next_law, time_ns))
        if self._exchange is not None:
            packets.append(self._exchange.packet(time_ns))
        if self._signals.waiting:
            packets += self._signals.events(time_ns)
        return packets

    def _sample(self, time_ns: int) -> DeviceState:
        if self._start_ns is None:
            self._start_ns = self._read_ns = time_ns
            if self.phase_ns is not None:
                self._start_ns -= (time_ns - self.phase_ns) % self._period_ns
            self._position = self._bounded.read(time_ns)
        tick = (time_ns - self._start_ns) // self._period_ns
        if tick > self._tick:
            self._miss(tick - self._tick, time_ns)
            self._tick = tick
        self._busy_before_ns = self._bounded.busy_ns
        is_asked = self._engage_requested and self._engaged_ns is None
        if is_asked and not self._bounded.holds_force:
            self._engaged_ns = time_ns
            self._bounded.begin()
            self._device_misses = 0
            if self._exchange is not None:
                self._exchange.begin()
            self._device.engage(time_ns)
        position = self._bounded.read(time_ns)
        self._estimate_velocity(position, time_ns)
        measured = self._measured_force()
        state = DeviceState(
            self._tick,
            time_ns,
            self._elapsed(time_ns),
            position,
            self._velocity,
            self._applied,
            None if self._orientation is None else self._orientation(),
            self._buttons(),
            self._signals.numbers(),
            UNSET if measured is None else measured,
            hand=self.hand,
        )
        self._chain.remember(state)
        self._writes_next = True
        due_ns = self._start_ns + self._tick * self._period_ns + self._reply_wait_ns
        self.wake_ns = max(due_ns, time_ns + self._least_wait_ns)
        if self._lateness is not None:
            early_ns = max(self.wake_ns - time_ns, 0) // 2  # at most: reading comes first
            self.wake_ns += max(self._lateness(), -early_ns)
        return state

    def _write(self, time_ns: int) -> Telemetry:
        chain, exchange = self._chain, self._exchange
        gives = self.is_engaged and self._next_law is None and chain.is_held
        demand = chain.demand(time_ns) if gives else chain.no_force
        command = chain.command if gives else None
        given = received = None
        if exchange is None:
            written = self._bounded.write(time_ns, demand.force, demand.engagement)
        else:
            credit = exchange.credit()
            # Of a force that stop() has ended its ledger does not know: it may have less to give.
            offer = None if self._stopped else exchange.offer
            written = self._bounded.write(time_ns, demand.force, demand.engagement, credit, offer)
            exchange.give(written.given)
            given, received = exchange.given, exchange.received
        self._applied = written.applied
        cut_ns, cut_position = written.cut or (None, None)
        device_seq = loop_delay = reply_age = None
        if command is not None:
            device_seq = command.device_seq
            loop_delay = (time_ns - command.device_time_ns) * 1e-9
            reply_ns = command.reply_time_ns
            if reply_ns is not None and reply_ns <= time_ns:  # a controller may say anything
                reply_age = (time_ns - reply_ns) * 1e-9
        truth = self._device.truth()
        telemetry = Telemetry(
            self._tick,
            time_ns,
            self._elapsed(time_ns),
            written.position,
            demand.force,
            written.applied,
            written.limit,
            self._bounded.bounder.estimated_energy,
            None if truth is None else truth.energy,
            None if truth is None else truth.position,
            None if truth is None else truth.hand_force,
            demand.engagement,
            device_seq,
            loop_delay,
            self.deadline_misses,
            chain.rejected,
            written.read_ns,
            written.write_ns,
            written.joints,
            written.torques,
            cut_ns,
            cut_position,
            written.ahead_ns,
            reply_age,
            given,
            received,
            self._velocity,
            hand=self.hand,
        )
        self._writes_next = False
        self._begin_next_tick(time_ns)
        return telemetry

    def _change_law(self, law: str, time_ns: int) -> Event:
        """Begin a new ledger under another law; no force is held."""
        self._next_law, former = None, self._bounded.law
        self._bounded.change_law(law)
        if self._exchange is not None:
            self._exchange.begin()
        truth = self._device.truth()
        if truth is None:
            return self._reports.law_changed(time_ns, law)
        given = truth.energy - self._energy_before
        self._energy_before = truth.energy - self._device.kinetic_energy()
        return self._reports.law_changed(time_ns, law, (former, given, self._energy_before))

    def _begin_next_tick(self, time_ns: int) -> None:
        """Skip the ticks whose writes are overdue: two writes at once would serve nothing."""
        assert self._start_ns is not None
        next_tick = self._tick + 1
        write_ns = self._start_ns + next_tick * self._period_ns + self._reply_wait_ns
        if write_ns <= time_ns:
            overdue = 1 + (time_ns - write_ns) // self._period_ns
            self._miss(overdue, time_ns)
            next_tick += overdue
        self._tick = next_tick
        self.wake_ns = max(self._start_ns + next_tick * self._period_ns, time_ns)

    def _miss(self, ticks: int, time_ns: int) -> None:
        """Count missed ticks: the device's if it took most of the time since the last state."""
        self.deadline_misses += ticks
        if 2 * (self._bounded.busy_ns - self._busy_before_ns) > time_ns - self._read_ns:
            self._device_misses += ticks

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
