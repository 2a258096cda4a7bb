"""The picture of an identification: loss over speed, friction over the range, the bounds."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forcebound.lab.identification.procedure import AxisFound, Found
from forcebound.results.plots import save

FOUND, STATED = "#0072B2", "#D55E00"  # Okabe and Ito
ROOM = 1.2  # times the largest value: where an axis ends
#: How a unit is shown, and how many of it that is.
SHOWN = {"m": ("mm", 1e3), "rad": ("rad", 1.0), "N": ("N", 1.0), "N m": ("mN m", 1e3)}


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
    place, (force, scale) = units[0], SHOWN[units[1]]
    b, f = found.damping, found.friction
    speeds = np.array([0.0, 1.05 * max(one.speed for one in found.passes)])
    axes.plot(
        [one.speed for one in found.passes], [scale * one.loss for one in found.passes], "o",
        color=FOUND, markersize=4, label="passes, there and back",
    )  # fmt: skip
    line = scale * (f.estimate + b.estimate * speeds)
    axes.plot(speeds, line, color=FOUND, linewidth=1, label="found: friction and damping")
    stated = scale * (f.lower + b.lower * speeds)
    axes.plot(speeds, stated, "--", color=STATED, label="a lower bound of both")
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, ROOM * float(line[-1]))
    axes.set_xlabel(f"speed ({place}/s)")
    axes.set_ylabel(f"axis {number + 1}: loss ({force})")
    axes.legend(frameon=False, fontsize="small", loc="lower right")


def _draw_range(
    axes: Axes, found: AxisFound, span: tuple[float, float], units: tuple[str, str]
) -> None:
    (place, length), (force, scale) = SHOWN[units[0]], SHOWN[units[1]]
    cells = found.friction_of_parts
    parts = 1 + max(part for _, part in cells)
    poses = sorted({pose for pose, _ in cells})
    several = ", by pose of the other axes" if len(poses) > 1 else ""
    edges = length * np.linspace(*span, parts + 1)
    for pose in poses:
        own = [scale * cells.get((pose, part), np.nan) for part in range(parts)]
        label = f"found in each part{several}" if pose == poses[0] else None
        axes.stairs(own, edges, baseline=None, color=FOUND, label=label)
    stated = scale * found.friction.lower
    axes.axhline(stated, linestyle="--", color=STATED, label="a lower bound of all")
    axes.set_ylim(0.0, ROOM * scale * max(cells.values()))
    axes.set_xlabel(f"place ({place})")
    axes.set_ylabel(f"friction ({force})")
    axes.legend(frameon=False, fontsize="small", loc="lower left")
