"""Maps of a sweep: what is needed to draw one, and curves.

:mod:`forcebound.lab.sweep.surfaces` draws maps with two varied arguments.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, TypeAlias

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from forcebound.errors import ConfigError
from forcebound.files import content_of
from forcebound.graph.problems import unknown
from forcebound.lab.table import Table, read_table
from forcebound.results.colours import colours_of
from forcebound.results.panels import in_figure
from forcebound.results.plots import save
from forcebound.results.tables import axis_labels
from forcebound.units import to_si

Array: TypeAlias = np.ndarray[Any, Any]

#: Parameters and figures in everyday units: label, factor.
UNITS: dict[str, tuple[str, float]] = {
    "stiffness": ("stiffness of the wall (N/mm)", 1e-3),
    "damping": ("damping of the wall (N s/m)", 1.0),
    "delay": ("delay, each way (ms)", 1e3),
    "compute_delay": ("computation time (ms)", 1e3),
    "approach_speed": ("approach speed (mm/s)", 1e3),
} | axis_labels()


LONGEST_TITLE = 400  # characters


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
    from forcebound.lab.sweep.surfaces import draw_surfaces

    drawing = table.about.get("map") or {}
    if not drawing:
        raise ConfigError(f"{result} has no map: its sweep file or campaign needs one")
    per = drawing.get("per")
    if not {per, f"over.{per}"} & set(table.columns):  # held constant on the command line
        drawing = {key: value for key, value in drawing.items() if key != "per"}
    figure = draw_surfaces(table, drawing) if "y" in drawing else _curves(table, drawing)
    title = drawing.get("title") or table.about.get("description", "")
    figure.suptitle(fill(in_figure(title, LONGEST_TITLE), round(10 * figure.get_figwidth())))
    figure.set_dpi(130)
    return figure


def label_of(table: Table, name: str) -> str:
    """Return the label of an axis for a parameter or figure."""
    return _axis(table, name)[0]


def _axis(table: Table, name: str) -> tuple[str, float]:
    """Label and factor: of an argument that is not known here, in the unit of the sweep file."""
    if name in UNITS:
        return UNITS[name]
    words, unit = name.replace("_", " "), (table.about.get("units") or {}).get(name, "")
    size = to_si(f"1 {unit}") if unit else None
    return (in_figure(words), 1.0) if not size else (in_figure(f"{words} ({unit})"), 1.0 / size)


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


def _curves(table: Table, drawing: Mapping[str, Any]) -> Figure:
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
    figure = Figure(figsize=(4.6 * len(panels) + 2.4, 4.2), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False).ravel()
    names = list(dict.fromkeys(per))
    colours = colours_of(names)
    rests = np.array([bool(rest) for rest in table.columns.get("at_rest", [True] * x.size)])
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
        axis.grid(alpha=0.3)
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
