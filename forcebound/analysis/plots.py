"""Figures of runs side by side: one column per run, one row per panel.

matplotlib is imported when a figure is made, and without pyplot: no window, no global state. A
figure of the same data is the same file, byte by byte.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from forcebound.analysis.colours import NEUTRAL, NOT_PASSIVE, PHASE
from forcebound.analysis.panels import PANELS, Panel, Run, in_figure, since_engaged, view_of
from forcebound.analysis.summary import law
from forcebound.analysis.surface import Floats
from forcebound.errors import ConfigError
from forcebound.files import check_writable
from forcebound.messages.packets import Event
from forcebound.nodes.events import LAW_CHANGED, PARAMETERS_SET, PHASE_BEGINS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DEFAULT_PANELS = ("position", "force", "energy", "loop_delay")
PATH_PANELS = ("path_xy", "path_xz")  # of runs of two axes the first, of more both

CHANGES = (PARAMETERS_SET, LAW_CHANGED, "environment_serves")  # events that are drawn as faults are
MARKS = (
    (":", "v"),
    ("--", "o"),
    ("-.", "s"),
    ((0, (1, 4)), "D"),
    ((0, (6, 3, 1, 3, 1, 3)), "^"),
    ((0, (8, 2)), "X"),
    ((0, (3, 1, 1, 1)), "*"),
    ("-", "P"),
)  # line and marker at its top, by kind of event; the last is for all further kinds
MOST_MARKS = 200  # lines of events, and phases, that a figure has; more would hide the curves

SHARED_RATIO = 10.0  # of the spans of two runs: above, one scale would flatten the calmer run
DELAY_CLIP = 3.0  # times the 99th percentile: longer delays get a note, not the scale

FORMATS = {".png": {"Software": None}, ".svg": {"Date": None, "Creator": None}}  # without dates


def figure(
    runs: Sequence[Run],
    panels: Sequence[str] | None = None,
    events: Sequence[Sequence[Event]] = (),
) -> Figure:
    """Return a figure with one column per run and one row per panel.

    A row has one scale, so that runs can be compared by eye. Where their ranges differ more than
    tenfold, energies get a symmetric logarithmic scale, and other rows a scale per run, which is
    noted in the panel.

    Args:
        runs: Label, telemetry, and launch file as resolved, of each run; at least one.
        panels: Keys of ``PANELS``, from top to bottom; None: those that suit the number of axes.
        events: Events of each run: faults and changes are drawn as vertical lines, phases as bands.

    Raises:
        ConfigError: If a panel is unknown, or a launch file does not fit its run.
        ValueError: If there are no runs or no panels.
    """
    from matplotlib.figure import Figure

    if panels is None:
        axes = max((columns.position.shape[1] for _, columns, _ in runs), default=1)
        panels = (*DEFAULT_PANELS, *PATH_PANELS[: axes - 1])
    if not runs or not panels:
        raise ValueError("a figure needs at least one run and one panel")
    for name in panels:
        if name not in PANELS:
            raise ConfigError(f"no panel {name!r}; there are {', '.join(PANELS)}")
    size = (1.6 + 4.4 * len(runs), 0.9 + 1.75 * len(panels))
    drawing = Figure(figsize=size, dpi=150, layout="constrained")
    grid = drawing.subplots(len(panels), len(runs), squeeze=False)
    with np.errstate(all="ignore"):  # of what is no motion, such as a position of 1e308 m
        _draw(grid, runs, panels, events)
    drawing.align_ylabels(list(grid[:, 0]))
    return drawing


def _draw(
    grid: Any, runs: Sequence[Run], panels: Sequence[str], events: Sequence[Sequence[Event]]
) -> None:
    """Draw the panels into their axes, a column for each run."""
    for column, run in enumerate(runs):
        view = view_of(run, events[column] if column < len(events) else ())
        grid[0, column].set_title(_title(run), fontsize=11)
        for row, name in enumerate(panels):
            PANELS[name].draw(grid[row, column], view)
            if PANELS[name].shows and view.axes > 1:
                _note(grid[row, column], PANELS[name].shows.format(view=view), left=True)
            if column < len(events) and PANELS[name].x_label == Panel.x_label:
                _mark(grid[row, column], run, events[column], names=row == 0)
    for name, row_axes in zip(panels, grid, strict=True):
        _arrange_row(name, list(row_axes))
    for column_axes in grid.T:
        _share_time(panels, list(column_axes))


def _mark(axes: Axes, run: Run, events: Sequence[Event], *, names: bool) -> None:
    """Draw events: vertical lines for faults and changes, bands for phases."""
    columns = run[1]
    if not columns.time.size:
        return
    first, end = since_engaged(columns)[[0, -1]].tolist()
    zero_ns = int(columns.time_ns[0]) - round(first * 1e9)
    begins = [event for event in events if event.event == PHASE_BEGINS][:MOST_MARKS]
    changes = () if begins else CHANGES  # the changes of a phase are named by it
    marked = [event for event in events if event.is_fault or event.event in changes]
    marked = [event for event in marked if event.time_ns >= zero_ns]
    kinds = list(dict.fromkeys(event.event for event in marked))
    for event in marked[:MOST_MARKS]:
        number = min(kinds.index(event.event), len(MARKS) - 1)
        line, marker = MARKS[number]
        is_rest = number == len(MARKS) - 1 and len(kinds) > len(MARKS)
        name = "other events" if is_rest else in_figure(event.event.replace("_", " "))
        axes.axvline(
            (event.time_ns - zero_ns) * 1e-9,
            color=NOT_PASSIVE if event.is_fault else NEUTRAL,
            linestyle=line,
            linewidth=0.8,
            marker=marker,
            markersize=3.5,
            markevery=[1],  # at its top
            clip_on=False,
            label=name if names else None,
        )
    if names and len(marked) > MOST_MARKS:
        _note(axes, f"{MOST_MARKS} of {len(marked)} events")
    starts = [(event.time_ns - zero_ns) * 1e-9 for event in begins]
    bounds = [*starts, end]
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
    label, _, config = run
    label, name = in_figure(label), law(config)
    name = None if name is None else in_figure(name)
    if label == name:
        return f"law: {name}"
    return label if name is None or name in label.split() else f"{label} (law: {name})"


def _arrange_row(name: str, row: list[Axes]) -> None:
    for axes in row:
        axes.grid(True, color=NEUTRAL, alpha=0.2, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        axes.margins(x=0.01)
    row[0].set_ylabel(PANELS[name].label, fontsize=9)
    if name == "energy":
        _scale_energy(row)
    elif name == "loop_delay":
        _scale_delay(row)
    elif not PANELS[name].is_path:  # a path has one scale for both of its axes
        if name == "force":
            _leave_out_unused_sign(row)
        _share_scale_or_note(row)
    handles: dict[str, Any] = {}
    for axes in row:  # a run may lack a line that another has
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    if handles:
        row[-1].legend(
            handles.values(),
            handles.keys(),
            loc="center left",
            bbox_to_anchor=(1.01, 0.5),
            frameon=False,
            fontsize=8,
            handlelength=1.4,
        )


def _share_scale_or_note(row: list[Axes]) -> None:
    limits = np.array([axes.get_ylim() for axes in row])
    spans = limits[:, 1] - limits[:, 0]
    if spans.max() <= SHARED_RATIO * spans.min():
        for axes in row:
            axes.set_ylim(limits[:, 0].min(), limits[:, 1].max())
        _label_outer(row)
    else:
        for axes in row:
            _note(axes, "own scale")


def _leave_out_unused_sign(row: list[Axes]) -> None:
    """Cut off the sign of force that no curve has: a wall only pushes."""
    forces = [_finite(np.asarray(line.get_ydata())) for axes in row for line in axes.lines]
    known = [values for values in forces if values.size]
    for axes in row:
        low, high = axes.get_ylim()
        if known and min(values.min() for values in known) >= 0.0:
            axes.set_ylim(-0.05 * high, high)
        elif known and max(values.max() for values in known) <= 0.0:
            axes.set_ylim(low, -0.05 * low)


def _scale_energy(row: list[Axes]) -> None:
    # The extent of the data, not of the axis: a margin is no energy.
    lows = [min(axes.dataLim.y0, 0.0) for axes in row]
    highs = [max(axes.dataLim.y1, 0.0) for axes in row]
    sizes = [size for low, high in zip(lows, highs, strict=True) if (size := max(-low, high)) > 0.0]
    low, high = min(lows), max(highs)
    if sizes and max(sizes) > SHARED_RATIO * min(sizes):
        linear = 10.0 ** np.round(np.log10(min(sizes)))
        for axes in row:
            axes.set_yscale("symlog", linthresh=linear)
            axes.yaxis.set_major_formatter("{x:g}")
        # An entry of the legend without a line: in the panel it would lie over the curves.
        row[-1].plot([], [], " ", label=f"log beyond\n±{linear:g} mJ")
        bottom, top = min(2.0 * low, -0.3 * linear), max(2.0 * high, 0.3 * linear)
    else:
        margin = 0.08 * (high - low) or 1.0
        bottom, top = low - margin, high + margin
    for axes in row:
        axes.axhspan(
            bottom, 0.0, label="not passive", color=NOT_PASSIVE, alpha=0.12, linewidth=0.0, zorder=0
        )
        axes.set_ylim(bottom, top)
    _label_outer(row)


def _scale_delay(row: list[Axes]) -> None:
    delays = [_finite(np.asarray(axes.lines[0].get_ydata())) for axes in row if axes.lines]
    known = [values for values in delays if values.size]
    if not known:
        for axes in row:
            axes.set_ylim(0.0, 1.0)
            _note(axes, "no replies")
        return
    top = max(
        min(float(values.max()), DELAY_CLIP * float(np.percentile(values, 99.0)))
        for values in known
    )
    for axes in row:
        axes.set_ylim(0.0, 1.15 * top or 1.0)
        values = _finite(np.asarray(axes.lines[0].get_ydata())) if axes.lines else np.empty(0)
        if not values.size:
            _note(axes, "no replies")
        elif values.max() > 1.15 * top:
            _note(axes, f"longest: {values.max():.3g} ms")
    _label_outer(row)


def _finite(values: Floats) -> Floats:
    return values[np.isfinite(values)]


def _note(axes: Axes, text: str, *, left: bool = False) -> None:
    x, side = (0.01, "left") if left else (0.99, "right")
    words = axes.text(x, 0.95, text, transform=axes.transAxes, ha=side, va="top", fontsize=8)
    words.set_color(NEUTRAL)
    words.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0})


def _label_outer(row: list[Axes]) -> None:
    """Leave the numbers of a shared scale to the first column."""
    for axes in row[1:]:
        axes.tick_params(labelleft=False)


def _share_time(panels: Sequence[str], column: list[Axes]) -> None:
    """Leave numbers and label of the time axis to the last of the panels that stand together."""
    labels = [PANELS[name].x_label for name in panels]
    for axes, label, below in zip(column, labels, [*labels[1:], None], strict=True):
        if label == below == Panel.x_label:
            axes.tick_params(labelbottom=False)
        else:
            axes.set_xlabel(label, fontsize=9)
    over_time = [a for a, label in zip(column, labels, strict=True) if label == Panel.x_label]
    for axes in over_time[1:]:
        axes.sharex(over_time[0])


def check_picture(path: Path) -> None:
    """Check before the work begins that a picture can be written.

    Raises:
        ConfigError: As :func:`save`.
    """
    if path.suffix.lower() not in FORMATS:
        raise ConfigError(f"a picture must end in {' or '.join(FORMATS)}, got {path.name!r}")
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
