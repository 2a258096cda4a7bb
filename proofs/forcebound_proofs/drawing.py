"""How all pictures of the proofs are drawn."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forcebound.results.colours import LAW_COLOURS, NEUTRAL
from forcebound.results.surface import Floats

LOG_TICKS = (0.5, 1.0, 2.0, 5.0, 10.0)
TIME = "time since the force engaged (s)"


def rows_of(count: int, height: float = 2.1) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels over the whole width, one below the other."""
    drawing = Figure(figsize=(11.0, 0.6 + height * count), dpi=150, layout="constrained")
    return drawing, list(drawing.subplots(count, 1, squeeze=False)[:, 0])


def line(axes: Axes, x: Floats, y: Floats, label: str, colour: str = "black", **style: Any) -> None:
    """Draw one curve."""
    axes.plot(x, y, label=label, color=colour, **{"linewidth": 1.1, **style})


def law_line(axes: Axes, law: str, x: Floats, y: Floats, note: str = "", **style: Any) -> None:
    """Draw the curve of a law, in its colour; ``note`` follows its name in the legend."""
    line(axes, x, y, f"{law.replace('_', ' ')}{note}", LAW_COLOURS[law], **style)


def finish(
    axes: Axes, label: str, x_label: str = TIME, window: tuple[float, float] | None = None
) -> None:
    """Label a panel, and scale it to what is seen in its window."""
    axes.margins(x=0.01)
    if window is not None:
        for drawn in axes.lines:
            x, y = (np.asarray(data, float) for data in drawn.get_data())
            seen = (x >= window[0]) & (x <= window[1])
            drawn.set_data(x[seen], y[seen])
        axes.relim()
        axes.autoscale_view()
        axes.set_xlim(window)
    axes.set_ylabel(label, fontsize=9)
    plain(axes, x_label)
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, fontsize=8)


def plain(axes: Axes, x_label: str) -> None:
    """Label the x axis; set grid, spines and size of the tick labels."""
    axes.set_xlabel(x_label, fontsize=9)
    axes.grid(True, color=NEUTRAL, alpha=0.2, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
