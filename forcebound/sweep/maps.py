"""Maps of a sweep: one panel per law, with theoretical limits.

Energies: a leak, below zero by more than rounding, is red on a logarithmic scale; elsewhere light
blue means that the hand comes to rest, dark blue that it does not. Other figures have one scale for
all panels.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure

from forcebound.analysis.plots import save
from forcebound.bounding import ENERGY_TOLERANCE
from forcebound.errors import ConfigError
from forcebound.sweep.limits import LABELS, limit_of
from forcebound.sweep.table import Table, read_table

_Array: TypeAlias = np.ndarray[Any, Any]

_LEAKS = LinearSegmentedColormap.from_list("leaks", ["#ffe0b3", "#e06010", "#600018"])
_PASSIVE = "#d8e6f2"
_RESTLESS = "#9fb4c8"
_COLUMNS = 3
_STYLES = {"colgate_schenkel": "-", "abbott_okamura": "--", "diolaiti": ":"}

#: Parameters and figures in everyday units: label, factor.
_UNITS: dict[str, tuple[str, float]] = {
    "stiffness": ("stiffness of the wall (N/mm)", 1e-3),
    "damping": ("damping of the wall (N s/m)", 1.0),
    "delay": ("delay, each way (ms)", 1e3),
    "compute_delay": ("computation time (ms)", 1e3),
    "approach_speed": ("approach speed (mm/s)", 1e3),
    "true_energy_min_j": ("minimum energy (mJ)", 1e3),
    "displayed_stiffness_n_per_m": ("displayed stiffness (N/mm)", 1e-3),
    "rate_hardness_n_per_m": ("rate-hardness (N/mm)", 1e-3),
    "peak_force_n": ("peak force (N)", 1.0),
    "final_speed_m_per_s": ("speed at the end (mm/s)", 1e3),
}


def draw(result: Path, picture: Path) -> None:
    """Draw the map of a sweep file.

    Args:
        result: Parquet file of the sweep.
        picture: File to write, ``.png`` or ``.svg``.

    Raises:
        ConfigError: If the result has no map or lacks a column of it.
    """
    table = read_table(result)
    drawing = table.about.get("map") or {}
    if not drawing:
        raise ConfigError(f"{result}: its sweep file has no section map")
    figure = _surfaces(table, drawing) if "y" in drawing else _curves(table, drawing)
    figure.suptitle(drawing.get("title") or table.about.get("description", ""))
    figure.set_dpi(130)
    save(figure, picture)


def _label(name: str) -> str:
    return _UNITS.get(name, (name.replace("_", " "), 1.0))[0]


def _column(table: Table, name: str) -> list[Any]:
    for key in (f"over.{name}", name):
        if key in table.columns:
            return table.columns[key]
    raise ConfigError(f"the result has no column {name!r}; it has {', '.join(table.columns)}")


def _numbers(table: Table, name: str) -> _Array:
    try:
        values = [math.nan if value is None else float(value) for value in _column(table, name)]
    except ValueError:
        raise ConfigError(f"the column {name!r} is text; a map needs numbers") from None
    return np.array(values) * _UNITS.get(name, ("", 1.0))[1]


def _panels(table: Table, drawing: Mapping[str, Any]) -> list[str | None]:
    return list(dict.fromkeys(_column(table, drawing["per"]))) if "per" in drawing else [None]


def _surfaces(table: Table, drawing: Mapping[str, Any]) -> Figure:
    x, y = _numbers(table, drawing["x"]), _numbers(table, drawing["y"])
    value = _numbers(table, drawing["value"])
    rests = np.array([1.0 if rest is None else float(rest) for rest in table.columns["at_rest"]])
    panels = _panels(table, drawing)
    group = np.array(_column(table, drawing["per"])) if "per" in drawing else np.full(x.size, None)
    is_energy = drawing["value"].endswith("energy_min_j")
    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(3.4 * columns + 1.2, 2.6 * rows + 1.0), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    xs, ys = np.unique(x), np.unique(y)
    norm = _scale(value, is_energy)
    mesh = None
    for axis, panel in zip(axes, panels, strict=False):
        chosen = group == panel
        grid = _worst(xs, ys, x[chosen], y[chosen], value[chosen])
        axis.set_facecolor("#eeeeee")
        if is_energy:
            is_passive = grid >= -ENERGY_TOLERANCE * 1e3
            rest = _worst(xs, ys, x[chosen], y[chosen], rests[chosen])
            for colour, cells in ((_PASSIVE, is_passive), (_RESTLESS, is_passive & (rest == 0.0))):
                cells = np.where(cells, 1.0, np.nan)
                axis.pcolormesh(*_edges(xs, ys), cells, cmap=ListedColormap([colour]))
            grid = np.where(grid < -ENERGY_TOLERANCE * 1e3, -grid, np.nan)
        mesh = axis.pcolormesh(*_edges(xs, ys), grid, norm=norm, cmap=_LEAKS if is_energy else None)
        axis.set_title("" if panel is None else str(panel).replace("_", " "), fontsize=10)
        _draw_limits(axis, table, drawing, chosen, xs)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    if _is_log(xs):
        axes[0].set_xscale("log")
    if _is_log(ys):
        axes[0].set_yscale("log")
    axes[0].set_xlim(xs[0], xs[-1])
    axes[0].set_ylim(ys[0], ys[-1])
    for number in range(len(panels)):
        if number + columns >= len(panels):
            axes[number].set_xlabel(_label(drawing["x"]))
            axes[number].tick_params(labelbottom=True)
        if number % columns == 0:
            axes[number].set_ylabel(_label(drawing["y"]).replace(" (", "\n("))
    assert mesh is not None
    label = (
        "energy given to the hand (mJ)\nblue: none; dark blue: none, but no rest"
        if is_energy
        else _label(drawing["value"])
    )
    figure.colorbar(mesh, ax=axes.tolist()).set_label(label, fontsize=8)
    handles, labels = axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def _worst(xs: _Array, ys: _Array, x: _Array, y: _Array, value: _Array) -> _Array:
    """Return the lowest value of all cases in each cell; of repeated seeds, the worst counts."""
    grid = np.full((ys.size, xs.size), np.nan)
    for row, column, number in zip(
        np.searchsorted(ys, y), np.searchsorted(xs, x), value, strict=True
    ):
        grid[row, column] = np.fmin(grid[row, column], number)
    return grid


def _scale(value: _Array, is_energy: bool) -> Normalize:
    known = value[np.isfinite(value)]
    if is_energy:
        leaks = -known[known < -ENERGY_TOLERANCE * 1e3]
        return LogNorm(max(leaks.min(initial=1.0), 1e-4), max(leaks.max(initial=1.0), 1e-3))
    return Normalize(known.min(initial=0.0), known.max(initial=1.0))


def _is_log(values: _Array) -> bool:
    if values.size < 3 or values[0] <= 0:
        return False
    ratios = values[1:] / values[:-1]
    return bool(ratios.max() < 1.05 * ratios.min())


def _edges(xs: _Array, ys: _Array) -> tuple[_Array, _Array]:
    def between(values: _Array) -> _Array:
        if values.size == 1:
            return np.array([values[0] - 0.5, values[0] + 0.5])
        is_log = _is_log(values)
        v = np.log(values) if is_log else values
        middle = (v[1:] + v[:-1]) / 2
        edges = np.concatenate(([2 * v[0] - middle[0]], middle, [2 * v[-1] - middle[-1]]))
        return np.exp(edges) if is_log else edges

    return between(xs), between(ys)


def _draw_limits(
    axis: Axes, table: Table, drawing: Mapping[str, Any], chosen: _Array, xs: _Array
) -> None:
    if drawing["y"] != "stiffness":
        return
    x = _numbers(table, drawing["x"])
    ran = np.array([error is None for error in table.columns["error"]])
    for name in drawing.get("limits", ()):
        if name not in LABELS:
            raise ConfigError(f"unknown limit {name!r}; known are {', '.join(sorted(LABELS))}")
        line = []
        for position in xs:
            rows = np.flatnonzero(chosen & (x == position) & ran)
            row = {key: column[rows[0]] for key, column in table.columns.items() if rows.size}
            line.append(limit_of(row, name) * 1e-3 if row else math.nan)
        steps = "steps-mid" if name == "diolaiti" else "default"
        axis.plot(xs, line, "k", ls=_STYLES[name], lw=1.2, drawstyle=steps, label=LABELS[name])


def _curves(table: Table, drawing: Mapping[str, Any]) -> Figure:
    """Draw a panel for each combination of the other arguments, a line for each ``per``.

    Faint where the hand did not come to rest: there a mean over the steady state means little.
    """
    x, value = _numbers(table, drawing["x"]), _numbers(table, drawing["value"])
    per = _column(table, drawing["per"]) if "per" in drawing else [None] * x.size
    others = [
        name
        for name in table.columns
        if name.startswith("over.") and name[5:] not in (drawing["x"], drawing.get("per"), "seed")
    ]
    rest = list(zip(*(table.columns[name] for name in others), strict=True)) or [()] * x.size
    panels: Sequence[tuple[Any, ...]] = list(dict.fromkeys(rest))
    figure = Figure(figsize=(4.6 * len(panels) + 2.4, 4.2), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False).ravel()
    names = list(dict.fromkeys(per))
    rests = np.array([bool(rest) for rest in table.columns.get("at_rest", [True] * x.size)])
    for axis, panel in zip(axes, panels, strict=True):
        for number, name in enumerate(names):
            rows = [i for i in range(x.size) if rest[i] == panel and per[i] == name]
            rows.sort(key=lambda i: x[i])
            style = ("-", "--", ":")[number // 10] if len(names) > 10 else "-"
            label = None if name is None else str(name).replace("_", " ")
            colour = f"C{number % 10}"
            axis.plot(x[rows], value[rows], style, color=colour, lw=1.0, alpha=0.3)
            at_rest = np.where(rests[rows], value[rows], np.nan)
            axis.plot(x[rows], at_rest, style, color=colour, lw=1.6, marker=".", label=label)
        axis.set_title(
            ", ".join(_setting(n[5:], v) for n, v in zip(others, panel, strict=True)), fontsize=10
        )
        axis.set_xlabel(_label(drawing["x"]))
        axis.set_xlim(x.min(), x.max())
        axis.grid(alpha=0.3)
    axes[0].set_ylabel(_label(drawing["value"]))
    if drawing.get("scale") == "log":
        axes[0].set_yscale("log")
    axes[-1].annotate(
        "faint: the hand does not come to rest",
        (0.98, 0.98),
        xycoords="axes fraction",
        ha="right",
        va="top",
        fontsize=8,
    )
    if names != [None]:
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right center", frameon=False)
    return figure


def _setting(name: str, value: Any) -> str:
    if isinstance(value, str):
        return f"{name.replace('_', ' ')} {value}"
    label, factor = _UNITS.get(name, (name.replace("_", " "), 1.0))
    return f"{label} {value * factor:g}"
