"""Many runs of one launch file, over the values of its arguments."""

import logging
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError, RunError
from forcebound.extras import check_installed, needed
from forcebound.graph.names import text_of
from forcebound.graph.problems import unknown
from forcebound.graph.tree import Value
from forcebound.haptics.laws import LAWS, BoundingLaw
from forcebound.interface.figures import is_figure, name_of
from forcebound.interface.runs import (
    LaunchFile,
    is_part,
    template_of,
    time_of,
    with_parts,
)
from forcebound.lab.engine import Row, run
from forcebound.lab.sweep.measures import Measures, check_measures
from forcebound.lab.sweep.plan import Sweep, between
from forcebound.lab.sweep.runner import Case, campaign_of, run_case
from forcebound.lab.views import table
from forcebound.lab.workers import cluster_executor, local_executor
from forcebound.run.progress import progress_bar
from forcebound.units import split_quantity, to_si

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEW = 8  # runs, which are done before processes have started
LONGEST = 20  # rows of a table on the screen
SHOWN = ("displayed_stiffness", "true_energy_min", "at_rest")  # figures in it

_logger = logging.getLogger(__name__)


class Runs:
    """The runs of a sweep, as columns: ``runs["delay"]``, ``runs["displayed_stiffness"]``.

    A column has an entry per run, in SI units, NaN where a run does not have the figure. Names are
    those of the arguments that vary, of :class:`~forcebound.interface.figures.Figures`, and of
    the launch file's keys: ``"device.damping"``. With several hands, ``"left.peak_force"`` and
    ``"left.device.damping"``.

    Attributes:
        rows: A mapping for each run, under the keys of a sweep's Parquet file (docs/sweeps.md).
        varied: Names of the arguments that vary.
    """

    def __init__(
        self, rows: Sequence[Row], varied: Sequence[str], units: Mapping[str, str] | None = None
    ) -> None:
        self.rows = rows
        self.varied = tuple(varied)
        self._units = units or {}  # of the varied arguments, as they were written
        keys = dict.fromkeys(key for row in rows for key in row)
        figures = {name_of(key): key for key in keys if is_figure(key)}
        self._keys = {key: key for key in keys} | figures
        self._keys |= {name: f"over.{name}" for name in varied}

    @classmethod
    def read(cls, result: str | Path) -> "Runs":
        """Return the runs of a result file, of :func:`sweep` or ``forcebound sweep``.

        Raises:
            ConfigError: If it is no such file.
        """
        from forcebound.lab.table import read_table

        table = read_table(Path(result))
        columns = {name: table.columns[name] for name in table.columns}
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        varied = [name.removeprefix("over.") for name in columns if name.startswith("over.")]
        return cls(rows, varied, table.about.get("units"))

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column; KeyError if there is none of this name.

        Of lists it has shape (runs, length) if all are of one length; else each entry is an array.
        """
        if name not in self._keys:
            raise KeyError(unknown("column", name, self._keys))
        values = [row.get(self._keys[name]) for row in self.rows]
        if any(isinstance(value, str) for value in values):
            return np.array(values, dtype=object)
        lengths = {len(value) for value in values if isinstance(value, list)}
        if lengths:
            missing = [math.nan] * (lengths.pop() if len(lengths) == 1 else 0)
            lists = [np.array(missing if value is None else value, float) for value in values]
            if len({one.size for one in lists}) == 1:
                return np.array(lists)
            return np.fromiter(lists, object, len(lists))
        return np.array([math.nan if value is None else value for value in values], dtype=float)

    def where(self, **values: Any) -> "Runs":
        """Return the runs whose arguments have these values: ``runs.where(law="certified")``."""
        chosen = list(self.rows)
        for name, value in values.items():
            if name not in self.varied:
                raise KeyError(unknown("varied argument", name, self.varied))
            text = _shown(value)
            known = dict.fromkeys(row[f"over.{name}"] for row in self.rows)
            if text not in known:
                values_known = ", ".join(map(_text, known))
                raise KeyError(f"no run has {name} = {_text(text)}; there are {values_known}")
            chosen = [row for row in chosen if row[f"over.{name}"] == text]
        return Runs(chosen, self.varied, self._units)

    @property
    def errors(self) -> list[str]:
        """Why runs failed; their figures are NaN."""
        return [row["error"] for row in self.rows if row["error"] is not None]

    def plot(
        self,
        value: str,
        x: str | None = None,
        y: str | None = None,
        per: str | None = None,
        output: str | Path | None = None,
        scale: str = "linear",
        leaks: str | None = None,
    ) -> "Figure":
        """Draw a column over varied arguments, as ``forcebound map`` does.

        Args:
            value: A figure or a measure, of one number for each run.
            x: Varied argument; default: the last one that is a number, and for y the one before.
            y: Varied argument: a map; None: curves over ``x``.
            per: Has a panel of the map, or a curve, for each of its values; default: the first
                argument that is text.
            output: Picture to write, ``.png`` or ``.svg``.
            scale: Of the value; ``"log"``: logarithmic.
            leaks: Figure of an energy; where it is below zero, a cell of a map is red.

        Returns:
            The figure, in a notebook the cell shows it; pyplot has it elsewhere.

        Raises:
            ConfigError: If there is no such column, or it is not of numbers.
        """
        check_installed("a map", "matplotlib")
        from matplotlib import get_backend, pyplot

        from forcebound.lab.sweep.maps import figure_of
        from forcebound.lab.table import Table
        from forcebound.results.plots import save

        keys = dict.fromkeys(key for row in self.rows for key in row)
        columns = {key: [row.get(key) for row in self.rows] for key in keys}
        table = Table(columns, {"units": self._units})
        shown = {"value": value, "x": x, "y": y, "per": per, "scale": scale, "leaks": leaks}
        figure = figure_of(table, pyplot.figure, **shown)
        if "inline" in get_backend():  # which shows all that pyplot has, and again the result
            pyplot.close(figure)
        if output is not None:
            save(figure, output)
        return figure

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame of the varied arguments and all figures; needs pandas."""
        parameters = (key for key in self._keys if not is_figure(self._keys[key]))
        own = ("case", "engine", "error", *parameters)
        names = [name for name in self._keys if name not in own and name_of(name) == name]
        return needed("to_pandas", "pandas").DataFrame({name: self[name] for name in names})

    def __repr__(self) -> str:
        shown = [name for name in (*self.varied, *SHOWN) if name in self._keys]
        columns = [[_text(value) for value in self[name]] for name in shown]
        lines = table(shown, list(zip(*columns, strict=True))[:LONGEST])
        more = len(self) - LONGEST
        return "\n".join([*lines, *([f"... and {more} more"] if more > 0 else [])])


