"""The picture of an identification: loss over speed, friction over the range, the bounds."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forcebound.analysis.plots import save
from forcebound.identification.procedure import AxisFound, Found

FOUND, STATED, PARTS = "#0072B2", "#D55E00", "#56B4E9"  # Okabe and Ito


def draw(found: Found, units: tuple[str, str], title: str, path: Path) -> None:
    """Draw what was found of each axis, and what may be stated.

    Args:
        found: In the identification.
        units: Of a reading and of a force: m and N, or rad and N m.
        title: Of the figure.
        path: Of the file, ``.png`` or ``.svg``.

    Raises:
        ConfigError: If it cannot be written.
    """
    figure = Figure(figsize=(9.0, 0.6 + 2.9 * len(found.axes)), layout="constrained")
    figure.suptitle(title)
    rows = figure.subplots(len(found.axes), 2, squeeze=False)
    for number, (axis, (left, right)) in enumerate(zip(found.axes, rows, strict=True)):
        _draw_loss(left, axis, units, number)
        _draw_range(right, axis, found.measured_range[number], units)
    save(figure, path)


def _draw_loss(axes: Axes, found: AxisFound, units: tuple[str, str], number: int) -> None:
    place, force = units
    b, f = found.damping, found.friction
    axes.plot(
        [one.speed for one in found.passes], [one.loss for one in found.passes], "o",
        color=FOUND, markersize=4, label="passes, there and back",
    )  # fmt: skip
    speeds = np.array([0.0, 1.05 * max(one.speed for one in found.passes)])
    axes.plot(speeds, f.estimate + b.estimate * speeds, color=FOUND, linewidth=1)
    axes.plot(speeds, f.lower + b.lower * speeds, "--", color=STATED, label="stated: a lower bound")
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(f"speed ({place}/s)")
    axes.set_ylabel(f"axis {number + 1}: loss ({force})")
    axes.legend(frameon=False, fontsize="small")


def _draw_range(
    axes: Axes, found: AxisFound, span: tuple[float, float], units: tuple[str, str]
) -> None:
    place, force = units
    parts = 1 + max(part for _, part in found.friction_of_parts)
    edges = np.linspace(*span, parts + 1)
    for pose in sorted({pose for pose, _ in found.friction_of_parts}):
        own = [found.friction_of_parts.get((pose, part), np.nan) for part in range(parts)]
        label = "friction, by pose of the other axes" if pose == 0 else None
        axes.stairs(own, edges, baseline=None, color=PARTS, label=label)
    axes.axhline(found.friction.lower, linestyle="--", color=STATED, label="stated: a lower bound")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(f"place ({place})")
    axes.set_ylabel(f"friction ({force})")
    axes.legend(frameon=False, fontsize="small", loc="lower left")
