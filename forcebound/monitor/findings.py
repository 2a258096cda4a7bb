"""Findings and facts: codes with data, which :mod:`forcebound.monitor.wording` words."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

# Something does not work as it should; good to know; of a machine, as it should be.
Severity: TypeAlias = Literal["problem", "note", "fine"]


@dataclass(frozen=True)
class Fact:
    """A likely cause of a finding, or a note on a change."""

    code: str  # a key of CAUSES or NOTES
    data: Mapping[str, Any] = field(default_factory=dict)  # the values in its text


@dataclass(frozen=True)
class Finding:
    """Something noteworthy about a graph or a machine."""

    severity: Severity
    kind: str  # a key of FINDINGS
    where: str  # node, link or part of the machine
    data: Mapping[str, Any] = field(default_factory=dict)  # SI units; None: not known
    causes: tuple[Fact, ...] = ()  # likely ones
