"""Live run of a launch file: a run directory, four processes, a recording."""

import os
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

from forcebound import realtime
from forcebound.errors import ConfigError, DeviceError, RunError
from forcebound.files import check_writable
from forcebound.graph.graph import GraphConfig, HandConfig
from forcebound.graph.names import parameter_name
from forcebound.graph.parameters import differences, node_of, with_values
from forcebound.graph.phases import ScheduledPhase, timetable
from forcebound.haptics.environments import may_report_contacts
from forcebound.messages.control import Configure, Parameters
from forcebound.messages.packets import (
    TOPIC_OF,
    EnvironmentReply,
    ForceCommand,
    Telemetry,
)
from forcebound.messages.topology import node_name
from forcebound.network.ends import check_ends
from forcebound.roles import ENVIRONMENT, LAUNCHER
from forcebound.run.actions import TimeLimits
from forcebound.run.fork_server import PROGRAM, ForkServer, fork_server
from forcebound.run.results import RunResult, run_metadata
from forcebound.run.run_directory import (
    BEFORE_FILE,
    EVENT,
    LAUNCH_FILE,
    RECORDING,
    REPLY,
    TELEMETRY,
    RunDocument,
    is_held,
    own_run_directories,
    read_configuration,
    requests,
    run_directory,
    run_folders,
    updating,
    write_configuration,
)
from forcebound.run.screen import Screen
from forcebound.run.supervisor import Supervisor

# Hz, of the servo of a live run. A tick with its partners is longer than a shorter period; between
# two ticks of a slower one nothing is heard of a request to engage or to stop. Not measured here:
# that would depend on what else runs just now, and refuse on a busy machine what runs well.
SLOWEST, FASTEST = 10.0, 5000.0

# What an environment's first answer brings.
REMOTE_TOPICS = (TOPIC_OF[EnvironmentReply], TOPIC_OF[ForceCommand])

LATELY = 10.0  # s after a change of its parameters, in which the end of a node is by the change
PHASE_TIMEOUT = 0.1  # s that the launcher waits for the lock at the beginning of a phase


def run_live(
    config: GraphConfig,
    duration: float | None = None,
    record: Path | None = None,
    limits: TimeLimits | None = None,
    file: str = "",
    screen: Screen | None = None,
    folder: Path = Path(),
    server: ForkServer | None = None,
) -> dict[str, RunResult]:
    """Run a graph as processes, one per node and one that records; return the result by hand.

    An interrupt (Ctrl-C, SIGTERM) ends the run early and is no error. Call it from the main thread,
    because it catches signals.

    Args:
        config: What to run.
        duration: Duration with an engaged force, in s; None: that of the launch file.
        record: Where to keep the recording; None: nowhere.
        limits: How long start and stop may take.
        file: Launch file, with its arguments, by which one may know the graph.
        screen: Where to say what happens; None: on standard error, lines of the processes only.
        folder: That has the files that a parameter may name during the run, maybe further below.
        server: Forks the processes; None: one of this run.

    Raises:
        ConfigError: As :func:`check_here`.
        RunError: If a process did not become ready, failed or did not stop. Where the force has
            engaged, the result says it instead.
        KeyboardInterrupt: If the run was interrupted before its first sample; no recording is left.
    """
    check_here(config, record)
    screen = screen or Screen()
    core = realtime.choose_core(config.realtime.cores, taken=_taken_cores())
    with run_directory() as run_dir:
        recording = run_dir / RECORDING if record is None else record.absolute()
        write_configuration(run_dir, config)
        recorded = list(config.graph.names)
        if record is None:  # a summary needs few
            contacts = [REPLY] if may_report_contacts(config.environment.model) else []
            topics = [TELEMETRY, *contacts, EVENT]
            recorded = [s.name for s in config.graph.streams if s.topic in topics]
        about = run_metadata(config), file, str(folder.resolve())
        owner = os.getpid(), core, str(recording)
        run = RunDocument(*owner, recorded, *about, graph=config.graph)
        run.write(run_dir)
        cores = realtime.leave_core(core)
        try:
            supervisor = _supervisor(config, run_dir, duration, limits, screen, cores)
            interrupted, failure = _run(supervisor, server), ""
        except RunError as error:
            if _discard_if_empty(recording):
                raise
            interrupted, failure = False, str(error)
        finally:
            os.sched_setaffinity(0, cores)
        screen.status("reading the recording for the result")
        results = _results(recording, config.hands_here, interrupted)
        return {hand: replace(result, failure=failure) for hand, result in results.items()}


def _run(supervisor: Supervisor, server: ForkServer | None) -> bool:
    with nullcontext(server) if server else fork_server() as supervisor.server:
        return supervisor.run()


def _supervisor(
    config: GraphConfig,
    run_dir: Path,
    duration: float | None,
    limits: TimeLimits | None,
    screen: Screen,
    start_cores: Collection[int],
) -> Supervisor:
    graph = config.graph
    elsewhere = {LAUNCHER} if config.has_environment else {LAUNCHER, ENVIRONMENT}
    commands = {name: node_command(name, run_dir) for name in graph.nodes if name not in elsewhere}
    awaited = {
        node_name(hand, topic)
        for hand, section in config.hands_here.items()
        for topic in REMOTE_TOPICS
        if section.remote is not None
    }
    return Supervisor(
        commands,
        run_dir,
        round((config.duration if duration is None else duration) * 1e9),
        limits,
        screen,
        phases=timetable(config),
        begin=partial(_begin, run_dir),
        remote_topics=awaited,
        changes=partial(_changes, config, run_dir),
        revert=partial(take_back, config, run_dir),
        start_cores=start_cores,
        graph=graph,
    )