def sweep(
    launch: LaunchFile,
    *,
    measures: Measures | None = None,
    result: str | Path | None = None,
    duration: float | str | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    restart: bool = False,
    overwrite: bool = False,
    **arguments: Any,
) -> Runs:
    """Run a launch file in virtual time for each combination of values of its arguments.

    Args:
        launch: Launch file; see :func:`forcebound.simulate`.
        measures: Columns of your own: functions that take a finished :class:`Run` and return a
            number, a bool, text, a list of numbers, or None, by name.
        result: Parquet file to write. Interrupted, the same call goes on where it was; done, it
            reads the file. A changed function is another sweep.
        duration: Of each run, in s or with its unit; default: that of the launch file.
        workers: Processes; 0: this one; default: one per core.
        cluster: Address of the scheduler of a dask cluster to run on, ``tcp://127.0.0.1:8786``.
        restart: Discard what an earlier call left of ``result``.
        overwrite: Replace a ``result`` of another sweep.
        arguments: As of :func:`forcebound.simulate`; a list, tuple or array of values varies.

    Returns:
        The runs; the last argument varies fastest. A run that fails has an error, and no figures;
        one in which a measure raises has an error, and its other columns.

    Raises:
        ConfigError: If the launch file or a name is wrong, or if a value or measure of the first
            run is; or if ``result`` is another sweep's.
        RunError: If every run fails, or the processes end before the work is done.
    """
    measures = measures or {}
    template = template_of(launch)
    known = template.entries["arguments"].entries if "arguments" in template.entries else {}
    check_measures(measures, [*arguments, *known])
    sweeps, cases = _cases(template, duration, arguments)
    drawing = {"value": next(iter(measures), "displayed_stiffness_n_per_m")}
    campaign = campaign_of(sweeps, cases, measures, drawing)
    _try_first(sweeps[0], cases[0][1], measures)
    count = 0 if len(cases) < FEW or len(os.sched_getaffinity(0)) == 1 else workers
    executors = cluster_executor(cluster) if cluster else local_executor(count)
    path = Path(result) if result else None
    with progress_bar("runs", after=1.0) as progress, executors as executor:
        try:
            rows = run(campaign, executor, progress, path, restart, overwrite).rows
        except KeyboardInterrupt as error:
            error.add_note(f"The same call goes on from the parts in {path}.parts." if path else "")
            raise
    varied = [name for name, value in arguments.items() if _is_list(value)]
    runs = Runs(rows, varied, campaign.about["units"])
    if len(runs.errors) == len(runs):
        raise RunError(f"every run failed; the first: {runs.errors[0]}")
    if runs.errors:
        _logger.warning("%d of %d runs failed: %s", len(runs.errors), len(runs), runs.errors[0])
    return runs


