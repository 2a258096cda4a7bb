"""What the scaled controller is good for: a reach of 0.4 m with a device of 0.1 m.

A hand moves as it can within the device's workspace; the figure has its way and that of the point
in the environment, for each of the three ways to reach farther than the device. No physics: the
hand is a path.
"""

import math
from collections.abc import Callable
from pathlib import Path

import click
from matplotlib.figure import Figure

from forcebound.haptics.controllers.scaled import Scaled
from forcebound.messages.packets import DeviceState

HALF = 0.05  # m, workspace of the device to each side
SECONDS = 4.0
MS = 1_000_000  # ns


def sweep_once(time: float) -> tuple[float, int]:
    """Return where a hand is that goes once from end to end, and the buttons."""
    return -HALF + 2.0 * HALF * min(time / 3.0, 1.0), 0


def row_with_clutch(time: float) -> tuple[float, int]:
    """Return the same for one that goes to and fro and holds the clutch on the way back."""
    phase = (time % 1.0) / 0.5
    return (
        (-HALF + 2.0 * HALF * phase, 0) if phase < 1.0 else (HALF - 2.0 * HALF * (phase - 1.0), 1)
    )


def lean_on_border(time: float) -> tuple[float, int]:
    """Return the same for one that goes to the border, leans over it, and comes back a little."""
    return (HALF * 1.3 * math.sin(math.pi * min(time / 3.6, 1.0)), 0)


CASES: dict[str, tuple[Scaled, Callable[[float], tuple[float, int]]]] = {
    "motion_scale: 4": (Scaled(motion_scale=4.0), sweep_once),
    "clutch_button: 0": (Scaled(clutch_button=0), row_with_clutch),
    "border: 40 mm, border_rate: 10 Hz": (Scaled(border=0.04, border_rate=10.0), lean_on_border),
}


@click.command()
@click.option("--out", default="docs/scaled.png", type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Draw a reach of 0.4 m with a device of 0.1 m."""
    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    panels = figure.subplots(1, len(CASES), sharey=True)
    for panel, (title, (model, hand)) in zip(panels, CASES.items(), strict=True):
        opened = model.open(1)
        times, ways, points = [], [], []
        for tick in range(round(SECONDS * 1e3)):
            time = tick * 1e-3
            position, buttons = hand(time)
            state = DeviceState(tick, tick * MS, time, (position,), (0.0,), (0.0,), None, buttons)
            opened.on_state(state, tick * MS)
            times.append(time)
            ways.append(position * 1e3)
            points.append(opened.query(state)[0][0] * 1e3)
        panel.plot(times, points, label="point in the environment")
        panel.plot(times, ways, label="device")
        panel.set(title=title, xlabel="time (s)")
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("position (mm)")
    panels[0].legend()
    figure.savefig(out, dpi=110)
