"""Commands that look at processes: list, doctor."""

import math
import sys
import time
from pathlib import Path

import click

from forcebound.cli import options as opt
from forcebound.cli.common import UNKNOWN, print_json, print_json_line, show
from forcebound.cli.lazy import when_used
from forcebound.files import printable
from forcebound.results.printing import print_rows

with when_used():
    from forcebound.observe import doctor as of_graph
    from forcebound.observe import listing, machine, observation, runs
    from forcebound.observe import measure as servo

HEAD = ("node", "state", "pid", "processor", "memory", "restarts")
MEASURE_S = 12.0  # of all contestants together, without their start
COLOURS = {"problem": "red", "note": "yellow", "fine": "green"}


def list_graphs(
    watch: bool = opt.flag("Repeat each second while a graph runs."),
    run: Path | None = opt.given_run,
    duration: float | None = opt.duration(
        "Time after which --watch ends. Default: with the last graph."
    ),
    as_json: bool = opt.as_json,
) -> None:
    r"""List the running graphs: nodes, states, processor, memory, restarts.

    With --watch and --json, one document per line.

    \b
    forcebound list
    forcebound list --watch --run stiff_wall --duration 10s
    """
    only = None if run is None else runs.find(run)
    if not watch:
        graphs = listing.list_graphs(only=only)
        print_json(graphs) if as_json else _show_graphs(graphs)
        return
    end = math.inf if duration is None else time.monotonic() + duration
    while time.monotonic() < end and (graphs := listing.list_graphs(1.0, only)):
        if as_json:
            print_json_line(graphs)
        else:
            click.clear()  # of a terminal only
            _show_graphs(graphs)


def _show_graphs(graphs: "list[listing.ListedGraph]") -> None:
    if not graphs:
        show("no graph of yours runs on this machine; start one with `forcebound launch FILE`")
    for graph in graphs:
        core = "any core" if graph.core is None else f"core {graph.core}"
        show(f"{graph.name}  ({graph.phase or 'an environment'}, {core}, {graph.run_dir})")
        rows = [
            (
                one.node,
                one.state,
                UNKNOWN if one.pid is None else str(one.pid),
                UNKNOWN if one.processor is None else f"{one.processor:.0%}",
                UNKNOWN if one.memory is None else f"{one.memory / 1e6:.0f} MB",
                str(one.restarts),
            )
            for one in graph.processes
        ]
        print_rows(HEAD, rows)


def doctor(
    measure: bool = opt.flag(f"Also measure this machine: {MEASURE_S:g} s."),
    run: Path | None = opt.given_run,
    as_json: bool = opt.as_json,
) -> None:
    r"""Diagnose the running graph, or this machine if none runs.

    With --measure, also how late wake-ups of a servo are at 1 kHz, and how long the loop of a graph
    takes, beside one of bare sockets; best when nothing else runs.

    Exit status 0: no problem; 1: at least one problem, or the graph ended; 2: no such
    graph.

    \b
    forcebound doctor
    forcebound doctor --measure
    forcebound doctor --run stiff_wall --json
    """
    times = machine.processor_times()
    graph = None if run is None and not runs.running() else runs.find(run)
    findings = machine.examine() if graph is None else of_graph.examine(*observation.observe(graph))
    is_well = all(finding.severity != "problem" for finding in findings)
    measured = _measured() if measure else {}
    time.sleep(machine.STEAL_S)
    findings = [*findings, *machine.steal(times, machine.processor_times())]
    if as_json:
        documents = [finding.document() for finding in findings]
        found = {"graph": graph, "is_well": is_well, "findings": documents}
        print_json(found | ({"measured": measured} if measure else {}))
        sys.exit(0 if is_well else 1)
    show("this machine; no graph runs" if graph is None else f"graph in {graph}")
    for finding in findings:
        label = click.style(f"{finding.severity:<8}", fg=COLOURS[finding.severity])
        click.echo(f"{label} " + printable(f"{finding.where}: {finding.seen}"))
        if finding.advice:
            show(f"{'':8} -> {finding.advice}")
    if is_well:
        show("no problem found")
    if measure:
        head = ("measured at 1 kHz", *next(iter(measured.values())))
        print_rows(head, [(name, *map(str, one.values())) for name, one in measured.items()])
    sys.exit(0 if is_well else 1)


def _measured() -> dict[str, dict[str, float]]:
    """Return what this machine is capable of, by what was measured."""
    return {
        name: {f"{one}_us": round(servo.percentile(rounds, one) / 1e3, 1) for one in servo.SHARES}
        | {"ticks": sum(len(one.times_ns) for one in rounds)}
        | {"missed": sum(one.missed for one in rounds)}
        for name, rounds in servo.measure(MEASURE_S, 1000.0).items()
    }
