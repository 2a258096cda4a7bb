"""Benchmarks: each measures its reference in the same run, alternately, and reports the ratio.

On a shared machine absolute times mean nothing, but ratios of neighbouring rounds do. The reference
is the same work in C or in bare pyzmq.

To add a benchmark, write a module with ``run(duration, rate, progress)`` that returns the result of
:func:`forcebound.benchmark.figures.report`, and add one line to ``BENCHMARKS``.
"""

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

Result: TypeAlias = dict[str, Any]
Progress: TypeAlias = Callable[[str], None]


def _no_progress(_: str) -> None:
    pass


@dataclass(frozen=True)
class Benchmark:
    """One benchmark.

    Attributes:
        summary: Its subject, in one line.
        module: Where its ``run`` is; imported when it runs.
        duration: Default time of all contestants together, in s.
    """

    summary: str
    module: str
    duration: float

    def run(
        self, duration: float | None = None, rate: float = 1000.0, progress: Progress = _no_progress
    ) -> Result:
        """Run it and return figures, limits, ratios, targets and conditions; fit for JSON.

        Args:
            duration: Time of all contestants together, without their start, in s.
            rate: Ticks a second, in Hz.
            progress: Called with a line of progress on each measurement.

        Raises:
            RunError: If a contestant could not be run.
        """
        run = importlib.import_module(self.module).run
        result: Result = run(self.duration if duration is None else duration, rate, progress)
        return result


BENCHMARKS: dict[str, Benchmark] = {
    "loop": Benchmark(
        "the four-hop loop of the default launch file against bare pyzmq",
        "forcebound.benchmark.loop",
        30.0,
    ),
    "servo": Benchmark(
        "punctuality and cost of the device's servo against a C loop",
        "forcebound.benchmark.servo",
        30.0,
    ),
    "device": Benchmark(
        "the round trip to a device on a serial port against a bare pyserial loop",
        "forcebound.benchmark.device",
        30.0,
    ),
    "delay": Benchmark(
        "the error of injected delays beyond the link's own latency",
        "forcebound.benchmark.delay",
        36.0,
    ),
    "bodies": Benchmark(
        "an answer of a scene with twenty boxes against a bare step of MuJoCo",
        "forcebound.benchmark.bodies",
        10.0,
    ),
    "touch": Benchmark(
        "closest points and hits on a mesh of 500,000 triangles against libigl",
        "forcebound.benchmark.touch",
        30.0,
    ),
    "sweep": Benchmark(
        "the compiled kernel of sweeps against the same algorithm in C",
        "forcebound.benchmark.sweep",
        20.0,
    ),
    "virtual": Benchmark(
        "virtual time with one and with three axes, in times of real time",
        "forcebound.benchmark.virtual",
        10.0,
    ),
}


@dataclass(frozen=True)
class Table:
    """A table for people: title, column heads, rows of as many cells."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def tables(result: Result) -> list[Table]:
    """Return the result of :meth:`Benchmark.run` as tables for people."""
    return [
        Table(
            f"{result['benchmark']}: measured, in us",
            ("", "p50", "p99", "p99.9", "max", "ticks", "missed", "processor"),
            tuple(_measured(one) for one in result["contestants"].values()),
        ),
        Table(
            f"{result['benchmark']}: against references and targets",
            ("", "here", "round by round", "target", "reached"),
            tuple(_judged(one) for one in result["comparisons"].values()),
        ),
        Table(
            "conditions", ("", ""), tuple((k, _text(v)) for k, v in result["conditions"].items())
        ),
    ]


def _measured(one: Result) -> tuple[str, ...]:
    times = (f"{one[key]:.1f}" for key in ("p50_us", "p99_us", "p99_9_us", "max_us"))
    share = f"{one['processor_share']:.1%}"
    return (one["label"], *times, str(one["count"]), str(one["missed"]), share)


def _judged(one: Result) -> tuple[str, ...]:
    def number(value: float) -> str:
        if one["unit"] == "ticks":
            return f"{value:.0f}"
        return f"{value:.1%}" if one["unit"] == "share" else f"{value:.3g}"

    unit = "us" if one["unit"] == "us" else ""
    spread = f"{number(one['lowest'])} to {number(one['highest'])}" if "lowest" in one else ""
    here = f"{number(one['value'])} {unit}".strip()
    side = "at least" if one.get("at_least") else "at most"
    if one["target"] is None:
        return (one["what"], here, spread, "", "")
    return (
        one["what"],
        here,
        spread,
        f"{side} {number(one['target'])} {unit}".strip(),
        "yes" if one["reached"] else "no",
    )


def _text(value: object) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join([str(entry) for entry in value])
    return str(value)
