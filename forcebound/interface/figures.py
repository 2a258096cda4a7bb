"""The figures of a run as floats that know their unit."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from forcebound.graph.problems import unknown
from forcebound.results.cells import Summary
from forcebound.results.figures import FIGURES, IN_MS
from forcebound.results.printing import print_rows
from forcebound.results.tables import summary_table

_BY_KEY = {figure.key: figure for figure in FIGURES}
_LISTS = ("displayed_impedance", "vibration", "stiffness")  # several numbers each
_NUMBERS = [one for one in FIGURES if one.name not in _LISTS and one.unit != IN_MS]


def name_of(key: str) -> str:
    """Return the name of a figure by its key: ``left.peak_force_n`` is ``left.peak_force``."""
    hand, dot, last = key.rpartition(".")
    return f"{hand}{dot}{_BY_KEY[last].name}" if last in _BY_KEY else key


def is_figure(key: str) -> bool:
    """Return whether a key of a row is a figure: ``peak_force_n``, or ``left.peak_force_n``."""
    return "." not in key or key.rpartition(".")[2] in _BY_KEY


class Quantity(float):
    """A float in SI units.

    Attributes:
        unit: SI unit, such as ``"N/m"``; empty for a count or a share.
        label: A few words, as the table of all figures has them.
        reason: Why the figure is missing, which is then NaN; else empty.
    """

    unit: str
    label: str
    reason: str

    def __new__(cls, value: float, unit: str, label: str, reason: str = "") -> "Quantity":
        """Return ``value`` with what is known of it."""
        quantity = super().__new__(cls, value)
        quantity.unit, quantity.label, quantity.reason = unit, label, reason
        return quantity

    def __repr__(self) -> str:
        return f"{float(self):.6g} {self.reason or self.unit}".rstrip()

    def __reduce__(self) -> Any:
        return Quantity, (float(self), self.unit, self.label, self.reason)


class Figures(Mapping[str, Quantity]):
    """The figures of a run by name, ``figures.peak_force`` or ``figures["peak_force"]``.

    A figure that the run does not have is NaN, and its ``reason`` says why. ``docs/results.md`` has
    the meaning of each; ``summary`` also has what is no number, under the keys of ``--json``.
    """

    def __init__(self, summary: Summary, head: str) -> None:
        self.summary = summary
        self._head = head
        self._values: dict[str, Quantity] = {}
        reasons = summary.get("undefined", {})
        for figure in _NUMBERS:
            value = summary.get(figure.key)
            if value is None or isinstance(value, int | float):
                number = math.nan if value is None else float(value)
                label = figure.label or figure.name.replace("_", " ")
                reason = reasons.get(figure.key, "")
                unit = figure.shown_in(summary).si
                self._values[figure.name] = Quantity(number, unit, label, reason)

    def __getattr__(self, name: str) -> Quantity:
        values: dict[str, Quantity] = self.__dict__.get("_values", {})
        if name in values:
            return values[name]
        raise AttributeError(unknown("figure", name, values))

    def __getitem__(self, name: str) -> Quantity:
        if name not in self._values:
            raise KeyError(unknown("figure", name, self._values))
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def table(self) -> None:
        """Print the table of all figures, as ``--all`` does."""
        print_rows(*summary_table([(self._head, self.summary)]))

    def __repr__(self) -> str:
        known = {name: value for name, value in self._values.items() if not math.isnan(value)}
        width = max(map(len, known), default=0)
        return "\n".join(f"{name:{width}}  {value!r}" for name, value in known.items())
