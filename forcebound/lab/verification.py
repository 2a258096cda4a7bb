"""Verification of a recording: its inputs through the same law give its forces, to the bit.

The telemetry holds all that the bounder heard in each tick: the commanded force, the readings, the
times of reading and writing, what the watchdog did. A :class:`BoundedDevice` of the recorded launch
file hears the same again, from a device that answers as the recorded one did, and what comes out is
compared: position, limit force, applied force, the ledger. A difference of one bit is one.

* *Commands.* Each commanded force must be what the stages of the safety chain make of a force
  command in the recording that answers the tick that the telemetry names.
* *Motors with steps.* Hardware may apply less than the law let through. The recorded force then
  goes on into the ledger; more than the law let through is a difference.
* *The beginning.* The recorder of a live run may miss the first ticks, which have no force. If it
  begins after the force engaged, verification begins where another ledger does: at a new law.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

from forcebound.errors import ConfigError
from forcebound.graph.graph import DeviceConfig
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
    """What a verification has found."""

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


def verify(recording: Recording, device: DeviceConfig) -> Verified:
    """Return whether the inputs in a recording give its forces.

    Args:
        recording: With the ``TOPICS``.
        device: Of the recorded launch file.

    Raises:
        ConfigError: If the recording does not hold what the bounder heard from the beginning.
    """
    packets = cast("list[Telemetry]", recording.packets(TOPIC_OF[Telemetry]))
    if not packets or packets[0].read_ns is None:
        raise ConfigError(
            f"{recording.path} has no telemetry with read_ns and write_ns: record it again with"
            " this version"
        )
    commands = cast("list[ForceCommand]", recording.packets(TOPIC_OF[ForceCommand]))
    events = cast("list[Event]", recording.packets(TOPIC_OF[Event]))
    return _Rerun(device, events, commands).run(packets)


def _lives(packets: Sequence[Telemetry]) -> Iterator[Sequence[Telemetry]]:
    """Yield the packets of each life of the device: one that was lost counts from zero again."""
    ends = [k for k, (a, b) in enumerate(pairwise(packets), start=1) if b.seq <= a.seq]
    for start, end in pairwise([0, *ends, len(packets)]):
        yield packets[start:end]


def _engaged_at(life: Sequence[Telemetry]) -> int:
    """Return the number of the packet with which the force engaged; without one, of none."""
    known = next((packet for packet in life if packet.elapsed > 0.0), None)
    if known is None:
        return len(life)
    engaged_ns = known.time_ns - round(known.elapsed * 1e9)
    return next(k for k, packet in enumerate(life) if packet.time_ns >= engaged_ns)


def _start_of(life: Sequence[Telemetry], engaged: int, laws: Mapping[int, str]) -> int:
    """Return the number of the first packet whose ledger can be known.

    Raises:
        ConfigError: If there is none.
    """
    if engaged > 0 or life[0].seq == life[0].deadline_misses:  # no force before it engages
        return 0
    start = next((k for k, tick in enumerate(life, start=1) if tick.time_ns in laws), len(life))
    if start == len(life):
        raise ConfigError(
            f"the recording begins with tick {life[0].seq}, when its ledger had begun, and no other"
            " ledger begins in it (a new law): record from the beginning, with --record"
        )
    return start


def _is_next(packet: Telemetry, before: Telemetry) -> bool:
    """Whether the ticks between two packets were skipped, and none is missing."""
    skipped = packet.deadline_misses - before.deadline_misses
    return packet.seq - before.seq - 1 == skipped


class _RecordedDevice(Device):
    """A device that answers as a recorded one did; see :class:`forcebound.haptics.devices.Device`.

    Attributes:
        packet: Of the tick that is under way.
    """

    def __init__(
        self, model: DeviceModel, packet: Telemetry, has_steps: bool, takes_limit: bool
    ) -> None:
        self.axes = len(packet.joints or packet.position)
        self.packet = packet
        self._has_steps, self._takes_limit = has_steps, takes_limit
        self._ahead_ns = 0
        self.kinematics = None if packet.joints is None else model.kinematics()

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
        """Return ``seconds``, what came of it is recorded; None if it took no other limit."""
        return seconds if self._takes_limit else None


class _Rerun:
    """The recorded inputs through the bounder once more."""

    def __init__(
        self, device: DeviceConfig, events: Sequence[Event], commands: Sequence[ForceCommand]
    ) -> None:
        self._config, self._law = device, device.servo.law
        self._laws = {
            each.time_ns: each.data["law"] for each in events if each.event == LAW_CHANGED
        }
        # A device of the user's own says it where its force engages or its law changes.
        is_simulated = hasattr(device.model, "body")
        self._takes_limit = is_simulated or any(TAKES_HOLD_LIMIT in each.data for each in events)
        self._has_steps = not is_simulated
        self._commands: dict[int, list[ForceCommand]] = {}  # by the tick that they answer
        for command in commands:
            self._commands.setdefault(command.device_seq, []).append(command)

    def run(self, packets: Sequence[Telemetry]) -> Verified:
        """Return what the packets give."""
        self._found = Verified(len(packets))
        for life in _lives(packets):
            self._device = _RecordedDevice(
                self._config.model, life[0], self._has_steps, self._takes_limit
            )
            self._begin()
            if not self._live(life):
                break
        return self._found

    def _begin(self) -> None:
        """Begin the ledger of a device that starts; its law is the last one of its former life."""
        servo = self._config.servo
        dissipation = dissipation_of(self._config.model, servo)
        learns = servo.hold_limit == "auto"
        self._chain = SafetyChain(self._device.axes, servo)
        self._bounded = BoundedDevice(self._device, self._law, dissipation, learns)

    def _live(self, life: Sequence[Telemetry]) -> bool:
        """Run through a life; return whether no tick of it is missing."""
        engaged = _engaged_at(life)
        start = _start_of(life, engaged, self._laws)
        self._found.unknown += start
        if start > engaged:
            self._law = self._laws[life[start - 1].time_ns]
            self._begin()
            self._bounded.begin()
        for k in range(start, len(life)):
            if k > start and not _is_next(life[k], life[k - 1]):
                return False
            if k == engaged:
                self._bounded.begin()
            self._tick(life[k])
            law = self._laws.get(life[k].time_ns)
            if law is not None:
                self._law = law
                self._bounded.change_law(law)
        return True

    def _tick(self, packet: Telemetry) -> None:
        device, bounded = self._device, self._bounded
        device.packet = packet
        self._follow(packet)
        written = bounded.write(packet.time_ns, packet.commanded_force, packet.engagement)
        pairs = {
            "position": (written.position, packet.position),
            "force_limit": ((written.limit,), (packet.force_limit,)),
            "torques": (written.torques or (), packet.torques or ()),
            "applied_force": (written.applied, packet.applied_force),
            "estimated_energy": ((bounded.bounder.estimated_energy,), (packet.estimated_energy,)),
        }
        found = self._found
        found.verified += 1
        differing = [
            f"tick {packet.seq}: {name} is {new}, recorded {old}"
            for name, (new, old) in pairs.items()
            if not _are_same(new, old)
        ]
        found.differing += bool(differing)
        found.difference = found.difference or "".join(differing[:1])

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
        self._found.unknown_commands += command is missing
        self._found.commands += command is not missing


def _are_same(new: Vector, old: Vector) -> bool:
    """Whether numbers have the same bits; one that is not finite is recorded as NaN."""
    return len(new) == len(old) and all(
        a.hex() == b.hex() or not (math.isfinite(a) or math.isfinite(b))
        for a, b in zip(new, old, strict=True)
    )
