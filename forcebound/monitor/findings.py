"""Findings and facts: codes with data, which :mod:`forcebound.monitor.wording` words."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

Severity: TypeAlias = Literal["problem", "note", "fine"]


@dataclass(frozen=True)
class Fact:
    """A likely cause of a finding, or a note on a change.

    Attributes:
        code: Which, a key of ``CAUSES`` or ``NOTES`` of :mod:`forcebound.monitor.wording`.
        data: The values in its text.
    """

    code: str
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Finding:
    """Something noteworthy about a graph or a machine.

    Attributes:
        severity: ``"problem"``, something does not work as it should; ``"note"``, good to know;
            ``"fine"``, of a machine: as it should be.
        kind: What it is, a key of :data:`forcebound.monitor.wording.FINDINGS`.
        where: Node, link or part of the machine.
        data: The values in its text, in SI units; None: not known, or does not apply.
        causes: Likely causes.
    """

    severity: Severity
    kind: str
    where: str
    data: Mapping[str, Any] = field(default_factory=dict)
    causes: tuple[Fact, ...] = ()
