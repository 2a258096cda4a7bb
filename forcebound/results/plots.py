"""Figures of runs side by side: one column per run, one row per panel.

matplotlib is imported when a figure is made, and without pyplot: no window, no global state. A
figure of the same data is the same file, byte by byte.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain, pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from forcebound.errors import ConfigError
from forcebound.extras import check_installed
from forcebound.files import check_writable
from forcebound.messages.events import LAW_CHANGED, PARAMETERS_SET, PHASE_BEGINS, PUBLISHED
from forcebound.messages.packets import Event
from forcebound.recordings.launched import launched
from forcebound.results.colours import NEUTRAL, NOT_PASSIVE, PHASE
from forcebound.results.panels import (
    PANELS,
    TIME,
    Panel,
    Run,
    in_figure,
    signal_panels,
    since_engaged,
    view_of,
)
from forcebound.results.signals import Curve
from forcebound.units import S

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DEFAULT_PANELS = ("position", "force", "energy", "loop_delay")
PATH_PANELS = ("path_xy", "path_xz")  # of runs of two axes the first, of more both

CHANGES = (PARAMETERS_SET, LAW_CHANGED, "environment_serves")  # events that are drawn as faults are
MARKS = ((":", "v"), ("--", "o"), ("-.", "s"), ("-", "P"))  # line and top by kind; last: further
MOST_MARKS = 200  # lines of events, and phases, that a figure has; more would hide the curves

SHARED_RATIO = 10.0  # of the spans of two runs: above, one scale would flatten the calmer run
DELAY_CLIP = 3.0  # times the 99th percentile: longer delays get a note, not the scale

FORMATS = {".png": {"Software": None}, ".svg": {"Date": None, "Creator": None}}  # without dates


def figure(
    runs: Sequence[Run],
    panels: Sequence[str] | None = None,
    events: Sequence[Sequence[Event]] = (),
    signals: Sequence[Sequence[Curve]] = (),
    new: Callable[..., Figure] | None = None,
) -> Figure:
    """Return a figure with one column per run and one row per panel.

    A row has one scale, so that runs can be compared by eye. Where their ranges differ more than
    tenfold, energies get a symmetric logarithmic scale, and other rows a scale per run, which is
    noted in the panel.

    Args:
        runs: Label, telemetry, and launch file as resolved, of each run; at least one.
        panels: Keys of ``PANELS``, from top to bottom; None: those that suit the number of axes.
        events: Events of each run: faults, changes and those of the parts' own code are drawn as
            vertical lines, phases as bands.
        signals: Of each run; each unit has a panel, below the others.
        new: Makes the empty figure; None: without pyplot.

    Raises:
        ConfigError: If a launch file does not fit its run.
    """
    if panels is None:
        axes = max(columns.position.shape[1] for _, columns, _ in runs)
        is_in_space = any(launched(config).axis_kind == "length" for _, _, config in runs)
        panels = (*DEFAULT_PANELS, *PATH_PANELS[: axes - 1 if is_in_space else 0])
    rows = {name: PANELS[name] for name in panels} | signal_panels(chain(*signals))
    drawing = blank(1.6 + 4.4 * len(runs), 0.9 + 1.75 * len(rows), new)
    grid = drawing.subplots(len(rows), len(runs), squeeze=False)
    known = zip(events or [()] * len(runs), signals or [()] * len(runs), strict=True)
    for column, run, (marked, curves) in zip(grid.T, runs, known, strict=True):
        _draw_column(list(column), run, list(rows.values()), marked, curves)
    for (name, panel), row_axes in zip(rows.items(), grid, strict=True):
        labels = [panel.label(launched(config).axis_kind) for _, _, config in runs]
        for one, label in zip(row_axes, labels, strict=True):
            if label != labels[0] or one is row_axes[0]:
                one.set_ylabel(label, fontsize=9)
        _arrange_row(name, list(row_axes), is_alike=len(set(labels)) == 1)
    drawing.align_ylabels(list(grid[:, 0]))
    return drawing


def blank(width: float, height: float, new: Callable[..., Figure] | None = None) -> Figure:
    """Return an empty figure of a size in inches; ``new`` makes it, None: without pyplot."""
    from matplotlib.figure import Figure

    return (new or Figure)(figsize=(width, height), dpi=150, layout="constrained")


def plain(axes: Axes) -> None:
    """Give axes a faint grid, and no lines above and to the right."""
    axes.grid(True, color=NEUTRAL, alpha=0.2, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_column(
    column: list[Axes],
    run: Run,
    rows: list[Panel],
    events: Sequence[Event],
    signals: Sequence[Curve],
) -> None:
    """Draw the panels of a run; panels over time that stand together share numbers and label."""
    view = view_of(run, events, signals)
    column[0].set_title(_title(run), fontsize=11)
    labels = [panel.x_label(view.kind) for panel in rows]
    over_time = S.label(TIME)
    first = None
    for axes, panel, below in zip(column, rows, [*labels[1:], None], strict=True):
        panel.draw(axes, view)
        if panel.shows and view.axes > 1 and view.kind is not None:
            _note(axes, panel.shows.format(view=view), left=True)
        x_label = panel.x_label(view.kind)
        if x_label == over_time:
            if run[1].time.size:
                _mark(axes, run, events, names=axes is column[0])
            first = first or axes
            if axes is not first:
                axes.sharex(first)
        if x_label == below == over_time:
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel(x_label, fontsize=9)


def _mark(axes: Axes, run: Run, events: Sequence[Event], *, names: bool) -> None:
    """Draw events: vertical lines for faults and changes, bands for phases."""
    columns = run[1]
    first, end = since_engaged(columns)[[0, -1]].tolist()
    zero_ns = int(columns.time_ns[0]) - round(first * 1e9)
    begins = [event for event in events if event.event == PHASE_BEGINS][:MOST_MARKS]
    changes = () if begins else CHANGES  # the changes of a phase are named by it
    marked = [
        event
        for event in events
        if event.is_fault or event.event in changes or PUBLISHED in event.data
    ]
    marked = [event for event in marked if event.time_ns >= zero_ns]
    kinds = list(dict.fromkeys(event.event for event in marked))
    for event in marked[:MOST_MARKS]:
        number = kinds.index(event.event)
        is_rest = number >= len(MARKS) - 1 and len(kinds) > len(MARKS)
        line, top = MARKS[min(number, len(MARKS) - 1)]
        name = "other events" if is_rest else in_figure(event.event.replace("_", " "))
        colour = NOT_PASSIVE if event.is_fault else NEUTRAL
        at = (event.time_ns - zero_ns) * 1e-9
        drawn = axes.axvline(at, label=name if names else None, color=colour, linestyle=line)
        drawn.set(linewidth=0.8, clip_on=False)
        drawn.set(marker=top, markersize=3.5, markevery=[1])  # at its top
    bounds = [*((event.time_ns - zero_ns) * 1e-9 for event in begins), end]
    for start, stop in list(pairwise(bounds))[1::2]:
        axes.axvspan(start, stop, color=PHASE, alpha=0.10, linewidth=0.0, zorder=0)
    if names and begins:
        above = axes.secondary_xaxis("top")
        middles = [(start + stop) / 2.0 for start, stop in pairwise(bounds)]
        words = [in_figure(event.data.get("name", "")) for event in begins]
        above.set_xticks(middles, words, rotation=30, ha="left", fontsize=7, color=NEUTRAL)
        above.tick_params(length=0.0, pad=1.0)
        above.spines["top"].set_visible(False)


def _title(run: Run) -> str:
    label, name = in_figure(run[0]), launched(run[2]).device.law
    if label == name:
        return f"law: {name}"
    return label if name is None or name in label.split() else f"{label} (law: {in_figure(name)})"


def _arrange_row(name: str, row: list[Axes], is_alike: bool) -> None:
    for axes in row:
        plain(axes)
        axes.tick_params(labelsize=8)
        axes.margins(x=0.01)
    if name == "energy":
        _scale_energy(row)
    elif name == "loop_delay":
        _scale_delay(row)
    elif name not in PATH_PANELS:  # a path has one scale for both of its axes
        limits = np.array([axes.get_ylim() for axes in row])
        spans = limits[:, 1] - limits[:, 0]
        if is_alike and spans.max() <= SHARED_RATIO * spans.min():
            _share(row, limits[:, 0].min(), limits[:, 1].max())
        else:
            for axes in row:
                _note(axes, "own scale")
    handles: dict[str, Artist] = {}
    for axes in row:  # a run may lack a line that another has
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if handles:
        key = row[-1].legend(handles.values(), handles, fontsize=8, handlelength=1.4, frameon=False)
        key.set(loc="center left", bbox_to_anchor=(1.01, 0.5))


def _scale_energy(row: list[Axes]) -> None:
    # The extent of the data, not of the axis: a margin is no energy.
    lows = [min(axes.dataLim.y0, 0.0) for axes in row]
    highs = [max(axes.dataLim.y1, 0.0) for axes in row]
    sizes = [size for low, high in zip(lows, highs, strict=True) if (size := max(-low, high)) > 0.0]
    low, high = min(lows), max(highs)
    margin = 0.08 * (high - low) or 1.0
    bottom, top = low - margin, high + margin
    if sizes and max(sizes) > SHARED_RATIO * min(sizes):
        linear = 10.0 ** np.round(np.log10(min(sizes)))
        for axes in row:
            axes.set_yscale("symlog", linthresh=linear)
            axes.yaxis.set_major_formatter("{x:g}")
        row[0].set_ylabel(f"energy (mJ)\nlog beyond ±{linear:g} mJ", fontsize=9)
        bottom, top = min(2.0 * low, -0.3 * linear), max(2.0 * high, 0.3 * linear)
    for axes in row:
        area = axes.axhspan(bottom, 0.0, label="not passive", color=NOT_PASSIVE, alpha=0.12)
        area.set(linewidth=0.0, zorder=0)
    _share(row, bottom, top)


def _scale_delay(row: list[Axes]) -> None:
    delays = [np.asarray(axes.lines[0].get_ydata()) if axes.lines else np.empty(0) for axes in row]
    known = [values[np.isfinite(values)] for values in delays]
    tops = [min(v.max(), DELAY_CLIP * np.percentile(v, 99.0)) for v in known if v.size]
    top = 1.15 * float(max(tops, default=0.0)) or 1.0
    for axes, values in zip(row, known, strict=True):
        if not values.size:
            _note(axes, "no replies")
        elif values.max() > top:
            _note(axes, f"longest: {values.max():.3g} ms")
    _share(row, 0.0, top)


def _share(row: list[Axes], bottom: float, top: float) -> None:
    """Give a row one scale, and leave its numbers to the first column."""
    for axes in row:
        axes.set_ylim(bottom, top)
    for axes in row[1:]:
        axes.tick_params(labelleft=False)


def _note(axes: Axes, text: str, *, left: bool = False) -> None:
    x, side = (0.01, "left") if left else (0.99, "right")
    words = axes.text(x, 0.95, text, transform=axes.transAxes, ha=side, va="top", fontsize=8)
    words.set_color(NEUTRAL)
    words.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0})


def check_picture(path: Path) -> None:
    """Check before the work begins that a picture can be written.

    Raises:
        ConfigError: As :func:`save`.
    """
    if path.suffix.lower() not in FORMATS:
        raise ConfigError(f"a picture must end in {' or '.join(FORMATS)}, got {path.name!r}")
    check_installed("a picture", "matplotlib")
    check_writable(path, "the picture")


def save(drawing: Figure, path: str | PathLike[str]) -> None:
    """Write a figure to a ``.png`` or ``.svg`` file, the same bytes for the same figure.

    Raises:
        ConfigError: If the file name ends otherwise, or the file cannot be written.
    """
    import matplotlib

    path = Path(path)
    check_picture(path)
    suffix = path.suffix.lower()
    try:
        with matplotlib.rc_context({"svg.hashsalt": "forcebound"}):
            drawing.savefig(path, format=suffix[1:], metadata=FORMATS[suffix])
    except OSError as error:
        raise ConfigError(f"cannot write the picture {path}: {error.strerror}") from error
