"""Findings about a graph or a machine: what is seen, where, and what to do about it."""

from dataclasses import dataclass
from functools import partial
from typing import Literal, TypeAlias

from forcebound.results.bounder import Cause

# Something does not work as it should; good to know; of a machine, as it should be.
Severity: TypeAlias = Literal["problem", "note", "fine"]


@dataclass(frozen=True)
class Finding:
    """Something noteworthy about a graph or a machine."""

    severity: Severity
    kind: str
    where: str  # node, link or part of the machine
    seen: str  # in one sentence, with figures
    action: str = ""  # what to do; empty if there is nothing to do, or the command says it
    command: str = ""  # of a shell; capital letters stand for what the user knows
    causes: tuple[Cause, ...] = ()  # likely ones

    @property
    def advice(self) -> str:
        """What to do, the commands included; empty if there is nothing to do."""
        own = Cause(self.kind, self.action, self.command).remedy.removeprefix(": ")
        return "; ".join(filter(None, (own, *(cause.remedy for cause in self.causes))))

    def document(self) -> dict[str, object]:
        """Return the finding for JSON."""
        commands = (self.command, *(cause.command for cause in self.causes))
        return {
            "severity": self.severity,
            "kind": self.kind,
            "where": self.where,
            "seen": self.seen,
            "advice": self.advice,
            "commands": list(filter(None, commands)),
            "causes": [cause.code for cause in self.causes],
        }


problem, note, fine = (partial(Finding, severity) for severity in ("problem", "note", "fine"))
