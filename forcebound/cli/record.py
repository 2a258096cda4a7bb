"""Recording of a graph that runs already."""

from dataclasses import asdict
from pathlib import Path

import click

from forcebound.cli.common import (
    duration_option_for,
    json_option,
    overwrite_option,
    print_json,
    recording_option,
    reports_errors,
    run_argument,
    show,
)
from forcebound.cli.complete import graphs


@click.command(short_help="Record a running graph from now on.")
@run_argument("graph", graphs)
@overwrite_option
@recording_option(
    "-o", "--output", help="File to write. Default: a new one here, named after graph and time."
)
@duration_option_for("Time after which it ends. Default: with the graph.")
@json_option
@reports_errors
def record(graph: Path | None, output: Path | None, duration: float | None, as_json: bool) -> None:
    r"""Record every packet of a running graph from now on, until Ctrl-C or its end.

    The file is one of `forcebound launch --record`, without what was before. `forcebound plot`,
    export and replay take it; replay --verify begins at a new law.

    \b
    forcebound record
    forcebound record stiff_wall -o run.mcap --duration 10s
    """
    from forcebound.files import check_writable
    from forcebound.launch.run_directory import RunDocument
    from forcebound.monitor.recorder import free_name, record_running
    from forcebound.monitor.runs import find, while_running

    run_dir = find(graph, require_graph=True, option="`forcebound record GRAPH`")

    def begin(name: str) -> None:
        if not as_json:
            show(f"recording {name} to {file}; Ctrl-C ends it")

    with while_running(run_dir):
        file = output or free_name(Path(), RunDocument.read(run_dir).file)
        check_writable(file, "the recording")
        found = record_running(run_dir, file, duration, begin)
    if as_json:
        print_json(asdict(found))
    else:
        show(f"recorded {found.seconds:.1f} s, {found.packets['telemetry']} ticks: {file}")
