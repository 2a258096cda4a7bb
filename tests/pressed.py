"""A hand that presses into a wall, as telemetry, and its summary, for tests of summaries."""

import json
from collections.abc import Callable
from typing import Any

from builders import telemetry_packet

from forcebound.analysis.summary import summarize
from forcebound.analysis.tables import summary_rows
from forcebound.messages.packets import Telemetry
from forcebound.telemetry import TelemetryColumns

WALL = 0.010  # m
RATE = 1000  # Hz


def config(**environment: Any) -> dict[str, Any]:
    wall = {"kind": "wall", "position": WALL, "stiffness": 10_000.0}
    return {
        "device": {
            "kind": "phantom_premium_1_5",
            "law": "certified",
            "rate": 1000.0,
            "hold_limit": 1.25,
            "damping": 0.27,
            "friction": 0.12,
            "resolution": 3e-5,
        },
        "environment": wall | environment,
    }


def ticks(
    path: Callable[[float], float],
    shown: float = 540.0,
    commanded: float = 10_000.0,
    duration: float = 6.0,
) -> list[Telemetry]:
    """Return a run along ``path`` in which a wall of ``commanded`` N/m shows as ``shown`` N/m."""
    run = []
    for tick in range(round(duration * RATE)):
        elapsed = tick / RATE
        position = path(elapsed)
        depth = max(position - WALL, 0.0)
        run.append(
            telemetry_packet(
                tick,
                position=(position,),
                commanded_force=(commanded * depth,),
                applied_force=(shown * depth,),
                force_limit=8.5,
                estimated_energy=0.002,
                true_energy=0.003,
                true_position=(position,),
                hand_force=(0.0,),
            )
        )
    return run


def pressing(speed: float = 0.1, end: float = 0.014) -> Callable[[float], float]:
    """Return a path that moves in at ``speed`` (m/s) and rests at ``end`` (m)."""
    return lambda elapsed: min(speed * elapsed, end)


def summary_of(run: list[Telemetry], document: dict[str, Any] | None = None) -> dict[str, Any]:
    chosen = config() if document is None else document
    summary = summarize(TelemetryColumns.from_packets(run), chosen)
    json.dumps(summary, allow_nan=False)  # always valid JSON
    assert len(summary_rows(summary)) == len({label for label, _ in summary_rows(summary)})
    return summary
