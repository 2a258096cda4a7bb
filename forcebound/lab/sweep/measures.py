"""Measures: figures of a user's own, functions of a finished run."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias

import numpy as np

from forcebound.errors import ConfigError, RunError
from forcebound.interface.figures import name_of
from forcebound.interface.runs import Run
from forcebound.results.figures import FIGURES

Measures: TypeAlias = Mapping[str, Callable[[Run], Any]]

#: Columns of every result.
_COLUMNS = ("case", "engine", "error", "seed", "duration", "failed", "interrupted")


def check_measures(measures: Measures, arguments: Iterable[str]) -> None:
    """Raise ConfigError for a measure that is no function, or has the name of another column."""
    keys = [figure.key for figure in FIGURES]
    taken = {*arguments, *_COLUMNS, *keys, *map(name_of, keys)}
    for name, measure in measures.items():
        if not callable(measure):
            raise ConfigError(f"measures: {name!r} must be a function of a run, got {measure!r}")
        if name in taken or not name.isidentifier():
            words = "is the name of an argument or figure" if name in taken else "is no plain name"
            raise ConfigError(f"measures: {name!r} {words}; choose another one")


def value_of(name: str, measure: Callable[[Run], Any], run: Run) -> Any:
    """Return the value of a measure for a run: a number, bool, text, list of numbers, or None.

    Raises:
        RunError: If it raises.
        ConfigError: If it returns something else.
    """
    try:
        value = measure(run)
    except Exception as error:  # the user's code
        raise RunError(f"measure {name!r}: {type(error).__name__}: {error}") from error
    if value is None or isinstance(value, str):
        return value
    try:
        array = np.array(value)
    except ValueError:  # lists of several lengths
        array = np.array(None)
    if array.ndim > 1 or array.dtype.kind not in "biuf":
        expected = "a number, a bool, text or a list of numbers"
        got = f"an array of shape {array.shape}" if array.ndim > 1 else f"{value!r:.100}"
        raise ConfigError(f"measure {name!r} must return {expected}, got {got}")
    return array.tolist()
