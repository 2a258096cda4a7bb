"""What an examination of a graph or a machine finds."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

Severity: TypeAlias = Literal["problem", "note", "fine"]


@dataclass(frozen=True)
class Finding:
    """Something that is worth saying about a graph or a machine.

    Attributes:
        severity: ``"problem"``, something does not work as it should; ``"note"``, it is good to
            know; ``"fine"``, of a machine: as it should be.
        kind: What it is, in one word, for programs.
        where: Node, link or thing.
        seen: What was seen, with units.
        advice: What to do; empty if there is nothing to do.
    """

    severity: Severity
    kind: str
    where: str
    seen: str
    advice: str = ""
