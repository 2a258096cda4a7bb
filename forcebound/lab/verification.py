"""Verification of a recording: its inputs through the same law give its forces, to the bit.

The telemetry holds all inputs of the bounder in each tick: the commanded force, the readings, the
times of reading and writing, what the watchdog did. A :class:`BoundedDevice` of the recorded launch
file gets the same again, from a device that answers as the recorded one did, and its outputs are
compared to the bit: position, limit force, applied force, the ledger.

* *Commands.* Each commanded force must be what the stages of the safety chain make of a force
  command in the recording that answers the tick that the telemetry names.
* *Motors with steps.* Hardware may apply less than the law let through. The recorded force then
  goes on into the ledger; more than the law let through is a difference.
* *Energy of another hand.* What has come and gone in each tick, from the recorded totals, comes and
  goes again; a debit of more than the law lets go is a difference.
* *The beginning.* The recorder of a live run may miss the first ticks, which have no force. If it
  begins after the force engaged, verification begins where another ledger does: at a new law.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

from forcebound.errors import ConfigError
from forcebound.graph.graph import HandConfig
from forcebound.graph.servo import dissipation_of
from forcebound.haptics.devices import Device, DeviceModel
from forcebound.messages.events import LAW_CHANGED, TAKES_HOLD_LIMIT
from forcebound.messages.packets import TOPIC_OF, Event, ForceCommand, Telemetry, Vector
from forcebound.nodes.bounded_device import BoundedDevice
from forcebound.nodes.safety import SafetyChain
from forcebound.recordings.recording import Recording

TOPICS = tuple(TOPIC_OF[kind] for kind in (Telemetry, ForceCommand, Event))  # that it needs


@dataclass
class Verified:
    """Result of a verification."""

    ticks: int  # in the recording
    verified: int = 0  # of them, up to the first one that is missing
    unknown: int = 0  # of them, of a ledger that began before the recording
    differing: int = 0  # ticks
    difference: str = ""  # the first, in words; "" without any
    commands: int = 0  # forces that follow from a recorded command
    unknown_commands: int = 0  # forces whose command is not in the recording

    @property
    def is_same(self) -> bool:
        """Whether every tick was verified, gave its recorded force, and follows from a command."""
        is_whole = self.verified + self.unknown == self.ticks
        return is_whole and not self.differing and not self.unknown_commands


def verify(recording: Recording, hand: HandConfig) -> Verified:
    """Return whether the inputs in a recording give its forces.

    Args:
        recording: With the ``TOPICS``.
        hand: Device and servo of the recorded launch file.

    Raises:
        ConfigError: If the recording does not hold the bounder's inputs from the beginning.
    """
    packets = cast("list[Telemetry]", recording.packets(TOPIC_OF[Telemetry]))
    if not packets or packets[0].read_ns is None:
        raise ConfigError(
            f"{recording.path} has no telemetry with read_ns and write_ns: record it again with"
            " this version"
        )
    commands = cast("list[ForceCommand]", recording.packets(TOPIC_OF[ForceCommand]))
    events = cast("list[Event]", recording.packets(TOPIC_OF[Event]))
    return _Rerun(hand, events, commands).run(packets)


def _lives(packets: Sequence[Telemetry]) -> Iterator[Sequence[Telemetry]]:
    """Yield the packets of each life of the device: one that was lost counts from zero again."""
    ends = [k for k, (a, b) in enumerate(pairwise(packets), start=1) if b.seq <= a.seq]
    for start, end in pairwise([0, *ends, len(packets)]):
        yield packets[start:end]


def _engaged_at(life: Sequence[Telemetry]) -> int:
    """Return the number of the packet with which the force engaged; without one, of none."""
    engaged_ns = [one.time_ns - round(one.elapsed * 1e9) for one in life if one.elapsed > 0.0][:1]
    return sum(not engaged_ns or packet.time_ns < engaged_ns[0] for packet in life)


def _is_simulated(model: DeviceModel) -> bool:
    """Whether the device has a simulated body, and no driver, which has one for its emulator."""
    return hasattr(model, "body") and model.simulated_in is None


class _RecordedDevice(Device):
    """A device that answers as a recorded one did, at the tick of ``packet``."""

    def __init__(self, model: DeviceModel, takes_limit: bool, packet: Telemetry) -> None:
        self.axes, self.packet = len(packet.joints or packet.position), packet
        self.kinematics = None if packet.joints is None else model.kinematics()
        self._has_steps = not _is_simulated(model)
        self._takes_limit, self._ahead_ns = takes_limit, 0

    def read(self, time_ns: int) -> Vector:
        return self.packet.joints or self.packet.position

    def write(self, time_ns: int, force: Vector) -> Vector:
        applied = self.packet.torques or self.packet.applied_force
        is_less = self._has_steps and math.hypot(*applied) <= math.hypot(*force)
        return applied if is_less else force

    def stamps(self) -> tuple[int, int]:
        return self.packet.read_ns or 0, self.packet.write_ns or 0

    def latch_jitter(self) -> int:
        before, self._ahead_ns = self._ahead_ns, self.packet.ahead_ns or 0
        return self._ahead_ns - before

    def cut(self) -> tuple[int, Vector] | None:
        at, position = self.packet.cut_ns, self.packet.cut_position
        return None if at is None or position is None else (at, position)

    def set_hold_limit(self, seconds: float) -> float | None:
        return seconds if self._takes_limit else None


class _Rerun:
    """The recorded inputs through the bounder once more."""

    def __init__(
        self, hand: HandConfig, events: Sequence[Event], commands: Sequence[ForceCommand]
    ) -> None:
        self._model, self._servo, self._law = hand.device, hand.servo, hand.servo.law
        changes = [each for each in events if each.event == LAW_CHANGED]
        self._laws: dict[int, str] = {each.time_ns: each.data["law"] for each in changes}
        # A custom device reports it where its force engages or its law changes.
        self._takes_limit = _is_simulated(hand.device) or any(
            TAKES_HOLD_LIMIT in each.data for each in events
        )
        self._commands: dict[int, list[ForceCommand]] = {}  # by the tick that they answer
        for command in commands:
            self._commands.setdefault(command.device_seq, []).append(command)

    def run(self, packets: Sequence[Telemetry]) -> Verified:
        """Return the verification of the packets."""
        self._result = Verified(len(packets))
        for life in _lives(packets):
            self._device = _RecordedDevice(self._model, self._takes_limit, life[0])
            self._begin()
            if not self._live(life):
                break
        return self._result

    def _begin(self) -> None:
        """Begin the ledger of a device that starts; its law is the last one of its former life."""
        servo = self._servo
        dissipation = dissipation_of(self._model, servo)
        self._chain = SafetyChain(self._device.axes, servo)
        learns = servo.hold_limit == "auto"
        self._exchanges = bool(servo.energy_partner)
        self._bounded = BoundedDevice(
            self._device, self._law, dissipation, learns, exchanges=self._exchanges
        )

    def _live(self, life: Sequence[Telemetry]) -> bool:
        """Run through a life; return whether no tick of it is missing."""
        engaged, start = _engaged_at(life), 0
        if engaged == 0 and life[0].seq != life[0].deadline_misses:  # there is an earlier ledger
            start = next((k for k, one in enumerate(life, start=1) if one.time_ns in self._laws), 0)
            if start in (0, len(life)):
                raise ConfigError(
                    f"the recording begins with tick {life[0].seq}, when its ledger had begun, and"
                    " no other ledger begins in it (a new law): record from the beginning, with"
                    " --record"
                )
            self._result.unknown += start
            self._law = self._laws[life[start - 1].time_ns]
            self._begin()
            self._bounded.begin()
        for k, packet in enumerate(life[start:], start):
            if k > start:
                skipped = packet.deadline_misses - life[k - 1].deadline_misses
                if packet.seq - life[k - 1].seq - 1 != skipped:
                    return False
            if k == engaged:
                self._bounded.begin()
            self._tick(packet, life[k - 1] if k else None)
            if packet.time_ns in self._laws:
                self._law = self._laws[packet.time_ns]
                self._bounded.change_law(self._law)
        return True

    def _tick(self, packet: Telemetry, before: Telemetry | None) -> None:
        result, bounded, self._device.packet = self._result, self._bounded, packet
        self._follow(packet)
        totals = [
            ((one and one.received_energy) or 0.0, (one and one.given_energy) or 0.0)
            for one in (before, packet)
        ]
        credit, given = (after - then for then, after in zip(*totals, strict=True))
        written = bounded.write(
            packet.time_ns,
            packet.commanded_force,
            packet.engagement,
            credit,
            (lambda spare: given) if self._exchanges else None,
        )
        pairs = {
            "given_energy": ((written.given,), (given,)),
            "position": (written.position, packet.position),
            "force_limit": ((written.limit,), (packet.force_limit,)),
            "torques": (written.torques or (), packet.torques or ()),
            "applied_force": (written.applied, packet.applied_force),
            "estimated_energy": ((bounded.bounder.estimated_energy,), (packet.estimated_energy,)),
        }
        differing = [
            f"tick {packet.seq}: {name} is {new}, recorded {old}"
            for name, (new, old) in pairs.items()
            if not _are_same(new, old)
        ]
        result.verified += 1
        result.differing += bool(differing)
        result.difference = result.difference or "".join(differing[:1])

    def _follow(self, packet: Telemetry) -> None:
        """Count whether the commanded force is what the stages make of a recorded command."""
        if packet.device_seq is None:
            self._chain.disengage()
            return
        before = self._chain.states
        missing = ForceCommand(0, 0, 0, packet.time_ns, packet.commanded_force)  # the stages go on
        for command in (*self._commands.get(packet.device_seq, ()), missing):
            self._chain.states = list(before)
            self._chain.use(command)
            demand = self._chain.demand(packet.time_ns)
            if (packet.commanded_force, packet.engagement) == (demand.force, demand.engagement):
                break
        self._result.unknown_commands += command is missing
        self._result.commands += command is not missing


def _are_same(new: Vector, old: Vector) -> bool:
    """Whether numbers have the same bits; one that is not finite is recorded as NaN."""
    return len(new) == len(old) and all(
        a.hex() == b.hex() or not (math.isfinite(a) or math.isfinite(b))
        for a, b in zip(new, old, strict=True)
    )
