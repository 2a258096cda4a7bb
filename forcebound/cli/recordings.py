"""Commands that make a recording of a running graph, or something of one."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NoReturn

import click

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import print_json, show
from forcebound.cli.outcome import show_results, show_run
from forcebound.files import content_of
from forcebound.lab import verification
from forcebound.lab.replay import device_of, duration_of, graph_of
from forcebound.messages.packets import TOPIC_OF, TOPICS, Telemetry
from forcebound.messages.topology import HAND
from forcebound.observe.recorder import free_name, record_running
from forcebound.recordings.export import export as write_tables
from forcebound.recordings.recording import Recording, read
from forcebound.recordings.recovery import recover as write_recovered
from forcebound.results.perception import differences
from forcebound.results.plots import check_picture, figure, save
from forcebound.results.signals import curves_of
from forcebound.results.tables import difference_text
from forcebound.run.results import results_of
from forcebound.stop import Stop

_recorded = opt.running(require_graph=True, named="`forcebound record GRAPH`")
_run = opt.argument(complete.recordings, metavar="RUN.mcap", type=opt.FILE)


def record(
    graph: Path = opt.argument(complete.graphs, required=False, type=opt.PATH, callback=_recorded),
    output: Path | None = opt.recording(
        "File to write. Default: a new one here, named after graph and time.", "-o", "--output"
    ),
    duration: float | None = opt.ending,
    as_json: bool = opt.as_json,
) -> None:
    r"""Record every packet of a running graph, until Ctrl-C or its end.

    The file is one of `forcebound launch --record`, without what was before. `forcebound plot`,
    export and replay take it; replay --verify begins at a new law.

    \b
    forcebound record
    forcebound record stiff_wall -o run.mcap --duration 10s
    """

    def begin(name: str) -> None:
        if not as_json:
            show(f"recording {name} to {file}; Ctrl-C ends it")

    with Stop() as stop:
        file = output or free_name(Path(), graph)
        found = record_running(graph, file, duration, begin, stop)
    print_json(found) if as_json else show(str(found))


def plot(
    runs: tuple[str, ...] = opt.arguments("RUN.mcap...", complete.recordings, required=True),
    output: Path | None = opt.output(
        "Picture file, .png or .svg. Default: name of the first recording, .png."
    ),
    hand: str | None = opt.hand,
    shows_all: bool = opt.shows_all,
    as_json: bool = opt.as_json,
) -> None:
    r"""Draw recordings side by side: position, forces, energy, loop delay.

    Prints the verdict on each, and if a hand feels the difference between the first and each other.
    Several hands of a recording are drawn side by side, too.

    \b
    forcebound plot run.mcap
    forcebound plot none.mcap certified.mcap -o both.svg
    forcebound plot two.mcap --hand left
    """
    output = Path(runs[0]).with_suffix(".png") if output is None else output
    check_picture(output)
    found = [(run, one) for run in runs for one in results_of(Path(run), hand).items()]
    results = [result for _, (_, result) in found]
    labels = [result.label for result in results]
    if len(set(labels)) < len(labels):  # same law: distinguished by file
        labels = [f"{run}: {result.label}" for run, (_, result) in found]
    with content_of(" and ".join(runs)):
        summaries = [result.summary for result in results]
        compared = [differences(summaries[0], other) for other in summaries[1:]]
        drawn = [(label, r.columns, r.document) for label, r in zip(labels, results, strict=True)]
        signals = [curves_of(read(run, hand=one)) for run, (one, _) in found]
        save(figure(drawn, events=[r.events for r in results], signals=signals), output)
        document = {"picture": str(output), "runs": summaries, "differences": compared}
    if as_json:
        print_json(document)
        return
    show_results(results, labels if len(results) > 1 else (), shows_all=shows_all)
    for label, felt in zip(labels[1:], compared, strict=True):
        for difference in felt:
            show(f"{label} against {labels[0]}: {difference_text(difference)}")
    show(f"picture: {output}")


def _read(run: Path, hand: str | None, topics: Sequence[str] | None = None) -> Recording:
    """Return a recording, with these topics or all, and say if it is incomplete."""
    recording = read(run, tuple(TOPICS) if topics is None else topics, hand)
    if not recording.complete:
        show(f"forcebound: recording incomplete: using the readable part of {run}", err=True)
    return recording


def export(
    run: Path = _run,
    csv: Path = opt.option(
        "Into this folder, as CSV.", type=opt.FOLDER, metavar="DIR", required=True
    ),
    overwrite: bool = opt.flag("Replace existing files."),
    hand: str | None = opt.hand,
) -> None:
    r"""Write each topic of a recording as a table; columns.csv has their units and meanings.

    The tables of several hands are in folders of their names in DIR.

    \b
    forcebound export run.mcap --csv tables
    forcebound export run.mcap --csv tables --overwrite
    """
    for name, recording in _read(run, hand).by_hand.items():
        folder = csv if name == HAND else csv / name
        for file in write_tables(recording, folder, overwrite):
            show(str(file))


def recover(
    run: Path = _run,
    output: Path = opt.recording("The recording to write.", "-o", "--output", required=True),
    as_json: bool = opt.as_json,
) -> None:
    r"""Write the readable part of a cut or damaged recording as a complete one; report the loss.

    \b
    forcebound recover cut.mcap -o whole.mcap
    """
    found = write_recovered(run, output)
    if as_json:
        print_json(found)
        return
    show(f"recovered: {found.messages} messages, {found.duration:.3f} s")
    if found.lost_bytes:
        show(f"lost: the last {found.lost_bytes} bytes, which cannot be read")
    show("lost: what the recorder had not yet written; in a live run, at most the last 0.25 s")
    show(f"recording: {output}")


def replay(
    run: Path = _run,
    arguments: tuple[str, ...] = opt.settings,
    verify: bool = opt.flag("Check that its inputs give its forces, to the bit."),
    network: bool = opt.flag("Use the recorded delays instead of the set ones."),
    environment: bool = opt.flag("Use the recorded replies; they do not react to the hand."),
    live: bool = opt.flag("In real time. Default: in virtual time."),
    hand: str | None = opt.hand,
    duration: float | None = opt.run_duration,
    record: Path | None = opt.record,
    shows_all: bool = opt.shows_all,
    as_json: bool = opt.as_json,
) -> None:
    r"""Run the graph of a recording once more, its hand fed from the recording.

    NAME:=VALUE puts another part in place of the recorded one (law, device, operator, controller,
    environment) or changes a key of the launch file (environment.stiffness).

    --verify runs no graph: the recorded inputs through the same law give the recorded forces, to
    the bit. Exit status 1: a force differs, a command or a tick is missing. If the recording begins
    after the force engaged, verification begins at a new law.

    Several hands run together, and each is verified. One of them alone (--hand) needs
    --environment: what the others did to their world is in the recorded replies only.

    \b
    forcebound replay run.mcap law:=none
    forcebound replay run.mcap --network --live --record again.mcap controller:=local_model
    forcebound replay run.mcap --environment law:=tdpa
    forcebound replay run.mcap --verify
    forcebound replay two.mcap left.law:=none
    forcebound replay two.mcap --hand left --environment law:=none
    """
    if verify:
        if live or network or environment or duration or record:
            raise click.UsageError("--verify runs no graph: give it alone, or with NAME:=VALUE")
        _verify(run, hand, arguments, as_json)
    if record is not None and record.exists() and record.samefile(run):
        raise click.UsageError(f"--record: {record} is the recording itself")
    recording = _read(run, hand, (TOPIC_OF[Telemetry],))
    fed = {"hand": True, "network": network, "environment": environment}
    config = graph_of(recording, arguments, [feed for feed, is_fed in fed.items() if is_fed])
    seconds = duration_of(recording, config) if duration is None else duration
    words = " ".join((str(run), *arguments)) if live else None
    show_run(config, seconds, record, as_json, shows_all, words)


def _verify(run: Path, hand: str | None, settings: Sequence[str], as_json: bool) -> NoReturn:
    found = {}
    for name, recording in _read(run, hand, verification.TOPICS).by_hand.items():
        device = device_of(recording, settings)
        with content_of(run):
            found[name] = verification.verify(recording, device)
    if as_json:
        documents = {name: asdict(one) | {"is_same": one.is_same} for name, one in found.items()}
        print_json(documents.get(HAND, {"hands": documents}))
    else:
        for name, one in found.items():
            show("\n".join([*([f"{name}:"] if name != HAND else []), *_lines(one)]))
    sys.exit(0 if all(one.is_same for one in found.values()) else 1)


def _lines(found: verification.Verified) -> Iterator[str]:
    yield f"verified: {found.verified} of {found.ticks} ticks, {found.differing} differ"
    if found.difference:
        yield f"first difference: {found.difference}"
    if found.unknown:
        yield f"not verified: {found.unknown} ticks of an earlier ledger, see --help"
    if found.verified + found.unknown < found.ticks:
        yield "a tick is missing from the recording; what follows it cannot be verified"
    yield (
        f"commands: {found.commands} forces follow from a recorded one,"
        f" {found.unknown_commands} from none"
    )
