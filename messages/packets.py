"""What travels: one frozen dataclass per packet, and the table of topics.

Every packet carries ``seq`` (counts from 0 at its sender) and ``time_ns`` (the sender's own
monotonic clock). An answer echoes ``device_seq`` and ``device_time_ns`` of the device state that it
answers, so a loop delay is measured on the device's clock alone.

Vectors are tuples of 1 to 6 floats, one per axis. Positions grow *into* the environment; a force
is positive when it *resists* motion in the positive direction (``docs/theory.md``, section 1).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

VERSION = 1  # of the wire format; every packet carries it

MAX_AXES = 6

Vector: TypeAlias = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class DeviceState:
    """What the device read at the start of a tick."""

    seq: int  # tick number, counts from 0
    time_ns: int  # ns, device's clock, when the position was read
    elapsed: float  # s since the force engaged for the first time; 0 before
    position: Vector  # m
    velocity: Vector  # m/s, filtered backward difference
    force: Vector  # N, held by the motor at time_ns


@dataclass(frozen=True, slots=True)
class EnvironmentQuery:
    """What the controller asks of the environment."""

    seq: int
    time_ns: int
    device_seq: int
    device_time_ns: int
    elapsed: float  # s, of the device state
    position: Vector  # m
    velocity: Vector  # m/s


@dataclass(frozen=True, slots=True)
class EnvironmentReply:
    """What the environment answers."""

    seq: int
    time_ns: int
    device_seq: int
    device_time_ns: int
    query_seq: int
    query_time_ns: int
    force: Vector  # N


@dataclass(frozen=True, slots=True)
class ForceCommand:
    """The force that the controller asks the device to show."""

    seq: int
    time_ns: int
    device_seq: int
    device_time_ns: int
    force: Vector  # N


@dataclass(frozen=True, slots=True)
class Telemetry:
    """What happened in one tick of the device, measured at the instant of writing."""

    seq: int  # tick number
    time_ns: int  # ns, device's clock, when the force was written
    elapsed: float  # s since the force engaged for the first time; 0 before
    position: Vector  # m, reading that the bounder used
    commanded_force: Vector  # N, asked of the bounder (after age limit, ramp and saturation)
    applied_force: Vector  # N, written to the motor
    force_limit: float  # N, largest magnitude that law and saturation allowed
    estimated_energy: float  # J, what the law believes; its meaning is the law's
    true_energy: float | None  # J, ground truth of a simulated device; None on hardware
    true_position: Vector | None  # m, unquantised position of a simulated device
    hand_force: Vector | None  # N, ground truth of a simulated device
    engagement: float  # 0 to 1, factor of the engage ramp
    device_seq: int | None  # tick whose state the force answers; None while there is no answer
    loop_delay: float | None  # s from that state to this write
    deadline_misses: int  # ticks skipped so far
    rejected: Mapping[str, int]  # packets refused so far, by reason


Packet: TypeAlias = DeviceState | EnvironmentQuery | EnvironmentReply | ForceCommand | Telemetry

TOPICS: dict[str, type[Packet]] = {
    "device_state": DeviceState,
    "environment_query": EnvironmentQuery,
    "environment_reply": EnvironmentReply,
    "force_command": ForceCommand,
    "telemetry": Telemetry,
}

TOPIC_OF: dict[type[Packet], str] = {packet: topic for topic, packet in TOPICS.items()}
