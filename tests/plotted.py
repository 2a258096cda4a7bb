"""A run that is drawn, and what is on the drawing, for tests of plots."""

import math
from collections.abc import Sequence

import numpy as np
from builders import telemetry_packet
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import AxLine, Line2D
from numpy.typing import NDArray

from forcebound.messages.packets import Telemetry
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.panels import Run

WALL = 0.010  # m


def telemetry(ticks: int = 200, swing: float = 0.0, energy: float = 0.005) -> list[Telemetry]:
    """Return a hand that presses 2 mm into a wall, or swings about it with ``swing`` (m)."""
    run = []
    for tick in range(ticks):
        elapsed = tick * 1e-3
        position = min(0.2 * elapsed, WALL + 0.002) + swing * math.sin(60.0 * elapsed)
        commanded = max(10_000.0 * (position - WALL), 0.0)
        run.append(
            telemetry_packet(
                tick,
                position=(position,),
                commanded_force=(min(commanded, 8.5),),
                applied_force=(min(commanded, 2.0),),
                force_limit=2.0,
                estimated_energy=0.9 * energy * elapsed,
                true_energy=energy * elapsed,
                true_position=(position + 1e-5,),
                hand_force=(0.0,),
            )
        )
    return run


def run_of(packets: list[Telemetry], label: str = "bounded", law: str = "certified") -> Run:
    environment = {"kind": "wall", "position": WALL, "stiffness": 10_000.0}
    document = {"device": {"law": law}, "environment": environment}
    return label, TelemetryColumns.from_packets(packets), document


def panel(drawing: Figure, row: int, column: int = 0, columns: int = 1) -> Axes:
    return drawing.axes[row * columns + column]


def drawn(axes: Axes) -> dict[str, NDArray[np.float64]]:
    """Return the y data of the lines, by label."""
    return {str(line.get_label()): np.asarray(line.get_ydata()) for line in axes.lines}


def slopes(lines: Sequence[Line2D]) -> list[float]:
    found = [line.get_slope() for line in lines if isinstance(line, AxLine)]
    return [slope for slope in found if slope is not None]
