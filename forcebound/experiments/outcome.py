"""The outcome of an experiment: numbers beside the paper's, a figure, and what was run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Number:
    """One number, beside the paper's where the paper prints one."""

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
        title: What is shown.
        paper: What the paper shows or says.
        finding: What came out here, in words.
        numbers: The numbers, in the order to read them.
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
