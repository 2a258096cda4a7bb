"""Benchmarks: ``python -m benchmarks [NAME]... [--duration S] [--json] [--page FILE]``.

Without a name, all that are possible here. To add one, write a module with ``ASKED``, its row on
the page, ``DURATION``, in s, and ``run(duration, rate)``, which returns its contestants and
figures, and add its name. Exit status: 0; 1, a target was missed; 2, the numbers do not count, as a
benchmark failed or the machine was not steady. Then no page is written.
"""

import importlib
import json
import re
import sys
from pathlib import Path

import click

from benchmarks.harness import Figure, Measured, Result, conditions
from benchmarks.page import (
    document,
    duration_text,
    missed_targets,
    refusal,
    target,
    text,
    write,
)
from forcebound.results.printing import print_rows

NAMES = (
    "servo",
    "loop",
    "device",
    "inverse3",
    "delay",
    "virtual",
    "sweep",
    "bodies",
    "gymnasium",
    "touch",
    "codec",
    "start",
    "guardian",
    "observers",
)
SLOW = ("start", "guardian", "observers")  # those that start graphs
MEASURED = ("measured", "p50", "p99", "p99.9", "max", "count", "missed", "processor")
FIGURES = ("figure", "here", "round by round", "target")


def measured_row(one: Measured) -> tuple[str, ...]:
    """Return the cells of a contestant, under ``MEASURED``."""
    times = [duration_text(one.at(share)) for share in ("p50", "p99", "p99_9", "max")]
    count = sum(len(each.times_ns) for each in one.rounds)
    return (one.label, *times, str(count), str(one.missed), text(one.processor_share, "%"))


def figure_row(one: Figure) -> tuple[str, ...]:
    """Return the cells of a figure, under ``FIGURES``."""
    spread = ""
    if one.lowest is not None:
        spread = f"{text(one.lowest, one.unit)} to {text(one.highest, one.unit)}"
    return (one.what, text(one.value, one.unit), spread, target(one))


def reason(error: Exception) -> str:
    """Return why a benchmark failed, in one line, without paths of this machine."""
    first = re.sub(r"(?<![\w.])/[^\s'\",;:]+", "(a path)", str(error)).partition("\n")[0]
    return f"{type(error).__name__}: {first.rstrip('.')}."


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--duration", type=float, help="Of all contestants together, in s, without starts.")
@click.option("--rate", default=1000.0, show_default=True, help="Ticks a second, in Hz.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
@click.option("--page", type=click.Path(path_type=Path), help="Write the page of all benchmarks.")
def main(
    names: tuple[str, ...], duration: float | None, rate: float, as_json: bool, page: Path | None
) -> None:
    """Run benchmarks, by NAME or all, and show their figures."""
    if unknown := set(names) - set(NAMES):
        raise click.UsageError(f"no benchmark {', '.join(unknown)}; known: {', '.join(NAMES)}")
    if page is not None and names:
        raise click.UsageError("--page FILE takes no NAME: a page is of all benchmarks")
    before = conditions()
    results: dict[str, tuple[str, Result]] = {}
    refused: list[str] = []
    missed: list[str] = []
    for name in names or NAMES:
        try:
            module = importlib.import_module(f"benchmarks.{name}")
            result: Result = module.run(duration or module.DURATION, rate)
        except Exception as error:  # the figures of the others are not lost by it
            refused.append(f"{name}: {reason(error)}")
        else:
            results[name] = (module.ASKED, result)
            refused += filter(None, [refusal(name, result)])
            missed += missed_targets(name, result[1])
            if not as_json:
                print_rows(FIGURES, [figure_row(one) for one in result[1]], name)
                print_rows(MEASURED, [measured_row(one) for one in result[0]])
        if refused and page is not None:
            break  # there will be no page
    if as_json:
        click.echo(json.dumps(document(before, results), indent=2, default=list))
    if page is not None and not refused:
        write(page, before, results)
    for line in refused or missed:
        click.echo(line, err=True)
    sys.exit(2 if refused else bool(missed))


if __name__ == "__main__":
    main()