def _cases(
    template: Value, duration: float | str | None, arguments: Mapping[str, Any]
) -> tuple[list[Sweep], list[Case]]:
    """Return a sweep for each choice of parts that were made in Python, and the cases of all."""
    varied = {name: _values(name, value) for name, value in arguments.items() if _is_list(value)}
    fixed = {name: value for name, value in arguments.items() if name not in varied}
    seconds = None if duration is None else time_of("duration", duration)
    files: dict[tuple[int, ...], Sweep] = {}  # by the parts in them
    cases: list[Case] = []
    for values in product(*varied.values()):
        chosen = dict(zip(varied, values, strict=True))
        parts = {name: one for name, one in (fixed | chosen).items() if is_part(one)}
        key = tuple(map(id, parts.values()))
        if key not in files:
            made = with_parts(template, parts)  # a part has a name from now on
            constants = {name: text_of(one) for name, one in fixed.items() if name not in parts}
            columns = tuple(name for name in varied if name not in parts)
            same = {f"over.{name}": _shown(parts[name]) for name in parts if name in varied}
            files[key] = Sweep(made, seconds, constants, columns, (), same=same)
        texts = tuple(text_of(chosen[name]) for name in files[key].columns)
        cases.append((list(files).index(key), texts))
    return [*files.values()], cases


def _try_first(sweep: Sweep, values: Sequence[str], measures: Measures) -> None:
    """Raise if a name is wrong, or if a measure of the first run returns what no column can be."""
    sweep.graph(values)
    if measures:
        row = run_case(sweep, 0, values, measures, is_trial=True)
        if row["error"] is not None:
            _logger.warning("the first run failed: %s", row["error"])


def linspace(first: float | str, last: float | str, count: int) -> list[str]:
    """Return evenly spaced values, both ends included, with their unit: ``"0 ms"`` to ``"10 ms"``.

    Raises:
        ConfigError: If the ends have different units, or there are fewer than two values.
    """
    return _spaced("linspace", first, last, count)


def geomspace(first: float | str, last: float | str, count: int) -> list[str]:
    """Return values with even ratios, both ends included: ``"1 N/mm"`` to ``"30 N/mm"``.

    Raises:
        ConfigError: As :func:`linspace`; or if an end is not above 0.
    """
    return _spaced("geomspace", first, last, count)


def _spaced(name: str, first: float | str, last: float | str, count: int) -> list[str]:
    (low, unit), (high, other) = split_quantity(str(first)), split_quantity(str(last))
    is_log = name == "geomspace"
    if unit != other:
        raise ConfigError(f"{name}: both ends must have one unit, got {unit!r} and {other!r}")
    if is_log and not (low > 0.0 and high > 0.0):
        raise ConfigError(f"{name}: both ends must be above 0, got {first} and {last}")
    if count < 2:
        raise ConfigError(f"{name}: count must be at least 2, got {count}")
    values = (between(low, high, n / (count - 1), is_log) for n in range(count))
    return [f"{value!r} {unit}".strip() for value in values]


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple | range | np.ndarray)


def _values(name: str, value: Any) -> list[Any]:
    values = list(value)
    if not values:
        raise ConfigError(f"{name}: an empty list leaves no run")
    return values


def _shown(value: Any) -> Any:
    """Return the value of an argument as a column has it: in SI, text, or the words of a part."""
    if isinstance(value, BoundingLaw):
        return LAWS.kind_of(value)
    if is_part(value):
        return repr(value)
    text = text_of(value)
    in_si = to_si(text)
    return text if in_si is None else in_si


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
