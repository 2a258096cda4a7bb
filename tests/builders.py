"""Builders of packets and times that several test modules share."""

from dataclasses import dataclass
from typing import Any

from forcebound.messages.packets import DeviceState, EnvironmentQuery, EnvironmentReply, Telemetry

MS = 1_000_000  # ns


@dataclass(frozen=True)
class TimedPacket:
    """All that a link looks at in a packet."""

    seq: int
    time_ns: int


def telemetry_packet(tick: int = 0, **fields: Any) -> Telemetry:
    """Return a tick at 1 kHz: at rest, answered at once, no ground truth; ``fields`` differ."""
    usual: dict[str, Any] = {
        "seq": tick,
        "time_ns": tick * MS,
        "elapsed": tick * 1e-3,
        "position": (0.0,),
        "commanded_force": (0.0,),
        "applied_force": (0.0,),
        "force_limit": 1.0,
        "estimated_energy": 0.0,
        "true_energy": None,
        "true_position": None,
        "hand_force": None,
        "engagement": 1.0,
        "device_seq": tick,
        "loop_delay": 4e-4,
        "deadline_misses": 0,
        "rejected": {},
    }
    return Telemetry(**usual | fields)


def state(tick: int, *position: float, velocity: float = 0.0, **more: Any) -> DeviceState:
    """Return the state of a device at 1 kHz, as fast on each axis."""
    speeds, zero = (velocity,) * len(position), (0.0,) * len(position)
    return DeviceState(tick, tick * MS, tick * 1e-3, position, speeds, zero, **more)


def reply(tick: int, *force: float) -> EnvironmentReply:
    """Return the answer to the query about the state of a tick."""
    return EnvironmentReply(tick, 0, tick, tick * MS, tick, 0, force, "e")


def query(seq: int, position: float = 0.011) -> EnvironmentQuery:
    """Return the query of a controller about the state of its millisecond, on one axis (m)."""
    return EnvironmentQuery(seq, seq * MS, seq, seq * MS, 0.0, (position,), (0.0,), None)


def full_telemetry(tick: int = 0, axes: int = 1) -> Telemetry:
    """Return a tick of a simulated device, with a value in each field but those of the ledger."""
    vector = tuple(0.1 * (axis + 1) + tick for axis in range(axes))
    return telemetry_packet(
        tick,
        time_ns=tick * MS + 400_000,
        position=vector,
        commanded_force=vector,
        applied_force=vector,
        force_limit=8.5,
        estimated_energy=0.1,
        true_energy=1 / 3,
        true_position=vector,
        hand_force=vector,
        rejected={"age": tick},
        torques=vector,
        reply_age=0.04,
        given_energy=0.2,
        received_energy=0.1,
        velocity=vector,
    )
