"""Maps of a sweep: curves, or with two varied arguments one panel per law.

A cell has the colour of its figure. Where the hand received energy (``leaks``), it is red instead,
on a logarithmic scale; where the hand does not come to rest, it is hatched. A map of the minimum
energy itself is light blue where nothing leaks. In a map of the displayed stiffness over that of
the wall, a white line is where a hand begins to feel it softer than it is (Weber fraction).
"""

import math
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from forcebound.errors import ConfigError
from forcebound.files import content_of
from forcebound.graph.forms import Values
from forcebound.graph.problems import unknown
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.lab.sweep.limits import LABELS, limit_of
from forcebound.lab.table import Table, read_table
from forcebound.results.colours import colours_of
from forcebound.results.panels import in_figure
from forcebound.results.perception import WEBER_FRACTIONS
from forcebound.results.plots import blank, plain, save
from forcebound.results.tables import axes_of_figures
from forcebound.units import MJ, MM_S, MS, N_MM, Everyday, to_si

Array: TypeAlias = np.ndarray[Any, Any]

FIGURE_AXES = axes_of_figures()
#: Words for the axis of a parameter or figure, and its unit.
AXES: dict[str, tuple[str, Everyday]] = {
    "stiffness": ("stiffness of the wall", N_MM),
    "damping": ("damping of the wall", Everyday("N s/m", "N s/m")),
    "delay": ("delay, each way", MS),
    "compute_delay": ("computation time", MS),
    "approach_speed": ("approach speed", MM_S),
} | FIGURE_AXES

LONGEST_TITLE = 400  # characters
_LEAKS = LinearSegmentedColormap.from_list("leaks", ["#ffd9a8", "#e06010", "#600018"])
_PASSIVE = "#d8e6f2"
_NO_FIGURE = "#eeeeee"
_SOFTER: dict[str, Any] = {  # a white line that is seen on any colour, also in the key
    "linewidth": 1.4,
    "path_effects": [Stroke(linewidth=2.6, foreground="black"), Normal()],
}
_COLUMNS = 3
MOST_TICKS = 6  # of an axis of a small panel
WIDE = 300.0  # ratio of the ends of a logarithmic axis across, above which numbers would overlap
_STYLES = {
    "colgate_schenkel": "-",
    "abbott_okamura": "--",
    "diolaiti": "-",
    "with_hand": "-.",
    "encoder": ":",
}
_LEAK = ENERGY_TOLERANCE * MJ.factor  # mJ


def draw(result: Path, picture: Path) -> None:
    """Draw the map of a sweep file.

    Args:
        result: Parquet file of the sweep.
        picture: File to write, ``.png`` or ``.svg``.

    Raises:
        ConfigError: If the result has no map or lacks a column of it.
    """
    with content_of(result):
        figure = _drawn(read_table(result), result)
    save(figure, picture)


def _drawn(table: Table, result: Path) -> Figure:
    drawing = table.about.get("map") or {}
    if not drawing:
        raise ConfigError(f"{result} has no map: its sweep file or campaign needs one")
    per = drawing.get("per")
    if not {per, f"over.{per}"} & set(table.columns):  # held constant on the command line
        drawing = {key: value for key, value in drawing.items() if key != "per"}
    figure = draw_surfaces(table, drawing) if "y" in drawing else _curves(table, drawing)
    title = drawing.get("title") or table.about.get("description", "")
    figure.suptitle(fill(in_figure(title, LONGEST_TITLE), round(10 * figure.get_figwidth())))
    return figure


def label_of(table: Table, name: str) -> str:
    """Return the label of an axis for a parameter or figure."""
    return _axis(table, name)[0]


def _axis(table: Table, name: str) -> tuple[str, float]:
    """Label and factor: of an argument that is not known here, in the unit of the sweep file."""
    hand, _, figure = name.rpartition(".")
    if figure in (FIGURE_AXES if hand else AXES):
        words, unit = AXES[figure]
        return unit.label(f"{in_figure(hand)}: {words}" if hand else words), unit.factor
    words, written = name.replace("_", " "), (table.about.get("units") or {}).get(name, "")
    size = to_si(f"1 {written}") if written else None
    return (in_figure(words), 1.0) if not size else (in_figure(f"{words} ({written})"), 1.0 / size)


