"""Command ``forcebound replay``: a recording verified, or its graph run once more."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NoReturn

import click

from forcebound.cli import options as opt
from forcebound.cli.common import print_json, show
from forcebound.cli.lazy import when_used
from forcebound.cli.outcome import show_run
from forcebound.cli.recordings import given_run, read_saying
from forcebound.files import content_of

with when_used():
    from forcebound.lab import replay as again
    from forcebound.lab import verification
    from forcebound.messages import packets, topology


def replay(
    run: Path = given_run,
    arguments: tuple[str, ...] = opt.settings,
    verify: bool = opt.flag("Check that its inputs give its forces, to the bit."),
    network: bool = opt.flag("Use the recorded delays instead of the set ones."),
    environment: bool = opt.flag("Use the recorded replies; they do not react to the hand."),
    onto: str | None = opt.option(
        "Launch file, one of whose hands does what the recorded one did.", metavar="FILE[:HAND]"
    ),
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

    --onto FILE runs a launch file in place of the recorded graph, NAME:=VALUE are its arguments,
    and the recorded hand moves one of its simulated hands. A real follower in FILE does it as well.

    Several hands run together, and each is verified. One of them alone (--hand) needs
    --environment: what the others did to their world is in the recorded replies only.

    \b
    forcebound replay run.mcap law:=none
    forcebound replay run.mcap --network --live --record again.mcap controller:=local_model
    forcebound replay run.mcap --environment law:=tdpa
    forcebound replay run.mcap --verify
    forcebound replay two.mcap --hand leader --onto pair.yaml:leader --live
    forcebound replay two.mcap left.law:=none
    forcebound replay two.mcap --hand left --environment law:=none
    """
    if verify:
        if live or network or environment or duration or record or onto:
            raise click.UsageError("--verify runs no graph: give it alone, or with NAME:=VALUE")
        _verify(run, hand, arguments, as_json)
    if record is not None and record.exists() and record.samefile(run):
        raise click.UsageError(f"--record: {record} is the recording itself")
    recording = read_saying(run, hand, (packets.TOPIC_OF[packets.Telemetry],))
    fed = {"hand": True, "network": network, "environment": environment}
    if onto is None:
        config = again.graph_of(recording, arguments, [name for name, on in fed.items() if on])
    elif network or environment:
        raise click.UsageError("--onto runs another graph: its network, its environment")
    else:
        config = again.graph_onto(recording, onto, arguments)
    seconds = again.duration_of(recording, config) if duration is None else duration
    words = " ".join((str(run), *arguments)) if live else None
    show_run(config, seconds, record, as_json, shows_all, words)


def _verify(run: Path, hand: str | None, settings: Sequence[str], as_json: bool) -> NoReturn:
    verified, changed = {}, {}
    for name, recording in read_saying(run, hand, verification.TOPICS).by_hand.items():
        device = again.device_of(recording, settings)
        changed[name] = again.changed_keys(recording, settings)
        with content_of(run):
            verified[name] = verification.verify(recording, device)
    if as_json:
        documents = {name: asdict(one) | {"is_same": one.is_same} for name, one in verified.items()}
        print_json(documents.get(topology.HAND, {"hands": documents}))
    else:
        for name, one in verified.items():
            show("\n".join([*([f"{name}:"] if name != topology.HAND else []), *_lines(one)]))
            if changed[name]:
                show(f"not as recorded: {', '.join(changed[name])}")
    sys.exit(0 if all(one.is_same for one in verified.values()) else 1)


def _lines(verified: "verification.Verified") -> Iterator[str]:
    yield f"verified: {verified.verified} of {verified.ticks} ticks, {verified.differing} differ"
    if verified.difference:
        yield f"first difference: {verified.difference}"
    if verified.unknown:
        yield f"not verified: {verified.unknown} ticks of an earlier ledger, see --help"
    if verified.verified + verified.unknown < verified.ticks:
        yield "a tick is missing from the recording; what follows it cannot be verified"
    yield (
        f"commands: {verified.commands} forces follow from a recorded one,"
        f" {verified.unknown_commands} from none"
    )
