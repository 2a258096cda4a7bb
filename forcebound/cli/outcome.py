"""Runs of a graph, and their results in the terminal."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from forcebound.cli.common import print_json, show, slow_bar, status_line
from forcebound.errors import RunError
from forcebound.graph.graph import GraphConfig
from forcebound.messages.topology import HAND
from forcebound.results.coupling import coupling, coupling_lines
from forcebound.results.printing import print_rows
from forcebound.results.tables import phase_rows, summary_table
from forcebound.run.live import run_live
from forcebound.run.results import RunResult


def show_live_run(
    config: GraphConfig,
    duration: float | None,
    record: Path | None,
    as_json: bool,
    shows_all: bool,
    file: str,
    folder: Path = Path(),
) -> None:
    """Run a graph in real time, and show the result; see :func:`report`."""
    with status_line(as_json) as screen:
        results = run_live(config, duration, record, None, file, screen, folder)
        screen.status("computing the figures")
        for result in results.values():
            _ = result.summary
    report(results, record, as_json, shows_all)


def show_virtual_run(
    config: GraphConfig,
    duration: float | None,
    record: Path | None,
    as_json: bool,
    shows_all: bool,
) -> None:
    """Run a graph in virtual time, and show the result; see :func:`report`."""
    from forcebound.run.virtual import run_virtual_hands  # a live run does not need it

    with slow_bar("ms of virtual time", as_json) as tell:
        results = run_virtual_hands(config, duration, record, may_end_early=True, progress=tell)
    speed = next(iter(results.values())).times_real_time
    show(f"virtual time: {speed:.0f} times real time", err=True)
    report(results, record, as_json, shows_all)


def report(
    results: Mapping[str, RunResult], record: Path | None, as_json: bool, shows_all: bool
) -> None:
    """Show the results of a run, by hand; RunError, once they are shown, if the run failed."""
    if any(result.interrupted for result in results.values()):
        show("forcebound: interrupted; result up to here", err=True)
    summaries = {hand: result.summary for hand, result in results.items()}
    together = _coupling(results)
    if as_json:
        print_json(summaries.get(HAND, {"hands": summaries, "coupling": together}))
    else:
        labels = [hand for hand in results if hand]
        lines = list(coupling_lines(together)) if together else []
        show_results(list(results.values()), labels, lines, shows_all=shows_all)
        if record is not None:
            show(f"recording: {record}")
    for hand, result in results.items():
        if result.failed:
            raise RunError(f"{hand}: {result.failed}" if hand else result.failed)


def _coupling(results: Mapping[str, RunResult]) -> dict[str, Any]:
    if len(results) < 2:
        return {}
    return coupling(
        {hand: result.columns for hand, result in results.items()},
        {hand: result.document for hand, result in results.items()},
    )


def show_results(
    results: list[RunResult],
    labels: Sequence[str] = (),
    together: Sequence[str] = (),
    *,
    shows_all: bool,
) -> None:
    """Print the verdict on each run, under its label, and all figures if they are asked for.

    The lines that are of all hands ``together`` follow the verdicts.
    """
    for number, result in enumerate(results):
        if labels:
            show(f"{labels[number]}:")
        for line in result.summary["verdict"]:
            show(f"  {line}" if labels else line)
    for line in together:
        show(line)
    if shows_all:
        click.echo()
        shown = zip(labels or [one.label for one in results], results, strict=True)
        print_rows(*summary_table([(label, one.summary) for label, one in shown]))
        for cause in (cause for one in results for cause in one.summary["little_force"]):
            show(f"little force: {cause['advice']}")
    else:
        show("All figures: --all, or --json.")
    for phases in (one.summary["phases"] for one in results if one.summary["phases"]):
        head, *rows = phase_rows(phases)
        click.echo()
        print_rows(head, rows)
