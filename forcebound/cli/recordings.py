"""Commands that make a recording of a running graph, or something of one."""

from collections.abc import Sequence
from pathlib import Path

import click

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import print_json, show
from forcebound.cli.lazy import when_used
from forcebound.cli.outcome import show_results
from forcebound.files import content_of
from forcebound.stop import Stop

with when_used():
    from forcebound.messages import packets, topology
    from forcebound.observe import recorder
    from forcebound.observe import runs as observed
    from forcebound.recordings import demonstrations, learning_files, recovery
    from forcebound.recordings import export as tabled
    from forcebound.recordings import recording as recorded
    from forcebound.results import perception, plots, signals, tables
    from forcebound.run import results as run_results

_recorded = opt.running(require_graph=True, named="`forcebound record GRAPH`")
given_run = opt.argument(complete.recordings, metavar="RUN.mcap", type=opt.FILE)


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
        file = output or recorder.free_name(Path(), graph)
        found = recorder.record_running(graph, file, duration, begin, stop)
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
    plots.check_picture(output)
    found = [(run, one) for run in runs for one in run_results.results_of(Path(run), hand).items()]
    results = [result for _, (_, result) in found]
    labels = [result.label for result in results]
    if len(set(labels)) < len(labels):  # same law: distinguished by file
        labels = [f"{run}: {result.label}" for run, (_, result) in found]
    with content_of(" and ".join(runs)):
        summaries = [result.summary for result in results]
        first: dict[str, int] = {}  # result of each hand
        pairs = [(first.setdefault(one, n), n) for n, (_, (one, _)) in enumerate(found)]
        pairs = [(before, n) for before, n in pairs if before != n]
        compared = [perception.differences(summaries[a], summaries[b]) for a, b in pairs]
        drawn = [(label, r.columns, r.document) for label, r in zip(labels, results, strict=True)]
        curves = [signals.curves_of(recorded.read(run, hand=one)) for run, (one, _) in found]
        events = [result.events for result in results]
        plots.save(plots.figure(drawn, events=events, signals=curves), output)
        document = {"picture": str(output), "runs": summaries, "differences": compared}
    if as_json:
        print_json(document)
        return
    show_results(results, labels if len(results) > 1 else (), shows_all=shows_all)
    for (before, n), felt in zip(pairs, compared, strict=True):
        for difference in felt:
            words = tables.difference_text(difference)
            show(f"{labels[n]} against {labels[before]}: {words}")
    show(f"picture: {output}")


def read_saying(
    run: Path, hand: str | None, topics: Sequence[str] | None = None
) -> "recorded.Recording":
    """Return a recording, with these topics or all, and say if it is incomplete."""
    recording = recorded.read(run, tuple(packets.TOPICS) if topics is None else topics, hand)
    if not recording.complete:
        growing = run.resolve() in [Path(one.record) for one in observed.running().values()]
        why = "the graph still records it" if growing else "recording incomplete"
        show(f"forcebound: {why}: using the readable part of {run}", err=True)
    return recording


def _features(
    _: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> dict[str, list[str]]:
    found = {}
    for text in given:
        name, is_given, columns = text.partition("=")
        if not (is_given and name.isidentifier()):
            raise click.BadParameter(f"expected NAME=COLUMN,..., got {text!r}", param=parameter)
        found[name] = [column.strip() for column in columns.split(",") if column.strip()]
    return found


def export(
    runs: tuple[Path, ...] = opt.arguments(
        "RUN.mcap...", complete.recordings, type=opt.FILE, required=True
    ),
    csv: Path | None = opt.option("Into this folder, as CSV.", type=opt.FOLDER, metavar="DIR"),
    hdf5: Path | None = opt.file("Into this file, as HDF5 (robomimic).", metavar="FILE"),
    zarr: Path | None = opt.option(
        "Into this folder, as zarr (diffusion policy).", type=opt.FOLDER, metavar="DIR"
    ),
    lerobot: Path | None = opt.option(
        "Into this folder, as LeRobotDataset v3.0; needs --fps.", type=opt.FOLDER, metavar="DIR"
    ),
    overwrite: bool = opt.flag("Replace what exists."),
    hand: str | None = opt.hand,
    features: dict[str, list[str]] = opt.repeated(
        "Columns of a feature; without any it is left out.",
        "--feature",
        metavar="NAME=[COLUMN,...]",
        callback=_features,
    ),
    fps: int | None = opt.option("Frames per second. Default: each tick.", type=opt.COUNT),
    task: str | None = opt.option("What is done. Default: the launch file's description."),
    takes_all: bool = opt.flag("Take discarded episodes, too.", "--all"),
) -> None:
    r"""Write recordings as tables, or as a data set that learning reads.

    CSV: each topic of one recording as a table; columns.csv has their units and meanings. The
    tables of several hands are in folders of their names in DIR.

    HDF5, zarr, LeRobotDataset: the kept episodes of all recordings as one data set; --feature,
    --fps, --task and --all are for these. A column is one of those tables, such as position,
    leader.position or telemetry.position; with +1, its value in the next row.

    \b
    forcebound export run.mcap --csv tables
    forcebound export one.mcap two.mcap --hdf5 demos.hdf5
    forcebound export pair.mcap --lerobot pair --fps 30 --feature effort=leader.applied_force
    """
    given = {"hdf5": hdf5, "zarr": zarr, "lerobot": lerobot}
    places = {form: place for form, place in given.items() if place is not None}
    if (csv is None) != bool(places):
        raise click.UsageError("name what to write: --csv, or any of --hdf5, --zarr, --lerobot")
    if csv is not None and len(runs) > 1:
        raise click.UsageError(f"--csv takes one recording, got {len(runs)}")
    if lerobot is not None and fps is None:
        raise click.UsageError("a LeRobotDataset has frames at an even rate: add --fps 30")
    recordings = [read_saying(run, hand) for run in runs]
    if csv is not None:
        for name, recording in recordings[0].by_hand.items():
            folder = csv if name == topology.HAND else csv / name
            for file in tabled.export(recording, folder, overwrite):
                show(str(file))
    else:
        data = demonstrations.DataSet(recordings, features, fps, task, takes_all)
        for form, place in places.items():
            learning_files.write(data, form, place, overwrite)
            show(str(place))
        show(str(data))


def recover(
    run: Path = given_run,
    output: Path = opt.recording("The recording to write.", "-o", "--output", required=True),
    as_json: bool = opt.as_json,
) -> None:
    r"""Write the readable part of a cut or damaged recording as a complete one; report the loss.

    \b
    forcebound recover cut.mcap -o whole.mcap
    """
    found = recovery.recover(run, output)
    if as_json:
        print_json(found)
        return
    show(f"recovered: {found.messages} messages, {found.duration:.3f} s")
    if found.lost_bytes:
        show(f"lost: the last {found.lost_bytes} bytes, which cannot be read")
    show("lost: what the recorder had not yet written; in a live run, at most the last 0.25 s")
    show(f"recording: {output}")
