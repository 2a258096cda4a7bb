"""Benchmarks: ``python -m benchmarks [NAME]... [--duration S] [--json] [--page FILE]``.

Without a name, all that are possible here. To add one, write a module with ``DURATION``, in s, and
``run(duration, rate)``, which returns its contestants and figures, and add its name.
"""

import importlib
import inspect
import json
import re
import sys
from pathlib import Path
from typing import Any

import click

from benchmarks.harness import Figure, Measured, Result, conditions
from forcebound.results.printing import print_rows

NAMES = (
    "servo",
    "loop",
    "device",
    "delay",
    "virtual",
    "sweep",
    "bodies",
    "touch",
    "codec",
    "start",
    "guardian",
    "onlookers",
)
SLOW = ("start", "guardian", "onlookers")  # those that start graphs
MEASURED = ("measured", "p50", "p99", "p99.9", "max", "count", "missed", "processor")
FIGURES = ("figure", "here", "round by round", "target", "reached")
HEAD = """# Figures of one machine

`make bench` makes this page, in {minutes:.0f} minutes here; `python -m benchmarks NAME` repeats one
section. Figures are those of one machine and moment. Each contestant ran in turns with its
reference, so ratios count, not times; if *round by round* (lowest and highest ratio of neighbouring
rounds) is wide, or the load was not near 0, the machine was busy. Percentiles are measured values
(nearest rank). *Processor* is the share of one core that a contestant used.
{warning}
| | |
|---|---|
"""
BUSY = 0.5  # load average before the first benchmark, from which on a missed target says nothing
WARNING = """
**The machine was busy: the load was {load:.2f} before the first benchmark.** Other programs may
have made figures worse, so a target that was not reached is marked *busy*, not *no*.
"""


def text(value: float | None, unit: str) -> str:
    """Return a value as it is shown."""
    if value is None:
        return ""
    if unit == "us":
        return duration_text(1e3 * value)
    if unit == "%":
        return f"{value:.1%}"
    return f"{value:.0f} {unit}" if unit == "ticks" else f"{value:.3g} {unit}".strip()


def duration_text(time_ns: float) -> str:
    """Return a time with a suitable unit."""
    for factor, unit in ((1e9, "s"), (1e6, "ms")):
        if time_ns >= factor:
            return f"{time_ns / factor:.3g} {unit}"
    return f"{time_ns / 1e3:.3g} us"


def measured_row(one: Measured) -> tuple[str, ...]:
    """Return the cells of a contestant, under ``MEASURED``."""
    times = [duration_text(one.at(share)) for share in ("p50", "p99", "p99_9", "max")]
    count = sum(len(each.times_ns) for each in one.rounds)
    return (one.label, *times, str(count), str(one.missed), text(one.processor_share, "%"))


def figure_row(one: Figure, is_busy: bool = False) -> tuple[str, ...]:
    """Return the cells of a figure, under ``FIGURES``; of a busy machine, none is called missed."""
    spread = ""
    if one.lowest is not None:
        spread = f"{text(one.lowest, one.unit)} to {text(one.highest, one.unit)}"
    side = "at least" if one.at_least else "at most"
    target = "" if one.target is None else f"{side} {text(one.target, one.unit)}"
    reached = {None: "", True: "yes", False: "busy" if is_busy else "no"}[one.reached]
    return (one.what, text(one.value, one.unit), spread, target, reached)


def as_document(result: Result) -> dict[str, Any]:
    """Return figures and contestants, fit for JSON."""
    contestants, figures = result
    measured = [dict(zip(MEASURED, measured_row(one), strict=True)) for one in contestants]
    return {
        "figures": [one._asdict() | {"reached": one.reached} for one in figures],
        "measured": measured,
    }


def reason(error: Exception) -> str:
    """Return why a benchmark did not run, in one line, without paths of this machine."""
    first = re.sub(r"(?<![\w.])/[^\s'\",;:]+", "(a path)", str(error)).partition("\n")[0]
    return f"{type(error).__name__}: {first.rstrip('.')}."


def section(name: str, result: Result, is_busy: bool = False) -> str:
    """Return the part of the page about one benchmark."""
    about = inspect.getdoc(importlib.import_module(f"benchmarks.{name}")) or ""
    contestants, figures = result
    rows_of_figures = [figure_row(one, is_busy) for one in figures]
    tables = (FIGURES, rows_of_figures), (MEASURED, map(measured_row, contestants))
    lines = [f"\n## {name}\n", about]
    for head, rows in tables:
        lines += ["", *(f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *rows))]
    return "\n".join(lines)


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--duration", type=float, help="Of all contestants together, in s, without starts.")
@click.option("--rate", default=1000.0, show_default=True, help="Ticks a second, in Hz.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
@click.option("--page", type=click.Path(path_type=Path), help="Write the page of all figures.")
def main(
    names: tuple[str, ...], duration: float | None, rate: float, as_json: bool, page: Path | None
) -> None:
    """Run benchmarks, by NAME or all, and show their figures."""
    import time

    if unknown := set(names) - set(NAMES):
        raise click.UsageError(f"no benchmark {', '.join(unknown)}; known: {', '.join(NAMES)}")
    before, began = conditions(), time.monotonic()
    load = float(before["load average"])
    parts, documents = [], {}
    for name in names or NAMES:
        try:
            module = importlib.import_module(f"benchmarks.{name}")
            result: Result = module.run(duration or module.DURATION, rate)
        except Exception as error:  # the other figures are not lost by it
            if names:
                raise
            parts.append(f"\n## {name}\n\nNot run here: {reason(error)}")
            continue
        documents[name] = as_document(result)
        parts.append(section(name, result, load > BUSY))
        if not as_json:
            print_rows(FIGURES, [figure_row(one) for one in result[1]], name)
            print_rows(MEASURED, [measured_row(one) for one in result[0]])
    minutes = (time.monotonic() - began) / 60.0
    if as_json:
        click.echo(json.dumps({"conditions": before, "benchmarks": documents}, indent=2))
    if page is not None:
        table = "".join(f"| {key} | {value} |\n" for key, value in before.items())
        warning = WARNING.format(load=load) if load > BUSY else ""
        head = HEAD.format(minutes=minutes, warning=warning)
        page.write_text(head + table + "\n".join(parts) + "\n")


if __name__ == "__main__":
    sys.exit(main())
