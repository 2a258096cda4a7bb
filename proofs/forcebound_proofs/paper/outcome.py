"""Outcome of an experiment: numbers with the paper's, a figure, the commands of its runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure


@dataclass(frozen=True)
class Number:
    """One number, with the paper's if it prints one; ``law`` is empty if it is not of one law.

    Of many trials it is the median, and ``spread`` is 10 and 90 %.
    """

    quantity: str
    unit: str
    ours: float | None
    paper: float | None = None
    law: str = ""
    spread: tuple[float, float] | None = None


def by_law(quantity: str, unit: str, values: Mapping[str, float | None]) -> list[Number]:
    """Return one number for each law, none of which the paper prints."""
    return [Number(quantity, unit, value, None, law) for law, value in values.items()]


@dataclass(frozen=True)
class Outcome:
    """The result of one experiment: what the paper has, what this reproduction found.

    ``commands`` repeat its runs one by one; ``document`` has further keys of the JSON document.
    """

    title: str
    paper: str
    finding: str
    numbers: Sequence[Number]
    drawing: Figure
    commands: Sequence[str] = ()
    document: Mapping[str, object] = field(default_factory=dict)
