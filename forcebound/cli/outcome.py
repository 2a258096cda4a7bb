"""Runs of a graph, and their results in the terminal."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import click

from forcebound.cli.common import print_json, show
from forcebound.cli.lazy import when_used
from forcebound.errors import RunError
from forcebound.folders import cache_folder
from forcebound.results.printing import print_rows

with when_used():
    from forcebound.graph import graph
    from forcebound.messages import events, topology
    from forcebound.results import coupling, tables
    from forcebound.run import fork_server, live, progress, virtual
    from forcebound.run import results as run_results
    from forcebound.run import screen as screens

HINTS = 3  # times that a hint is printed
SLOW = 1.0  # s, after which a command shows its progress


@contextmanager
def status_line(as_json: bool) -> "Iterator[screens.Screen]":
    """A screen that says what a launcher is doing, if somebody looks; empty at the end."""
    screen = screens.Screen(has_status=sys.stderr.isatty() and not as_json)
    try:
        yield screen
    finally:
        screen.status("")


def show_run(
    config: "graph.GraphConfig",
    duration: float | None,
    record: Path | None,
    as_json: bool,
    shows_all: bool,
    command: str | None = None,
    folder: Path = Path(),
    server: "fork_server.ForkServer | None" = None,
) -> None:
    """Run a graph, show its results by hand; RunError, once they are shown, if the run failed.

    It runs in real time if there is the ``command`` of a live run, else in virtual time.
    """
    if command is None:
        results = _run_virtual(config, duration, record, as_json)
    else:
        with status_line(as_json) as screen:
            results = live.run_live(config, duration, record, None, command, screen, folder, server)
            screen.status("computing the figures")
            for result in results.values():
                _ = result.summary
    if any(result.interrupted for result in results.values()):
        show("forcebound: interrupted; result up to here", err=True)
    summaries = {hand: result.summary for hand, result in results.items()}
    columns = {hand: result.columns for hand, result in results.items()}
    documents = {hand: result.document for hand, result in results.items()}
    together = coupling.coupling(columns, documents) if len(results) > 1 else {}
    if as_json:
        print_json(summaries.get(topology.HAND, {"hands": summaries, "coupling": together}))
    else:
        labels = [hand for hand in results if hand != topology.HAND]
        lines = list(coupling.coupling_lines(together)) if together else []
        show_results(list(results.values()), labels, lines, shows_all=shows_all)
        if record is not None:
            show(f"recording: {record}")
    for hand, result in results.items():
        if result.failed:
            raise RunError(f"{hand}: {result.failed}" if hand != topology.HAND else result.failed)


def _run_virtual(
    config: "graph.GraphConfig", duration: float | None, record: Path | None, as_json: bool
) -> "Mapping[str, run_results.RunResult]":
    with progress.progress_bar("ms of virtual time", after=SLOW, shown=not as_json) as bar:
        results = virtual.run_virtual_hands(
            config, duration, record, may_end_early=True, progress=bar
        )
    speed = next(iter(results.values())).times_real_time
    digits = ".0f" if speed >= 10.0 else ".2g"
    show(f"virtual time: {speed:{digits}} times real time", err=True)
    return results


def show_results(
    results: "list[run_results.RunResult]",
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
    kinds = [(one.event, one.data.get("kept")) for result in results[:1] for one in result.events]
    if begun := sum(kind == events.EPISODE_BEGINS for kind, _ in kinds):
        kept = kinds.count((events.EPISODE_ENDS, "true"))
        others = begun - kept - kinds.count((events.EPISODE_ENDS, "false"))
        left_open = ", and one without an end, which is not kept" if others else ""
        show(f"Episodes: {kept} kept of {begun}{left_open}.")
    if shows_all:
        click.echo()
        shown = zip(labels or [one.label for one in results], results, strict=True)
        print_rows(*tables.summary_table([(label, one.summary) for label, one in shown]))
        for cause in (cause for one in results for cause in one.summary["little_force"]):
            show(f"little force: {cause['advice']}")
    else:
        _hint("All figures: --all, or --json.")
    for phases in (one.summary["phases"] for one in results if one.summary["phases"]):
        head, *rows = tables.phase_rows(phases)
        click.echo()
        print_rows(head, rows)


def _hint(words: str) -> None:
    """Print words that a user needs to read a few times only; the cache has how often that was."""
    folder = cache_folder("hints")
    file = None if folder is None else folder / "all_figures"
    with suppress(OSError):  # a cache that cannot be used only means one more line
        if file is not None:
            with file.open("a+b") as seen:
                if seen.tell() >= HINTS:
                    return
                seen.write(b".")
    show(words)
