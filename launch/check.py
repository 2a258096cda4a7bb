"""Whether an environment keeps its contract: what ``forcebound check environment`` tells."""

import dataclasses
import math
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from forcebound.environments import Environment
from forcebound.environments.contract import PROMISES, Report, check
from forcebound.errors import ConfigError
from forcebound.launch.config import member_document
from forcebound.launch.loader import member_of
from forcebound.messages.packets import MAX_AXES
from forcebound.quantities import parse_quantity

PROBES = (-0.010, 0.0, 0.005, 0.010, 0.011, 0.015, 0.020, 0.050)  # m, where rest is shown
CALLS = 300  # that are timed


@dataclass(frozen=True)
class Checked:
    """What was found.

    Attributes:
        member: Kind and parameters of the environment.
        report: Of the contract.
        at_rest: Position on the first axis, in m, and force there at rest, in N; None where the
            environment gave none.
        median_call: Time for one answer, in s; None if it gives none.
        longest_call: The longest of ``CALLS``, in s.
    """

    member: dict[str, Any]
    report: Report
    at_rest: tuple[tuple[float, float | None], ...]
    median_call: float | None
    longest_call: float | None

    @property
    def passed(self) -> bool:
        """Whether every promise was kept."""
        return not self.report.violations

    @property
    def document(self) -> dict[str, Any]:
        """Everything, in plain JSON types."""
        return {
            "environment": self.member,
            "passed": self.passed,
            "questions": self.report.questions,
            "promises": self.report.held,
            "violations": [dataclasses.asdict(v) for v in self.report.violations],
            "at_rest": [{"position_m": p, "force_n": f} for p, f in self.at_rest],
            "seconds_per_answer": {"median": self.median_call, "max": self.longest_call},
        }

    def lines(self) -> list[str]:
        """Return it as text for a person."""
        lines = []
        for promise, held in self.report.held.items():
            lines.append(f"{'kept  ' if held else 'BROKEN'}  {promise:<8} {PROMISES[promise]}")
            for violation in self.report.violations:
                if violation.promise == promise:
                    lines.append(f"          {violation.where}")
                    lines.append(f"            expected {violation.expected}")
                    lines.append(f"            got      {violation.got}")
        shown = ", ".join(
            f"{p * 1e3:g} mm: {'no answer' if f is None else f'{f:.4g} N'}" for p, f in self.at_rest
        )
        lines.append(f"at rest, on the first axis: {shown}")
        if self.median_call is not None and self.longest_call is not None:
            lines.append(
                f"one answer takes {self.median_call * 1e6:.1f} us (longest of {CALLS}:"
                f" {self.longest_call * 1e6:.0f} us); at 1 kHz a tick has 1000 us"
            )
        return lines


def check_environment(
    kind: str, arguments: Sequence[str] = (), axes: Sequence[int] = (), rest: Sequence[str] = ()
) -> Checked:
    """Return what the contract test finds of an environment.

    Args:
        kind: ``FILE.py``, ``FILE.py:CLASS`` or a kind that comes with the package.
        arguments: Its parameters, each ``name:=value``.
        axes: Numbers of axes to ask with; none: 1 to 6.
        rest: Forces expected at rest, each ``POSITION=FORCE``.

    Raises:
        ConfigError: If there is no such environment, or a parameter is wrong.
    """
    environment: Environment = member_of("environment", kind, arguments)
    expected = dict(_expected(text) for text in rest)
    report = check(environment, axes or range(1, MAX_AXES + 1), expected)
    one = min(axes, default=1)
    median, longest = _times(environment, one)
    return Checked(
        member_document("environment", environment),
        report,
        tuple((position, _at_rest(environment, position, one)) for position in PROBES),
        median,
        longest,
    )


def _expected(text: str) -> tuple[float, float]:
    position, separator, force = text.partition("=")
    try:
        if separator:
            return parse_quantity(position, "m"), parse_quantity(force, "N")
    except ConfigError as error:
        raise ConfigError(f"--rest {text}: {error}") from None
    raise ConfigError(f"--rest {text}: expected POSITION=FORCE, such as 0mm=0N")


def _at_rest(environment: Environment, position: float, axes: int) -> float | None:
    still = (0.0,) * axes
    try:
        force = float(environment.force((position, *still[1:]), still, 1.0)[0])
    except Exception:  # the contract tells it
        return None
    return force if math.isfinite(force) else None


def _times(environment: Environment, axes: int) -> tuple[float | None, float | None]:
    """Median and longest time for an answer, in s, at positions where something may be felt."""
    times = []
    for call in range(CALLS):
        position = (0.05 * call / CALLS,) + (0.0,) * (axes - 1)
        began = time.perf_counter()
        try:
            environment.force(position, (0.1,) * axes, 1.0)
        except Exception:  # the contract tells it
            return None, None
        times.append(time.perf_counter() - began)
    return statistics.median(times), max(times)
