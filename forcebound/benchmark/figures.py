"""Figures of measured times: percentiles, and ratios of two contestants."""

import math
from collections.abc import Sequence
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
    """What one contestant did in all its rounds.

    Attributes:
        label: Who it is, for people.
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
        """Take in one round."""
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
        together = [time_ns for times_ns in self.rounds for time_ns in times_ns]
        return percentile(sorted(together), SHARES[name])

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
    """Return how a percentile of ours compares with that of the limit in the same run.

    Args:
        ours: The contestant.
        limit: What it is measured against; as many rounds, run in turns.
        name: A key of ``SHARES``.
        target: Largest ratio that is good enough; None: only for information.

    Returns:
        ``what``, ``value`` (the ratio over all rounds), ``unit``, ``lowest`` and ``highest`` (the
        ratio of a round to the neighbouring round of the limit), ``target`` and ``reached``.
    """

    def ratio(mine: float, other: float) -> float:
        return max(mine, 1) / max(other, 1)  # a clock that did not move counts as 1 ns

    share = SHARES[name]
    neighbours = [
        ratio(percentile(sorted(mine), share), percentile(sorted(other), share))
        for mine, other in zip(ours.rounds, limit.rounds, strict=True)
        if mine and other
    ]
    value = ratio(ours.at(name), limit.at(name))
    return {
        "what": f"{ours.label} / {limit.label}, {name.replace('_', '.')}",
        "value": value,
        "unit": "ratio",
        "lowest": min(neighbours),
        "highest": max(neighbours),
        **_verdict(value, target),
    }


def beyond(ours: Measured, own: Measured, name: str, target_us: float | None) -> dict[str, Any]:
    """Return how far a percentile of ours lies above the median of what there is anyway.

    Args:
        ours: The contestant.
        own: What takes its time without anything injected; as many rounds, run in turns.
        name: A key of ``SHARES``.
        target_us: Largest difference that is good enough, in us; None: only for information.

    Returns:
        As :func:`compare`, differences in us instead of ratios.
    """

    def difference(mine: Sequence[int], other: Sequence[int]) -> float:
        return (percentile(sorted(mine), SHARES[name]) - percentile(sorted(other), 0.5)) / 1e3

    neighbours = [
        difference(mine, other)
        for mine, other in zip(ours.rounds, own.rounds, strict=True)
        if mine and other
    ]
    value = (ours.at(name) - own.at("p50")) / 1e3
    return {
        "what": f"{ours.label}, {name.replace('_', '.')} beyond {own.label}",
        "value": value,
        "unit": "us",
        "lowest": min(neighbours),
        "highest": max(neighbours),
        **_verdict(value, target_us),
    }


def judge(what: str, value: float, unit: str, target: float | None) -> dict[str, Any]:
    """Return a figure with its target, in the form of :func:`compare`."""
    return {"what": what, "value": value, "unit": unit, **_verdict(value, target)}


def judge_speed(what: str, value: float, unit: str, target: float | None) -> dict[str, Any]:
    """Return a figure of which more is better, in the form of :func:`compare`."""
    reached = None if target is None else value >= target
    verdict = {"target": target, "reached": reached, "at_least": True}
    return {"what": what, "value": value, "unit": unit, **verdict}


def _verdict(value: float, target: float | None) -> dict[str, Any]:
    return {"target": target, "reached": None if target is None else value <= target}


def plan(duration: float, contestants: int, rate: float) -> tuple[int, int]:
    """Share ``duration`` out: return the number of rounds and the ticks of a contestant in each.

    A round is a second or a little more; short runs have one round. Never fewer than 20 ticks.

    Args:
        duration: Time for all contestants together, in s.
        contestants: How many take turns.
        rate: Ticks a second, in Hz.
    """
    each = duration / contestants
    rounds = max(1, int(each))
    return rounds, max(20, round(each / rounds * rate))