def _results(recording: Path, hands: Iterable[str], interrupted: bool) -> dict[str, RunResult]:
    if interrupted and _discard_if_empty(recording):
        raise KeyboardInterrupt
    try:
        results = {hand: RunResult.from_recording(recording, hand=hand) for hand in hands}
        return {hand: replace(one, interrupted=interrupted) for hand, one in results.items()}
    except ConfigError as error:
        raise RunError(str(error)) from error


def _discard_if_empty(recording: Path) -> bool:
    """Remove a recording without a sample, which would stand in the way of the next run."""
    from forcebound.recordings.recording import read  # slow, and rarely needed here

    with suppress(ConfigError):
        for hand in read(recording).hands:
            samples = cast("Iterator[Telemetry]", read(recording, hand=hand).stream(TELEMETRY))
            if any(sample.engagement > 0.0 for sample in samples):
                return False
    recording.unlink(missing_ok=True)
    return True


def check_here(config: GraphConfig, record: Path | None = None) -> None:
    """Check that this machine has what a live run needs, before any process starts.

    Raises:
        ConfigError: If the rate is too high or low, the chain cannot be placed, the recording not
            be written, a link lose all packets, a key be missing, the address not be ours or a port
            be in use, or the device's port not be opened; the message names all that is wrong.
    """
    problems = []
    checks: list[Callable[[], object]] = [
        partial(realtime.choose_core, config.realtime.cores),
    ]
    for name, hand in config.hands_here.items():
        checks += [partial(_check_rate, name, hand), partial(_check_links, name, hand)]
        checks.append(hand.device.check_here)
    meetings = {name: hand.remote for name, hand in config.hands_here.items() if hand.remote}
    checks += [
        partial(check_ends, meetings, "graph"),
        partial(check_ends, config.served_elsewhere, ENVIRONMENT),
    ]
    if record is not None:
        checks.append(partial(check_writable, record, "the recording"))
    for check in checks:
        try:
            check()
        except ConfigError as error:
            problems.append(str(error))
        except DeviceError as error:
            problems.append(f"device: {error}")
    if problems:
        raise ConfigError("\n".join(problems))


def _check_rate(name: str, hand: HandConfig) -> None:
    rate = hand.servo.rate
    if not SLOWEST <= rate <= FASTEST:
        raise ConfigError(
            f"{parameter_name(name, 'device.rate')}: a live run keeps {SLOWEST:g} Hz to"
            f" {FASTEST:g} Hz, got {rate:g} Hz; virtual time keeps any: `forcebound simulate`"
        )


def _check_links(name: str, hand: HandConfig) -> None:
    """Raise ConfigError if no packet gets through a link while a live run waits for it."""
    end = TimeLimits().start_ns * 1e-9
    for topic, impairment in hand.links.items():
        if max(impairment.loss, impairment.corrupt) == 1.0 or impairment.delay >= end:
            raise ConfigError(
                f"{parameter_name(name, f'links.{topic}')}: no packet gets through in the first"
                f" {end:g} s, so a live run does not start; lose them later, with phases: or"
                " `forcebound param set`"
            )


def _begin(run_dir: Path, phase: ScheduledPhase) -> Mapping[str, Configure]:
    """Write what holds in a phase; return the request for each process that it concerns."""
    with updating(run_dir, PHASE_TIMEOUT):  # a suspended command must not block the launcher
        before = read_configuration(run_dir)
        config = with_values(replace(before, phases=()), phase.values)
        write_configuration(run_dir, config)
    # Unaffected processes are not disturbed, least of all the servo.
    return requests(config, differences(before, config))


def _changes(started: GraphConfig, run_dir: Path, node: str) -> Parameters:
    """Return the parameters of a node that differ from the launch file."""
    try:
        config = read_configuration(run_dir)
    except ConfigError:
        return {}  # the node has reported that it cannot read it
    return _of_node(node, differences(started, config), config)


def _of_node(node: str, values: Parameters, config: GraphConfig) -> Parameters:
    return {name: value for name, value in values.items() if node_of(name, config) == node}


def take_back(started: GraphConfig, run_dir: Path, node: str) -> Parameters:
    """Take back the last change of a node's parameters; if there was none, all that is changed.

    Returns the values that hold again, by name; none if nothing has changed lately.
    """
    if time.time() - (run_dir / LAUNCH_FILE).stat().st_mtime > LATELY:
        return {}
    with suppress(ConfigError), updating(run_dir, PHASE_TIMEOUT):  # of a file that is gone
        now, before = read_configuration(run_dir), started
        with suppress(ConfigError):  # nothing was changed yet
            before = read_configuration(run_dir, name=BEFORE_FILE)
        for earlier in (before, started):
            if own := _of_node(node, differences(now, earlier), now):
                write_configuration(run_dir, with_values(now, own))
                (run_dir / BEFORE_FILE).unlink()
                return own
    return {}


def node_command(name: str, run_dir: Path) -> list[str]:
    """Return the command line of one process of a run."""
    return [*PROGRAM, "node", name, str(run_dir / LAUNCH_FILE), "--run-dir", str(run_dir)]


def _taken_cores() -> list[int | None]:
    """Return the cores that this user's other graphs have for their nodes."""
    held = filter(is_held, own_run_directories(run_folders()))
    with suppress(OSError, ConfigError):  # one begins or ends just now
        return [RunDocument.read(run_dir).core for run_dir in held]
    return []
