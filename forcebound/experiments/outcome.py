"""Outcome of an experiment: numbers with the paper's, a figure, the commands of its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def label(name: str) -> str:
    """Return the name of an experiment as the paper writes it: ``Fig. 7`` for ``fig7``."""
    if name.startswith("fig"):
        return f"Fig. {name[3:]}"
    return {"table1": "Table 1", "eq41_42": "Eq. 41 and 42"}.get(name, name)


@dataclass(frozen=True)
class Number:
    """One number, with the paper's if it prints one."""

    quantity: str
    unit: str
    ours: float | None
    paper: float | None = None
    law: str = ""  # empty: the number is not of one law

    def to_json(self) -> dict[str, Any]:
        """Return the fields as plain JSON."""
        return {
            "quantity": self.quantity,
            "law": self.law or None,
            "unit": self.unit,
            "paper": self.paper,
            "ours": self.ours,
        }


def by_law(quantity: str, unit: str, values: Mapping[str, float | None]) -> list[Number]:
    """Return one number for each law, none of which the paper prints."""
    return [Number(quantity, unit, value, None, law) for law, value in values.items()]


@dataclass(frozen=True)
class Outcome:
    """The result of one experiment.

    Attributes:
        title: Subject of the figure, without its label.
        paper: Result of the paper.
        finding: Result of this reproduction.
        numbers: The numbers, in reading order.
        drawing: The figure.
        commands: Commands that repeat the runs behind it, one by one.
        document: Further keys of the JSON document at its top level.
    """

    title: str
    paper: str
    finding: str
    numbers: Sequence[Number]
    drawing: Figure
    commands: Sequence[str] = ()
    document: Mapping[str, Any] = field(default_factory=dict)
