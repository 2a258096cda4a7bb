"""Figures of measured times: percentiles, and ratios of two contestants."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

SHARES = {"p50": 0.5, "p99": 0.99, "p99_9": 0.999, "max": 1.0}


def percentile(ordered: Sequence[int], share: float) -> int:
    """Return the smallest value that at least ``share`` of all values do not exceed.

    Always a measured value (nearest rank), never an interpolated one.

    Args:
        ordered: Values in ascending order, at least one.
        share: 0 to 1.

    Raises:
        ValueError: If there are no values.
    """
    if not ordered:
        raise ValueError("a percentile needs at least one value")
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


@dataclass
class Measured:
    """Times of one contestant in all its rounds.

    Attributes:
        label: Its name in tables.
        rounds: Its times, one list a round, in ns.
        missed: Ticks skipped, or left without an answer in time.
        processor_ns: Processor time used by its process, in ns.
        elapsed_ns: Time that passed meanwhile, in ns.
    """

    label: str
    rounds: list[list[int]] = field(default_factory=list)
    missed: int = 0
    processor_ns: int = 0
    elapsed_ns: int = 0

    def add(self, times_ns: list[int], missed: int, processor_ns: int, elapsed_ns: int) -> None:
        """Add one round."""
        self.rounds.append(times_ns)
        self.missed += missed
        self.processor_ns += processor_ns
        self.elapsed_ns += elapsed_ns

    @property
    def processor_share(self) -> float:
        """Share of one processor that it used, 0 to 1."""
        return self.processor_ns / self.elapsed_ns if self.elapsed_ns else 0.0

    def at(self, name: str) -> float:
        """Return the percentile ``name`` (a key of ``SHARES``) of all rounds together, in ns.

        Raises:
            ValueError: If it has no times.
        """
        return percentile(self.all_times(), SHARES[name])

    def all_times(self) -> list[int]:
        """Return the times of all rounds, in ns, in ascending order."""
        return sorted(time_ns for times_ns in self.rounds for time_ns in times_ns)

    def summary(self) -> dict[str, Any]:
        """Return the figures for a report: percentiles in us, and counts.

        Raises:
            ValueError: If it has no times.
        """
        return {
            "label": self.label,
            **{f"{name}_us": self.at(name) / 1e3 for name in SHARES},
            "count": sum(map(len, self.rounds)),
            "missed": self.missed,
            "processor_share": self.processor_share,
        }


def compare(ours: Measured, limit: Measured, name: str, target: float | None) -> dict[str, Any]:
    """Return how a percentile of ours compares with that of the reference in the same run.

    Args:
        ours: The contestant.
        limit: Its reference; as many rounds, run alternately.
        name: A key of ``SHARES``.
        target: Largest ratio that is good enough; None: only for information.

    Returns:
        ``what``, ``value`` (the ratio over all rounds), ``unit``, ``lowest`` and ``highest`` (the
        ratio of a round to the neighbouring round of the reference), ``target`` and ``reached``.
    """

    def ratio(mine: list[int], other: list[int]) -> float:
        # A clock that did not move counts as 1 ns.
        return max(percentile(mine, SHARES[name]), 1) / max(percentile(other, SHARES[name]), 1)

    what = f"{ours.label} / {limit.label}, {name.replace('_', '.')}"
    return _against(ours, limit, ratio, judged=(what, "ratio", target))


def beyond(ours: Measured, own: Measured, name: str, target_us: float | None) -> dict[str, Any]:
    """Return the difference between a percentile of ours and the median of a baseline.

    Args:
        ours: The contestant.
        own: The baseline, without an injected delay; as many rounds, run alternately.
        name: A key of ``SHARES``.
        target_us: Largest difference that is good enough, in us; None: only for information.

    Returns:
        As :func:`compare`, differences in us instead of ratios.
    """

    def difference(mine: list[int], other: list[int]) -> float:
        return (percentile(mine, SHARES[name]) - percentile(other, 0.5)) / 1e3

    what = f"{ours.label}, {name.replace('_', '.')} beyond {own.label}"
    return _against(ours, own, difference, judged=(what, "us", target_us))


def _against(
    ours: Measured,
    other: Measured,
    relation: Callable[[list[int], list[int]], float],
    judged: tuple[str, str, float | None],
) -> dict[str, Any]:
    """Judge the relation of all times, and add its extremes over the pairs of rounds."""
    pairs = [
        relation(sorted(mine), sorted(theirs))
        for mine, theirs in zip(ours.rounds, other.rounds, strict=True)
        if mine and theirs
    ]
    what, unit, target = judged
    value = relation(ours.all_times(), other.all_times())
    return judge(what, value, unit, target) | {"lowest": min(pairs), "highest": max(pairs)}


def judge(
    what: str, value: float, unit: str, target: float | None, at_least: bool = False
) -> dict[str, Any]:
    """Return a figure with its target, in the form of :func:`compare`.

    With ``at_least`` a larger value is better.
    """
    judged = {"what": what, "value": value, "unit": unit, "target": target, "reached": None}
    if target is not None:
        judged["reached"] = value >= target if at_least else value <= target
    return judged | ({"at_least": True} if at_least else {})


def report(
    benchmark: str,
    duration: float,
    rate: float,
    contestants: Mapping[str, Measured],
    comparisons: Mapping[str, Any],
    conditions: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the result of a benchmark, fit for JSON; ``duration`` in s, ``rate`` in Hz."""
    return {
        "benchmark": benchmark,
        "duration_s": duration,
        "rate_hz": rate,
        "contestants": {name: one.summary() for name, one in contestants.items()},
        "comparisons": dict(comparisons),
        "conditions": dict(conditions),
    }


def plan(duration: float, contestants: int, rate: float) -> tuple[int, int]:
    """Divide ``duration``: return the number of rounds and the ticks of a contestant in each.

    A round is a second or a little more; short runs have one round. Never fewer than 20 ticks.

    Args:
        duration: Time for all contestants together, in s.
        contestants: Their number.
        rate: Ticks a second, in Hz.
    """
    each = duration / contestants
    rounds = max(1, int(each))
    return rounds, max(20, round(each / rounds * rate))
