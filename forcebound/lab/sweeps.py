"""Many runs of one launch file, over the values of its arguments."""

import copyreg
import dataclasses
import logging
import math
import os
import pickle
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby, product
from operator import itemgetter
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError, RunError
from forcebound.extras import needed
from forcebound.graph.graph import KINDS
from forcebound.graph.loader import build
from forcebound.graph.names import text_of
from forcebound.graph.problems import unknown
from forcebound.haptics.laws import LAWS, BoundingLaw
from forcebound.haptics.parts import Table
from forcebound.interface.figures import is_figure, name_of
from forcebound.interface.runs import (
    LaunchFile,
    is_part,
    template_of,
    time_of,
    with_parts,
)
from forcebound.lab.engine import Campaign, Row, run
from forcebound.lab.sweep.plan import Sweep, between
from forcebound.lab.sweep.runner import run_cases
from forcebound.lab.views import table
from forcebound.lab.workers import local_executor
from forcebound.run.progress import progress_bar
from forcebound.units import split_quantity, to_si

FEW = 8  # runs, which are done before processes have started
PARTS = 8  # of the work of each process, for the progress bar
LONGEST = 20  # rows of a table on the screen
SHOWN = ("displayed_stiffness", "true_energy_min", "at_rest")  # figures in it

_logger = logging.getLogger(__name__)
_TABLES: Mapping[str, Table[Any]] = {**KINDS, "law": LAWS}
_File: TypeAlias = tuple[Sweep, Mapping[str, Any]]  # and the varied parts in it
_Case: TypeAlias = tuple[int, int, tuple[str, ...]]  # index of its file, number, varied texts


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

    def __init__(self, rows: Sequence[Row], varied: Sequence[str]) -> None:
        self.rows = rows
        self.varied = tuple(varied)
        keys = dict.fromkeys(key for row in rows for key in row)
        figures = {name_of(key): key for key in keys if is_figure(key)}
        self._keys = {key: key for key in keys} | figures
        self._keys |= {name: f"over.{name}" for name in varied}

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column; KeyError if there is none of this name."""
        if name not in self._keys:
            raise KeyError(unknown("column", name, self._keys))
        values = [row.get(self._keys[name]) for row in self.rows]
        if any(isinstance(value, str) for value in values):
            return np.array(values, dtype=object)
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
        return Runs(chosen, self.varied)

    @property
    def errors(self) -> list[str]:
        """Why runs failed; their figures are NaN."""
        return [row["error"] for row in self.rows if row["error"] is not None]

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
    duration: float | str | None = None,
    workers: int | None = None,
    **arguments: Any,
) -> Runs:
    """Run a launch file in virtual time for each combination of values of its arguments.

    Args:
        launch: Launch file; see :func:`forcebound.simulate`.
        duration: Of each run, in s or with its unit; default: that of the launch file.
        workers: Processes; 0: this one; default: one per core.
        arguments: As of :func:`forcebound.simulate`; a list, tuple or array of values varies.

    Returns:
        The runs; the last argument varies fastest. A run that fails has an error, and no figures.

    Raises:
        ConfigError: If the launch file or a name is wrong, or if a value of the first run is.
        RunError: If every run fails, or the processes end before the work is done.
    """
    varied = {name: _values(name, value) for name, value in arguments.items() if _is_list(value)}
    fixed = {name: value for name, value in arguments.items() if name not in varied}
    seconds = None
    if duration is not None:
        seconds = time_of("duration", duration)
    template = template_of(launch)
    files: dict[tuple[int, ...], _File] = {}  # by the parts in them
    cases: list[_Case] = []
    for values in product(*varied.values()):
        chosen = dict(zip(varied, values, strict=True))
        parts = {name: one for name, one in (fixed | chosen).items() if is_part(one)}
        key = tuple(map(id, parts.values()))
        if key not in files:
            made = with_parts(template, parts)
            same = {name: text_of(one) for name, one in fixed.items() if name not in parts}
            columns = tuple(name for name in varied if name not in parts)
            shown = {f"over.{name}": _shown(parts[name]) for name in parts if name in varied}
            files[key] = Sweep("sweep", "", made, seconds, same, columns, (), {}), shown
        texts = tuple(text_of(chosen[name]) for name in files[key][0].columns)
        cases.append((list(files).index(key), len(cases), texts))
    first, _ = files[next(iter(files))]
    build(first.template, replace(first, cases=(cases[0][2],)).overrides(0))  # wrong names: at once
    runs = Runs(_run(list(files.values()), cases, workers), tuple(varied))
    if len(runs.errors) == len(runs):
        raise RunError(f"every run failed; the first: {runs.errors[0]}")
    if runs.errors:
        _logger.warning("%d of %d runs failed: %s", len(runs.errors), len(runs), runs.errors[0])
    return runs


def linspace(first: float | str, last: float | str, count: int) -> list[str]:
    """Return evenly spaced values, both ends included, with their unit: ``"0 ms"`` to ``"10 ms"``.

    Raises:
        ConfigError: If the ends have different units, or there are fewer than two values.
    """
    (low, unit), (high, other) = split_quantity(str(first)), split_quantity(str(last))
    if unit != other:
        raise ConfigError(f"linspace: both ends must have one unit, got {unit!r} and {other!r}")
    if count < 2:
        raise ConfigError(f"linspace: count must be at least 2, got {count}")
    values = (between(low, high, n / (count - 1)) for n in range(count))
    return [f"{value!r} {unit}".strip() for value in values]


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple | range | np.ndarray)


def _values(name: str, value: Any) -> list[Any]:
    values = list(value)
    if not values:
        raise ConfigError(f"{name}: an empty list leaves no run")
    return values


def _run(files: Sequence[_File], cases: Sequence[_Case], workers: int | None) -> list[Row]:
    """Run cases in processes, or the few here."""
    cores = len(os.sched_getaffinity(0))
    count = 0 if len(cases) < FEW or cores == 1 else workers
    part = math.ceil(len(cases) / (PARTS * (workers or cores)))
    campaign = Campaign("runs", cases, partial(_run_part, files), part)
    begin = None if count == 0 else partial(_add_parts, _own_parts())
    with (
        progress_bar("runs", after=1.0) as progress,
        local_executor(count, begin, imports_main=False) as executor,
    ):
        return run(campaign, executor, progress).rows


def _run_part(files: Sequence[_File], cases: Sequence[_Case]) -> list[Row]:
    rows: list[Row] = []
    for file, own in groupby(cases, itemgetter(0)):
        sweep, shown = files[file]
        found = run_cases(sweep, [(number, texts) for _, number, texts in own])
        rows += [row | shown for row in found]
    return rows


def _own_parts() -> bytes:
    """Return the parts that were made in this process, for others; empty without any."""
    own = {section: table.added for section, table in _TABLES.items() if table.added}
    if not own:
        return b""
    cloudpickle = needed("a part of your own in other processes", "cloudpickle")

    # Fields of a class know by identity that they have no default.
    copyreg.pickle(type(dataclasses.MISSING), lambda one: (getattr, (dataclasses, "MISSING")))
    try:
        pickled: bytes = cloudpickle.dumps(own)
    except (TypeError, pickle.PicklingError) as error:
        message = f"a part cannot be sent to other processes: {error}; use workers=0"
        raise ConfigError(message) from None
    return pickled


def _add_parts(pickled: bytes) -> None:
    for section, parts in pickle.loads(pickled).items() if pickled else ():
        _TABLES[section].update(parts)


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