def column_of(table: Table, name: str) -> list[Any]:
    """Return a column by its name, or that of a varied argument.

    Raises:
        ConfigError: If there is none.
    """
    for key in (f"over.{name}", name):
        if key in table.columns:
            return table.columns[key]
    raise ConfigError(unknown("column of the result", name, table.columns))


def numbers_of(table: Table, name: str) -> Array:
    """Return a column of numbers in everyday units, NaN for none.

    Raises:
        ConfigError: If there is no such column, or it is text.
    """
    column = column_of(table, name)
    try:
        values = [math.nan if v is None else float(v) for v in column]
    except ValueError:
        raise ConfigError(f"the column {name!r} is text; a map needs numbers") from None
    return np.array(values) * _axis(table, name)[1]


def _curves(table: Table, drawing: Values) -> Figure:
    """Draw a panel for each combination of the other arguments, a line for each ``per``.

    Faint where the hand did not come to rest: there a mean over the steady state means little.
    """
    x, value = numbers_of(table, drawing["x"]), numbers_of(table, drawing["value"])
    per = column_of(table, drawing["per"]) if "per" in drawing else [None] * x.size
    others = [
        name
        for name in table.columns
        if name.startswith("over.") and name[5:] not in (drawing["x"], drawing.get("per"), "seed")
    ]
    rest = list(zip(*(table.columns[name] for name in others), strict=True)) or [()] * x.size
    panels: Sequence[tuple[Any, ...]] = list(dict.fromkeys(rest))
    figure = blank(4.6 * len(panels) + 2.4, 4.2)
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False).ravel()
    names = list(dict.fromkeys(per))
    colours = colours_of(names)
    rests = _rests(table, x.size) > 0.0
    for axis, panel in zip(axes, panels, strict=True):
        for number, name in enumerate(names):
            rows = [i for i in range(x.size) if rest[i] == panel and per[i] == name]
            rows.sort(key=lambda i: x[i])
            style = ("-", "--", ":")[number // 10] if len(names) > 10 else "-"
            label = None if name is None else in_figure(str(name).replace("_", " "))
            colour = colours[number]
            axis.plot(x[rows], value[rows], style, color=colour, lw=1.0, alpha=0.3)
            at_rest = np.where(rests[rows], value[rows], np.nan)
            axis.plot(x[rows], at_rest, style, color=colour, lw=1.6, marker=".", label=label)
        axis.set_title(
            ", ".join(_setting(table, n[5:], v) for n, v in zip(others, panel, strict=True)),
            fontsize=10,
        )
        axis.set_xlabel(label_of(table, drawing["x"]))
        axis.set_xlim(x.min(), x.max())
        plain(axis)
    axes[0].set_ylabel(label_of(table, drawing["value"]))
    if drawing.get("scale") == "log":
        axes[0].set_yscale("log")
    handles, labels = axes[0].get_legend_handles_labels() if names != [None] else ([], [])
    if not rests.all():
        handles.append(Line2D([], [], color="black", lw=1.0, alpha=0.3))
        labels.append("faint: the hand does\nnot come to rest")
    if handles:
        figure.legend(handles, labels, loc="outside right center", frameon=False)
    return figure


def _setting(table: Table, name: str, value: Any) -> str:
    if isinstance(value, str):
        return in_figure(f"{name.replace('_', ' ')} {value}")
    label, factor = _axis(table, name)
    return f"{label} {value * factor:g}"


def _rests(table: Table, size: int) -> Array:
    """Return for each case 1 if all hands come to rest, or it is not known, else 0."""
    rests = np.ones(size)
    for name in table.columns:
        if name.rpartition(".")[2] == "at_rest":
            rests *= [1.0 if rest is None else float(rest) for rest in table.columns[name]]
    return rests


class _Map:
    """The numbers of a map in everyday units, one for each case, and the axes of its panels.

    Attributes:
        leaks: Lowest energy, in mJ; NaN: not asked for.
        rests: 1: all hands come to rest, 0: one does not.
        group: Name of the panel.
    """

    def __init__(self, table: Table, drawing: Values) -> None:
        self.table, self.drawing = table, drawing
        self.x, self.y, self.value = (
            numbers_of(table, drawing[key]) for key in ("x", "y", "value")
        )
        self.xs, self.ys = np.unique(self.x), np.unique(self.y)
        self.is_energy = drawing["value"].endswith("energy_min_j")
        self.leaks: Array = self.value if self.is_energy else np.full(self.x.size, math.nan)
        if "leaks" in drawing and not self.is_energy:
            self.leaks = numbers_of(table, drawing["leaks"])
        self.rests = _rests(table, self.x.size)
        names = column_of(table, drawing["per"]) if "per" in drawing else [None] * self.x.size
        self.group = np.array(names, dtype=object)
        self.is_softer = False  # somewhere, as a line shows

    def grid(self, values: Array, chosen: Array) -> Array:
        """Return the lowest value of all cases in each cell: of repeated seeds, the worst."""
        grid = np.full((self.ys.size, self.xs.size), np.nan)
        rows, columns = np.searchsorted(self.ys, self.y), np.searchsorted(self.xs, self.x)
        np.fmin.at(grid, (rows[chosen], columns[chosen]), values[chosen])
        return grid

    @property
    def shows_softness(self) -> bool:
        """Whether it is a map of the displayed stiffness over that of the wall."""
        asked = (self.drawing["value"], self.drawing["y"])
        return asked == ("displayed_stiffness_n_per_m", "stiffness")


def draw_surfaces(table: Table, drawing: Values) -> Figure:
    """Return the figure of a map with two varied arguments.

    Raises:
        ConfigError: If the result lacks a column of the map.
    """
    shown = _Map(table, drawing)
    panels = list(dict.fromkeys(shown.group))
    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = blank(max(3.4 * columns + 1.6, 7.0), max(2.6 * rows + 1.0, 4.6))
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    norm, leak_norm = _scale(shown), _leak_scale(shown.leaks)
    for axis, panel in zip(axes, panels, strict=False):
        chosen = np.array([one == panel for one in shown.group])
        _draw_panel(axis, shown, chosen, norm, leak_norm)
        name = "" if panel is None else in_figure(str(panel).replace("_", " "))
        axis.set_title(name, fontsize=10)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    _arrange(axes, shown, len(panels), columns)
    _add_keys(figure, axes, shown, norm, leak_norm)
    return figure


def _draw_panel(
    axis: Axes, shown: _Map, chosen: Array, norm: Normalize, leak_norm: Normalize
) -> None:
    xs, ys = shown.xs, shown.ys
    value, leaks = shown.grid(shown.value, chosen), shown.grid(shown.leaks, chosen)
    rest = shown.grid(shown.rests, chosen)
    is_leak = leaks < -_LEAK
    axis.set_facecolor(_NO_FIGURE)
    if shown.is_energy:
        passive = np.where(leaks >= -_LEAK, 1.0, np.nan)
        axis.pcolormesh(xs, ys, passive, cmap=ListedColormap([_PASSIVE]))
    else:
        axis.pcolormesh(xs, ys, np.where(is_leak, np.nan, value), norm=norm, cmap="viridis")
    axis.pcolormesh(xs, ys, np.where(is_leak, -leaks, np.nan), norm=leak_norm, cmap=_LEAKS)
    _draw_limits(axis, shown, chosen)
    if xs.size < 2 or ys.size < 2:
        return  # a row has no areas and no contours
    restless = (rest == 0.0) & ~is_leak
    if restless.any():
        axis.contourf(xs, ys, restless, levels=[0.5, 1.5], hatches=["////"], colors="none")
    if shown.shows_softness:
        softest = 1.0 - WEBER_FRACTIONS["displayed_stiffness_n_per_m"][0]
        share = np.where(is_leak, np.nan, value / ys[:, np.newaxis])
        if (share < softest).any() and (share > softest).any():
            shown.is_softer = True
            axis.contour(xs, ys, share, levels=[softest], colors="white").set(**_SOFTER)


def _arrange(axes: Array, shown: _Map, panels: int, columns: int) -> None:
    xs, ys = shown.xs, shown.ys
    for axis, values in ((axes[0].xaxis, xs), (axes[0].yaxis, ys)):
        if _is_log(values):
            (axes[0].set_xscale if axis is axes[0].xaxis else axes[0].set_yscale)("log")
            is_wide = axis is axes[0].xaxis and values[-1] > WIDE * values[0]
            subs = (1.0,) if is_wide else (1.0, 2.0, 5.0)
            axis.set_major_locator(LogLocator(subs=subs, numticks=MOST_TICKS))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        else:
            axis.set_major_locator(MaxNLocator(MOST_TICKS))
    axes[0].set_xlim(xs[0], xs[-1])
    axes[0].set_ylim(ys[0], ys[-1])
    for number in range(panels):
        if number + columns >= panels:
            axes[number].set_xlabel(label_of(shown.table, shown.drawing["x"]))
            axes[number].tick_params(labelbottom=True)
        if number % columns == 0:
            axes[number].set_ylabel(label_of(shown.table, shown.drawing["y"]).replace(" (", "\n("))


def _add_keys(
    figure: Figure, axes: Array, shown: _Map, norm: Normalize, leak_norm: Normalize
) -> None:
    places = axes.tolist()
    scales: list[tuple[Normalize, str | LinearSegmentedColormap, str]] = []
    if not shown.is_energy:
        scales.append((norm, "viridis", label_of(shown.table, shown.drawing["value"])))
    if np.isfinite(shown.leaks).any():
        scales.append((leak_norm, _LEAKS, "energy given to the hand (mJ)"))
    for scale, colours, label in scales:
        bar = figure.colorbar(ScalarMappable(scale, colours), ax=places, format="{x:g}")
        bar.set_label(label)
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
        if isinstance(scale, LogNorm):
            bar.set_ticks(LogLocator(subs=(1.0, 2.0, 5.0)))
    handles, labels = axes[0].get_legend_handles_labels()
    handles, labels = list(handles), list(labels)
    if shown.is_energy:
        handles.append(Patch(facecolor=_PASSIVE))
        labels.append("no energy given")
    if ((shown.rests == 0.0) & ~(shown.leaks < -_LEAK)).any():
        handles.append(Patch(facecolor="white", edgecolor="black", hatch="////"))
        labels.append("no rest")
    if np.isnan(shown.value[np.isnan(shown.leaks) | (shown.leaks >= -_LEAK)]).any():
        handles.append(Patch(facecolor=_NO_FIGURE, edgecolor="#808080"))
        labels.append("no figure")
    if shown.is_softer:
        handles.append(Line2D([], [], color="white", **_SOFTER))
        labels.append("a wall begins to feel softer than it is")
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=3 if figure.get_figwidth() > 10.0 else 2,
        frameon=False,
    )


