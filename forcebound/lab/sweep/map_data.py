"""Data of a map: the columns that it shows, in everyday units, with their labels."""

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np

from forcebound.axes import shown_on
from forcebound.errors import ConfigError
from forcebound.graph.forms import Values
from forcebound.graph.problems import unknown
from forcebound.interface.figures import name_of
from forcebound.lab.table import Table
from forcebound.results.panels import in_figure
from forcebound.results.tables import axes_of_figures
from forcebound.units import MM_S, MS, N_MM, Everyday, to_si

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
SCALES = ("linear", "log")  # of the value
SEED = "seed"  # an argument that repeats a case; no axis


def drawing_of(table: Table, **given: Any) -> Values:
    """Return the map section of a result, with ``given`` keys in place of its own.

    Without ``x`` the last two varied numbers are x and y; without ``per`` each value of the first
    varied text has its own panel or line. An ``x`` alone draws curves.

    Raises:
        ConfigError: If there is nothing to draw, or no such column.
    """
    drawing = dict(table.about.get("map") or {})
    given = {key: value for key, value in given.items() if value is not None}
    if given or "x" not in drawing:
        dropped = {"title"} | ({"scale"} if "value" in given else set())
        dropped |= {"x", "y", "limits"} if {"x", "y"} & given.keys() else set()
        drawing = {k: v for k, v in drawing.items() if k not in dropped} | given
        varied = [key[5:] for key in table.columns if key.startswith("over.")]
        texts = [name for name in varied if str in map(type, column_of(table, name))]
        numbers = [name for name in varied if name not in (*texts, SEED, drawing.get("y"))]
        if "x" not in drawing:
            if not numbers:
                raise ConfigError("a map needs an argument that varies and is a number")
            drawing["x"] = numbers[-1]
            if numbers[1:]:
                drawing.setdefault("y", numbers[-2])
        if texts:
            drawing.setdefault("per", texts[0])
    if drawing.get("scale", "linear") not in SCALES:
        raise ConfigError(f"scale must be {' or '.join(SCALES)}, got {drawing['scale']!r}")
    if "value" not in drawing:
        raise ConfigError("there is no map: its sweep file has none; name a column to draw (value)")
    drawing |= {key: key_of(table, drawing[key]) for key in drawing.keys() & {"value", "leaks"}}
    per = drawing.get("per")
    if not {per, f"over.{per}"} & set(table.columns):  # held constant on the command line
        drawing.pop("per", None)
    return drawing


def key_of(table: Table, name: str) -> str:
    """Return the key of a column by its name, with or without the unit of a figure.

    Raises:
        ConfigError: If there is none.
    """
    named = (key for key in table.columns if name_of(key) == name)
    for key in (f"over.{name}", name, *named):
        if key in table.columns:
            return key
    raise ConfigError(unknown("column of the result", name, table.columns))


def column_of(table: Table, name: str) -> list[Any]:
    """Return a column by its name, or that of a varied argument; ConfigError if there is none."""
    return table.columns[key_of(table, name)]


def axis_of(table: Table, name: str) -> tuple[str, float]:
    """Return label and factor; of an argument not known here, in the unit of the sweep file."""
    name = name.removeprefix("over.")
    hand, _, figure = name.rpartition(".")
    if figure in (FIGURE_AXES if hand else AXES):
        words, unit = AXES[figure]
        turned = table.columns.get(f"{hand}{'.' * bool(hand)}units.{figure}", ())
        unit = shown_on("angle" if any(turned) else "length", unit)
        return unit.label(f"{in_figure(hand)}: {words}" if hand else words), unit.factor
    words, written = name.replace("_", " "), (table.about.get("units") or {}).get(name, "")
    size = to_si(f"1 {written}") if written else None
    return (in_figure(words), 1.0) if not size else (in_figure(f"{words} ({written})"), 1.0 / size)


def numbers_of(table: Table, name: str) -> Array:
    """Return a column of numbers in everyday units, NaN for none.

    Raises:
        ConfigError: If there is no such column, or it has texts or lists.
    """
    column = column_of(table, name)
    try:
        values = [math.nan if v is None else float(v) for v in column]
    except (TypeError, ValueError):
        message = f"the column {name!r} has texts or lists; a map needs a number for each run"
        raise ConfigError(message) from None
    return np.array(values) * axis_of(table, name)[1]


def rests_of(table: Table, size: int) -> Array:
    """Return for each case 1 if all hands come to rest, or it is not known, else 0."""
    rests = np.ones(size)
    for name in table.columns:
        if name.rpartition(".")[2] == "at_rest":
            rests *= [1.0 if rest is None else float(rest) for rest in table.columns[name]]
    return rests


class Cells:
    """The numbers of a map of two arguments, one for each case, and the axes of its panels.

    Attributes:
        leaks: Lowest energy, in mJ; NaN: not asked for.
        rests: 1: all hands come to rest, 0: one does not.
        group: Name of the panel.
        shows_softness: It is a map of the displayed stiffness over that of the wall.
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
        self.rests = rests_of(table, self.x.size)
        self.group = np.array(groups_of(table, drawing), dtype=object)
        shown = (drawing["value"], drawing["y"])
        self.shows_softness = shown == ("displayed_stiffness_n_per_m", "stiffness")

    def grid(self, values: Array, chosen: Array) -> Array:
        """Return the lowest value of all cases in each cell: of repeated seeds, the worst."""
        grid = np.full((self.ys.size, self.xs.size), np.nan)
        rows, columns = np.searchsorted(self.ys, self.y), np.searchsorted(self.xs, self.x)
        np.fmin.at(grid, (rows[chosen], columns[chosen]), values[chosen])
        return grid


def groups_of(table: Table, drawing: Values) -> Sequence[Any]:
    """Return for each case the panel or line that it belongs to; None without ``per``."""
    if "per" in drawing:
        return column_of(table, drawing["per"])
    return [None] * len(column_of(table, drawing["x"]))
