"""Figures that compare laws in one panel, in the colours and style of the plots of runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forcebound.analysis.colours import LAW_COLOURS, NEUTRAL
from forcebound.analysis.surface import Floats

LOG_TICKS = (0.5, 1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True)
class Line:
    """One curve."""

    label: str
    x: Floats
    y: Floats
    style: str = "-"
    colour: str = "black"
    is_wide: bool = False  # a broad pale line under the others


def law_line(law: str, x: Floats, y: Floats, note: str = "", style: str = "-") -> Line:
    """Return the curve of a law, in its colour; ``note`` follows its name in the legend."""
    return Line(f"{law.replace('_', ' ')}{note}", x, y, style, LAW_COLOURS[law])


@dataclass(frozen=True)
class Row:
    """One panel over the whole width."""

    label: str
    lines: Sequence[Line]
    x_label: str = "time since the force engaged (s)"
    window: tuple[float, float] | None = None  # of x; None: all
    y_range: tuple[float, float] | None = None  # then logarithmic


def draw_rows(rows: Sequence[Row], height: float = 2.1) -> Figure:
    """Return a figure with one row per panel, the legend at its right."""
    drawing = Figure(figsize=(11.0, 0.6 + height * len(rows)), dpi=150, layout="constrained")
    grid = drawing.subplots(len(rows), 1, squeeze=False)[:, 0]
    for row, axes in zip(rows, grid, strict=True):
        draw_row(axes, row)
    drawing.align_ylabels(list(grid))
    return drawing


def draw_row(axes: Axes, row: Row) -> None:
    """Draw one panel."""
    for line in row.lines:
        x, y = line.x, line.y
        if row.window is not None:  # scale to the visible part
            seen = (x >= row.window[0]) & (x <= row.window[1])
            x, y = x[seen], y[seen]
        style: dict[str, Any] = {"color": line.colour, "linestyle": line.style}
        width, alpha = (3.5, 0.4) if line.is_wide else (1.1, 1.0)
        axes.plot(x, y, label=line.label, linewidth=width, alpha=alpha, **style)
    if row.window is not None:
        axes.set_xlim(*row.window)
    else:
        axes.margins(x=0.01)
    if row.y_range is not None:
        axes.set_yscale("log")
        axes.set_ylim(*row.y_range)
        ticks = [tick for tick in LOG_TICKS if row.y_range[0] <= tick <= row.y_range[1]]
        axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
    axes.set_ylabel(row.label, fontsize=9)
    style_axes(axes, row.x_label)
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8)


def style_axes(axes: Axes, x_label: str) -> None:
    """Label the x axis, and set grid, spines and size of the tick labels."""
    axes.set_xlabel(x_label, fontsize=9)
    axes.grid(True, color=NEUTRAL, alpha=0.2, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