def _scale(shown: _Map) -> Normalize:
    known = shown.value[np.isfinite(shown.value) & ~(shown.leaks < -_LEAK)]
    if shown.drawing.get("scale") == "log" and (known > 0.0).any():
        return LogNorm(known[known > 0.0].min(), known.max())
    return Normalize(known.min(initial=0.0), known.max(initial=1.0))


def _leak_scale(leaks: Array) -> Normalize:
    given = -leaks[leaks < -_LEAK]
    return LogNorm(max(given.min(initial=1.0), 1e-4), max(given.max(initial=1.0), 1e-3))


def _is_log(values: Array) -> bool:
    if values.size < 3 or values[0] <= 0:
        return False
    ratios = values[1:] / values[:-1]
    return bool(ratios.max() < 1.05 * ratios.min())


def _draw_limits(axis: Axes, shown: _Map, chosen: Array) -> None:
    if shown.drawing["y"] != "stiffness":
        return
    columns = shown.table.columns
    ran = np.array([error is None for error in columns["error"]])
    for name in shown.drawing.get("limits", ()):
        if name == "with_hand" and not any(columns.get("operator.damping", ())):
            continue  # the same line as without it
        line = []
        for position in shown.xs:
            rows = np.flatnonzero(chosen & (shown.x == position) & ran)
            row = {key: column[rows[0]] for key, column in columns.items() if rows.size}
            line.append(limit_of(row, name) * N_MM.factor if row else math.nan)
        steps = "steps-mid" if shown.drawing["x"] == "delay" else "default"
        axis.plot(
            shown.xs, line, "k", ls=_STYLES[name], lw=1.3, drawstyle=steps, label=LABELS[name]
        )
