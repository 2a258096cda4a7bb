"""Maps of a sweep: curves, or with two varied arguments one panel per law.

A cell has the colour of its figure. Where the hand received energy (``leaks``), it is red instead,
on a logarithmic scale; where the hand does not come to rest, it is hatched. A map of the minimum
energy itself is light blue where nothing leaks. In a map of the displayed stiffness over that of
the wall, a white line is where a hand begins to feel it softer than it is (Weber fraction).
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, TypeAlias

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from forcebound.files import content_of
from forcebound.graph.forms import Values
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.lab.sweep import map_data as data
from forcebound.lab.sweep.limits import CONDITIONS, LABELS, limit_of
from forcebound.lab.sweep.map_data import Array, Cells
from forcebound.lab.table import Table, read_table
from forcebound.results.colours import colours_of
from forcebound.results.panels import in_figure
from forcebound.results.perception import WEBER_FRACTIONS
from forcebound.results.plots import blank, plain, save
from forcebound.units import MJ

Legend: TypeAlias = dict[str, Artist]  # what a drawn thing is like, by its words

LONGEST_TITLE = 400  # characters
_LEAKS = LinearSegmentedColormap.from_list("leaks", ["#ffd9a8", "#e06010", "#600018"])
_PASSIVE = "#d8e6f2"
_NO_FIGURE = "#eeeeee"
_SOFTER: dict[str, Any] = {  # a white line that is seen on any colour, also in the legend
    "linewidth": 1.4,
    "path_effects": [Stroke(linewidth=2.6, foreground="black"), Normal()],
}
_BELOW = "#b0b0b0"  # no colour of a logarithmic scale
_COLUMNS = 3
MOST_TICKS = 6  # of an axis of a small panel
WIDE = 300.0  # ratio of the ends of a logarithmic axis across, above which numbers would overlap
_STYLES = {
    "colgate_schenkel": "-",
    "abbott_okamura": "--",
    "diolaiti": "-",
    "with_hand": "-.",
    "encoder": ":",
    "gil": (0, (5, 1, 1, 1, 1, 1)),
}
STIFFNESSES = ("stiffness", "environment.stiffness")  # axes on which a limit is drawn
_LEAK = ENERGY_TOLERANCE * MJ.factor  # mJ


def draw(result: Path, picture: Path, **given: Any) -> None:
    """Draw a map of a sweep file.

    Args:
        result: Parquet file of the sweep.
        picture: File to write, ``.png`` or ``.svg``.
        given: As of :func:`.map_data.drawing_of`.

    Raises:
        ConfigError: If there is nothing to draw, or the result lacks a column of the map.
    """
    with content_of(result):
        figure = figure_of(read_table(result), **given)
    save(figure, picture)


def figure_of(table: Table, new: Callable[..., Figure] = Figure, **given: Any) -> Figure:
    """Return the figure of a map, made by ``new``; else as :func:`draw`."""
    drawing = data.drawing_of(table, **given)
    figure = (_surfaces if "y" in drawing else _curves)(table, drawing, new)
    title = drawing.get("title") or table.about.get("description", "")
    figure.suptitle(fill(in_figure(title, LONGEST_TITLE), round(10 * figure.get_figwidth())))
    return figure


def _curves(table: Table, drawing: Values, new: Callable[..., Figure]) -> Figure:
    """Draw a panel for each combination of the other arguments, a line for each ``per``.

    Faint where the hand did not come to rest: there a mean over the steady state means little.
    """
    x, value = data.numbers_of(table, drawing["x"]), data.numbers_of(table, drawing["value"])
    per = data.groups_of(table, drawing)
    shown = {f"over.{name}" for name in (drawing["x"], drawing.get("per"), data.SEED)}
    others = [key for key in table.columns if key.startswith("over.") and key not in shown]
    rest = list(zip(*(table.columns[name] for name in others), strict=True)) or [()] * x.size
    panels = list(dict.fromkeys(rest))
    figure, axes, columns = _panels(new, len(panels), (4.6, 3.2), (2.4, 1.0))
    names = list(dict.fromkeys(per))
    rests = data.rests_of(table, x.size) > 0.0
    legend: Legend = {}
    for axis, panel in zip(axes, panels, strict=False):
        for number, (name, colour) in enumerate(zip(names, colours_of(names), strict=True)):
            rows = [i for i in range(x.size) if rest[i] == panel and per[i] == name]
            rows.sort(key=lambda i: x[i])
            style = ("-", "--", ":")[number // 10] if len(names) > 10 else "-"
            axis.plot(x[rows], value[rows], style, color=colour, lw=1.0, alpha=0.3)
            at_rest = np.where(rests[rows], value[rows], np.nan)
            (line,) = axis.plot(x[rows], at_rest, style, color=colour, lw=1.6, marker=".")
            legend |= {} if name is None else {_words(name): line}
        settings = (_setting(table, n[5:], v) for n, v in zip(others, panel, strict=True))
        axis.set_title(", ".join(settings), fontsize=10)
        axis.set_xlabel(data.axis_of(table, drawing["x"])[0])
        axis.set_xlim(x.min(), x.max())
        axis.tick_params(labelbottom=True)  # there may be no panel below
        if _is_log(np.unique(x)):
            axis.set_xscale("log")
            _plain_numbers(axis.xaxis)
        plain(axis)
    for axis in axes[::columns]:
        axis.set_ylabel(data.axis_of(table, drawing["value"])[0])
    if drawing.get("scale") == "log":
        axes[0].set_yscale("log")
        _plain_numbers(axes[0].yaxis)
    if not rests.all():
        faint = Line2D([], [], color="black", lw=1.0, alpha=0.3)
        legend["faint: the hand does\nnot come to rest"] = faint
    if legend:
        figure.legend([*legend.values()], [*legend], loc="outside right center", frameon=False)
    return figure


def _panels(
    new: Callable[..., Figure], count: int, each: tuple[float, float], more: tuple[float, float]
) -> tuple[Figure, Array, int]:
    """Return a figure, the axes of its panels, and how many are in a row; sizes in inches."""
    columns = min(_COLUMNS, count)
    rows = -(-count // columns)
    size = max(each[0] * columns + more[0], 7.0), max(each[1] * rows + more[1], 4.6)
    figure = blank(*size, new)
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axis in axes[count:]:
        axis.set_visible(False)
    return figure, axes, columns


def _words(name: object) -> str:
    return "" if name is None else in_figure(str(name).replace("_", " "))


def _setting(table: Table, name: str, value: Any) -> str:
    if isinstance(value, str):
        return in_figure(f"{name.replace('_', ' ')} {value}")
    label, factor = data.axis_of(table, name)
    return f"{label} {value * factor:g}"


def _surfaces(table: Table, drawing: Values, new: Callable[..., Figure]) -> Figure:
    """Draw a panel for each ``per``, with a cell for each pair of x and y."""
    cells = Cells(table, drawing)
    panels = list(dict.fromkeys(cells.group))
    figure, axes, columns = _panels(new, len(panels), (3.4, 2.6), (1.6, 1.0))
    norm, leak_norm = _scale(cells), _leak_scale(cells.leaks)
    legend: Legend = {}
    below = 0
    for axis, panel in zip(axes, panels, strict=False):
        chosen = np.array([one == panel for one in cells.group])
        legend |= _draw_panel(axis, cells, chosen, norm, leak_norm)
        axis.set_title(_words(panel), fontsize=10)
        below += int(_is_below(cells, chosen, norm).sum())
    if below:
        legend[f"0: below the scale (cells: {below})"] = Patch(facecolor=_BELOW)
    _arrange(axes, cells, len(panels), columns)
    if not cells.is_energy:
        _add_bar(figure, axes, norm, "viridis", data.axis_of(table, drawing["value"])[0])
    if cells.is_energy or (cells.leaks < -_LEAK).any():
        _add_bar(figure, axes, leak_norm, _LEAKS, "energy given to the hand (mJ)")
    shown: dict[str, Any] = {"loc": "outside lower center", "frameon": False}
    shown["ncols"] = 3 if figure.get_figwidth() > 10.0 else 2
    figure.legend([*legend.values()], [*legend], **shown)
    return figure


def _draw_panel(
    axis: Axes, cells: Cells, chosen: Array, norm: Normalize, leak_norm: Normalize
) -> Legend:
    xs, ys = cells.xs, cells.ys
    borders = _borders(xs), _borders(ys)
    value, leaks = cells.grid(cells.value, chosen), cells.grid(cells.leaks, chosen)
    is_leak = leaks < -_LEAK
    passive = np.where(leaks >= -_LEAK, 1.0, np.nan)
    axis.set_facecolor(_NO_FIGURE)
    if cells.is_energy:
        axis.pcolormesh(*borders, passive, cmap=ListedColormap([_PASSIVE]))
    else:
        axis.pcolormesh(*borders, np.where(is_leak, np.nan, value), norm=norm, cmap="viridis")
    axis.pcolormesh(*borders, np.where(is_leak, -leaks, np.nan), norm=leak_norm, cmap=_LEAKS)
    if (below := _is_below(cells, chosen, norm)).any():
        shown = np.where(below, 1.0, np.nan)
        axis.pcolormesh(*borders, shown, cmap=ListedColormap([_BELOW]))
    legend = _draw_limits(axis, cells, chosen)
    if cells.is_energy:
        legend["no energy given"] = Patch(facecolor=_PASSIVE)
    if np.isnan(value[~is_leak]).any():
        legend["no figure"] = Patch(facecolor=_NO_FIGURE, edgecolor="#808080")
    if xs.size < 2 or ys.size < 2:
        return legend  # a row has no areas and no contours
    restless = (cells.grid(cells.rests, chosen) == 0.0) & ~is_leak
    if restless.any():
        shown = np.ma.masked_where(~restless, restless)
        clear = ListedColormap([(0.0, 0.0, 0.0, 0.0)])  # without an array the mask is lost
        hatched = axis.pcolor(*borders, shown, cmap=clear)
        hatched.set(edgecolor="black", linewidth=0.0, hatch="////")
        legend["no rest"] = Patch(facecolor="white", edgecolor="black", hatch="////")
    if cells.shows_softness:
        softest = 1.0 - WEBER_FRACTIONS["displayed_stiffness_n_per_m"][0]
        share = np.where(is_leak, np.nan, value / ys[:, np.newaxis])
        if (share < softest).any() and (share > softest).any():
            axis.contour(xs, ys, share, levels=[softest], colors="white").set(**_SOFTER)
            softer = Line2D([], [], color="white", **_SOFTER)
            legend["a wall begins to feel softer than it is"] = softer
    return legend


def _is_below(cells: Cells, chosen: Array, norm: Normalize) -> Array:
    """Return which cells of a panel are at 0 or less, which a logarithmic scale cannot show."""
    value, leaks = cells.grid(cells.value, chosen), cells.grid(cells.leaks, chosen)
    below: Array = (value <= 0.0) & ~(leaks < -_LEAK) & isinstance(norm, LogNorm)
    return below


def _draw_limits(axis: Axes, cells: Cells, chosen: Array) -> Legend:
    """Draw each limit that is not the same line as one before; the legend says what others need."""
    columns, is_stiffness = cells.table.columns, cells.drawing["y"] in STIFFNESSES
    errors = columns.get("error", [None] * cells.x.size)
    ran = np.array([error is None for error in errors])
    steps: Any = "steps-mid" if cells.drawing["x"] == "delay" else "default"
    factor, drawn = data.axis_of(cells.table, cells.drawing["y"])[1], set()
    legend: Legend = {}
    absent: dict[str, list[str]] = {}
    for name in cells.drawing.get("limits", ()):
        limits = []
        for position in cells.xs:
            rows = np.flatnonzero(chosen & (cells.x == position) & ran)
            row = {key: column[rows[0]] for key, column in columns.items() if rows.size}
            limits.append(limit_of(row, name) * factor if is_stiffness else math.nan)
        if np.isnan(limits).all():
            absent.setdefault(CONDITIONS[name], []).append(LABELS[name])
        elif (line := " ".join(f"{limit:.6g}" for limit in limits)) not in drawn:
            drawn.add(line)
            shown = {"ls": _STYLES[name], "lw": 1.3, "drawstyle": steps}
            (legend[LABELS[name]],) = axis.plot(cells.xs, limits, "k", **shown)
    for needed, labels in absent.items():
        words = fill(f"not drawn without {needed}: {'; '.join(labels)}", 42)
        legend[words] = Line2D([], [], linestyle="")
    return legend


def _plain_numbers(axis: Axis, subs: Sequence[float] = (1.0, 2.0, 5.0)) -> None:
    """Give a logarithmic axis numbers as they are written, at these multiples of decades."""
    axis.set_major_locator(LogLocator(subs=subs, numticks=MOST_TICKS))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def _arrange(axes: Array, cells: Cells, panels: int, columns: int) -> None:
    xs, ys = cells.xs, cells.ys
    for axis, values in ((axes[0].xaxis, xs), (axes[0].yaxis, ys)):
        if _is_log(values):
            (axes[0].set_xscale if axis is axes[0].xaxis else axes[0].set_yscale)("log")
            is_wide = axis is axes[0].xaxis and values[-1] > WIDE * values[0]
            _plain_numbers(axis, (1.0,) if is_wide else (1.0, 2.0, 5.0))
        else:
            axis.set_major_locator(MaxNLocator(MOST_TICKS))
    axes[0].set_xlim(_borders(xs)[[0, -1]])
    axes[0].set_ylim(_borders(ys)[[0, -1]])
    x, y = (data.axis_of(cells.table, cells.drawing[key])[0] for key in "xy")
    for number in range(panels):
        if number + columns >= panels:
            axes[number].set_xlabel(x)
            axes[number].tick_params(labelbottom=True)
        if number % columns == 0:
            axes[number].set_ylabel(y.replace(" (", "\n("))


def _add_bar(figure: Figure, axes: Array, norm: Normalize, colours: Any, label: str) -> None:
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=axes.tolist(), format="{x:g}")
    bar.set_label(label)
    bar.ax.yaxis.set_minor_formatter(NullFormatter())
    if isinstance(norm, LogNorm):
        bar.set_ticks(LogLocator(subs=(1.0, 2.0, 5.0)))


def _scale(cells: Cells) -> Normalize:
    known = cells.value[np.isfinite(cells.value) & ~(cells.leaks < -_LEAK)]
    if cells.drawing.get("scale") == "log" and (known > 0.0).any():
        return LogNorm(known[known > 0.0].min(), known.max())
    return Normalize(known.min(initial=0.0), known.max(initial=1.0))


def _leak_scale(leaks: Array) -> Normalize:
    given = -leaks[leaks < -_LEAK]
    return LogNorm(max(given.min(initial=1.0), 1e-4), max(given.max(initial=1.0), 1e-3))


def _borders(values: Array) -> Array:
    """Return where the cells about some values end, one more: half way to the next ones."""
    if values.size < 2:
        return values + np.array([-0.5, 0.5]) * (abs(values[0]) or 1.0)
    scaled = np.log(values) if _is_log(values) else values
    middles = 0.5 * (scaled[1:] + scaled[:-1])
    ends = 2.0 * scaled[0] - middles[0], 2.0 * scaled[-1] - middles[-1]
    borders: Array = np.array([ends[0], *middles, ends[1]])
    return np.exp(borders) if _is_log(values) else borders


def _is_log(values: Array) -> bool:
    if values.size < 3 or values[0] <= 0:
        return False
    ratios = values[1:] / values[:-1]
    return bool(ratios.max() < 1.05 * ratios.min())
