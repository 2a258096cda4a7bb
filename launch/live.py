"""Live run of a launch file: a run directory, four processes, a recording.

The run directory is private (0700) and holds the sockets and two documents for the processes:
``launch.json``, the resolved launch file, and ``run.json``, what only this run knows
(:class:`RunDocument`). The next run removes what remains after a crash.
"""

import fcntl
import json
import logging
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from forcebound import realtime
from forcebound.config.graph import GraphConfig
from forcebound.config.parameters import differences, holders, parameters
from forcebound.config.phases import Part, timetable
from forcebound.config.resolved import to_document
from forcebound.environments import may_tell_contacts
from forcebound.errors import ConfigError, DeviceError, RunError
from forcebound.files import check_writable, read_bytes
from forcebound.folders import is_own, runtime_folder, runtime_folders
from forcebound.launch.lifecycle import Limits
from forcebound.launch.links import check_links
from forcebound.launch.results import RunResult, run_metadata
from forcebound.launch.run_lock import exclusive, is_held, shared
from forcebound.launch.supervisor import Step, Supervisor
from forcebound.messages.packets import (
    TOPIC_OF,
    TOPICS,
    EnvironmentReply,
    Event,
    ForceCommand,
    Telemetry,
)
from forcebound.network.sockets import IPC_PATH_LIMIT
from forcebound.process import (
    control_endpoint,
    event_endpoint,
    remote_endpoint,
    topic_endpoint,
)
from forcebound.processes import LAUNCHER, PROCESSES

# Hz, of the servo of a live run. A tick with its partners is longer than a shorter period; between
# two ticks of a slower one nothing is heard of a request to engage or to stop. Not measured here:
# that would depend on what else runs just now, and refuse on a busy machine what runs well.
SLOWEST, FASTEST = 10.0, 5000.0
MAX_DOCUMENT = 10_000_000  # bytes of either document of a run; ten launch files have 3 MB

# What an environment's first answer brings.
REMOTE_TOPICS = (TOPIC_OF[EnvironmentReply], TOPIC_OF[ForceCommand])

TELEMETRY, REPLY, EVENT = TOPIC_OF[Telemetry], TOPIC_OF[EnvironmentReply], TOPIC_OF[Event]

LAUNCH_FILE, RUN_FILE, RECORDING = "launch.json", "run.json", "recording.mcap"

UPDATE_LOCK = "launch.lock"  # file; its lock belongs to the process that changes launch.json
UPDATE_POLL = 1e-3  # s between two attempts to lock it; a change takes some 10 ms
PHASE_PATIENCE = 0.1  # s that the launcher waits for the lock at the beginning of a phase

PREFIX = "forcebound-"  # of the names of run directories
SHORTEST = "/tmp"  # folder for temporary files whose path is short enough for any socket

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RunDocument:
    """What the processes of a run need in addition to the launch document."""

    launcher: int  # process id of the launcher, with which they end
    core: int | None  # that the chain of nodes shares
    record: str  # absolute path of the recording
    streams: list[list[str]]  # topic, endpoint; for each, the loop wakes the recorder
    metadata: dict[str, str] = field(default_factory=dict)  # of the recording
    file: str = ""  # launch file with its arguments, to identify the graph
    is_graph: bool = True  # False: one environment for a graph on another machine
    is_temporary: bool = False  # created for this run and removed after it

    def write(self, run_dir: Path) -> None:
        """Write this for the processes."""
        (run_dir / RUN_FILE).write_text(json.dumps(asdict(self)), encoding="utf-8")

    @classmethod
    def read(cls, run_dir: Path) -> "RunDocument":
        """Read what the launcher wrote.

        Raises:
            ConfigError: If it is not there, not yet or not any more, or not of this version.
        """
        try:
            return cls(**json.loads(read_bytes(run_dir / RUN_FILE, MAX_DOCUMENT)))
        except (OSError, ValueError, TypeError, RecursionError) as error:
            raise ConfigError(f"{run_dir} is not the run directory of a running graph") from error


def run_live(
    config: GraphConfig,
    duration: float | None = None,
    record: Path | None = None,
    limits: Limits | None = None,
    file: str = "",
) -> RunResult:
    """Run a graph as processes, one per node and one that records.

    An interrupt (Ctrl-C, SIGTERM) ends the run early and is no error. Call it from the main
    thread, because it catches signals.

    Args:
        config: What to run.
        duration: Duration with an engaged force, in s; None: that of the launch file.
        record: Where to keep the recording; None: nowhere.
        limits: How long start and stop may take.
        file: Launch file, with its arguments, by which one may know the graph.

    Raises:
        ConfigError: As :func:`check_here`.
        RunError: If a process did not become ready, ended by itself (a controller or environment:
            too often) or did not stop.
        KeyboardInterrupt: If the run was interrupted before its first sample; no recording is left.
    """
    check_here(config, record)
    core = realtime.choose_core(config.realtime.cores, taken=_taken_cores())
    with run_directory() as run_dir:
        recording = run_dir / RECORDING if record is None else record.absolute()
        write_launch_document(run_dir, config)
        topics = list(TOPICS)
        if record is None:  # a summary needs no more
            told = [REPLY] if may_tell_contacts(config.environment.model) else []
            topics = [TELEMETRY, *told, EVENT]
        metadata = run_metadata(config)
        streams = recorded_streams(run_dir, topics)
        run = RunDocument(
            os.getpid(), core, str(recording), streams, metadata, file, is_temporary=True
        )
        run.write(run_dir)
        duration_ns = round((config.duration if duration is None else duration) * 1e9)
        names = [name for name in PROCESSES if name != "environment" or _starts_here(config)]
        commands = {name: node_command(name, run_dir) for name in names}
        cores = realtime.leave_core(core)
        try:
            supervisor = Supervisor(
                commands,
                run_dir,
                duration_ns,
                limits,
                script=_script(config, run_dir),
                remote_topics=() if config.remote is None else REMOTE_TOPICS,
                changes=partial(_changes, to_document(config), run_dir),
                start_cores=cores,
            )
            interrupted = supervisor.run()
        except RunError:
            _discard_if_empty(recording)
            raise
        finally:
            os.sched_setaffinity(0, cores)
        return _result(recording, interrupted)


def _result(recording: Path, interrupted: bool) -> RunResult:
    if interrupted and _discard_if_empty(recording):
        raise KeyboardInterrupt
    try:
        return replace(RunResult.from_recording(recording), interrupted=interrupted)
    except ConfigError as error:
        raise RunError(str(error)) from error


def _discard_if_empty(recording: Path) -> bool:
    """Remove a recording without a sample, which would stand in the way of the next run."""
    from forcebound.recording import read  # slow, and rarely needed here

    with suppress(ConfigError):
        if (read(recording, (TELEMETRY,)).telemetry.engagement > 0.0).any():
            return False
    recording.unlink(missing_ok=True)
    return True


def check_here(config: GraphConfig, record: Path | None = None) -> None:
    """Check that this machine has what a live run needs, before any process starts.

    Args:
        config: What is to be run.
        record: Where the recording is to be kept; None: nowhere.

    Raises:
        ConfigError: If the rate is too high or low, the chain cannot be placed, the recording not
            be written, a link lose all packets, a key be missing, the address not be ours or a port
            be in use, or the device's port not be opened; the message names all that is wrong.
    """
    problems = []
    rate = config.device.servo.rate
    if not SLOWEST <= rate <= FASTEST:
        problems.append(
            f"device.rate: a live run keeps {SLOWEST:g} Hz to {FASTEST:g} Hz, got {rate:g} Hz;"
            " virtual time keeps any: `forcebound simulate`"
        )
    checks: list[Callable[[], object]] = [
        partial(realtime.choose_core, config.realtime.cores),
        partial(check_links, config),
    ]
    if record is not None:
        checks.append(partial(check_writable, record, "the recording"))
    if config.remote is not None:
        checks.append(partial(config.remote.check_here, "graph"))
    if (check_device := getattr(config.device.model, "check_here", None)) is not None:
        checks.append(check_device)
    for check in checks:
        try:
            check()
        except ConfigError as error:
            problems.append(str(error))
        except DeviceError as error:
            problems.append(f"device: {error}")
    if problems:
        raise ConfigError("\n".join(problems))


def _script(config: GraphConfig, run_dir: Path) -> list[Step]:
    """Return the actions of the launcher at the beginning of each phase."""
    steps = []
    before = config
    for part in timetable(config):
        # Unaffected processes are not disturbed, least of all the servo.
        concerned = holders(differences(before, part.config))
        begin = partial(_begin, run_dir, part, sorted(concerned))
        steps.append(Step(part.start_ns, begin, part.message, part.data))
        before = part.config
    return steps


def _begin(run_dir: Path, part: Part, concerned: Sequence[str]) -> Mapping[str, dict[str, Any]]:
    with updating(run_dir, PHASE_PATIENCE):  # a suspended command must not block the launcher
        return dict.fromkeys(concerned, write_launch_document(run_dir, part.config))


def _changes(started: Mapping[str, Any], run_dir: Path, node: str) -> dict[str, Any]:
    """Return the parameters of a node that differ from the launch file."""
    try:
        document = read_launch_document(run_dir)
    except ConfigError:
        return {}  # the node has reported that it cannot read it
    changed = differences(started, document)
    return {name: value for name, value in changed.items() if node in holders([name])}


def read_launch_document(run_dir: Path) -> dict[str, Any]:
    """Return what a graph runs with now, as :func:`write_launch_document` wrote it.

    Raises:
        ConfigError: If the run directory does not say.
    """
    try:
        document: dict[str, Any] = json.loads(read_bytes(run_dir / LAUNCH_FILE, MAX_DOCUMENT))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(f"cannot read what the graph in {run_dir} runs with: {error}") from error
    return document


def recorded_streams(run_dir: Path, topics: Sequence[str]) -> list[list[str]]:
    """Return topic and endpoint of each stream for a recorder of these topics."""
    streams = [[topic, topic_endpoint(run_dir, topic)] for topic in topics if topic != EVENT]
    if REPLY in topics:
        streams.append([REPLY, remote_endpoint(run_dir, REPLY)])
    return streams + [[EVENT, event_endpoint(run_dir, name)] for name in (*PROCESSES, LAUNCHER)]


def write_launch_document(run_dir: Path, config: GraphConfig) -> dict[str, Any]:
    """Write the configuration for processes that start and for commands that read the run.

    Returns:
        The request that brings a running process to it; see
        :class:`forcebound.launch.application.Tuner`.
    """
    partial = (
        run_dir / f"{LAUNCH_FILE}.{os.getpid()}"
    )  # a file per process, since others may write, too
    partial.write_text(json.dumps(to_document(config)), encoding="utf-8")
    partial.replace(run_dir / LAUNCH_FILE)
    return {
        "request": "configure",
        "time_ns": time.monotonic_ns(),
        "parameters": parameters(config),
    }


@contextmanager
def updating(run_dir: Path, patience: float) -> Iterator[bool]:
    """Lock the launch document between reading and writing it.

    Args:
        run_dir: Of the run.
        patience: How long to wait for another command that changes it, in s.

    Yields:
        Whether the lock was taken.
    """
    end = time.monotonic() + patience
    descriptor = os.open(run_dir / UPDATE_LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        is_locked = _try_lock(descriptor)
        while not is_locked and time.monotonic() < end:
            time.sleep(UPDATE_POLL)
            is_locked = _try_lock(descriptor)
        yield is_locked
    finally:
        os.close(descriptor)  # this frees the lock


def _try_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _starts_here(config: GraphConfig) -> bool:
    return config.remote is None or config.remote.local


def node_command(name: str, run_dir: Path) -> list[str]:
    """Return the command line of one process of a run."""
    program = [sys.executable, "-m", "forcebound", "node", name]
    return [*program, str(run_dir / LAUNCH_FILE), "--run-dir", str(run_dir), "--supervised"]


@contextmanager
def run_directory() -> Iterator[Path]:
    """Create a private directory whose ``ipc`` endpoints are short enough; remove it at the end."""
    longest = max(
        len(endpoint(Path(), name))
        for endpoint, names in (
            (topic_endpoint, tuple(TOPICS)),
            (control_endpoint, (*PROCESSES, LAUNCHER)),
        )
        for name in names
    )
    remove_left_over(run_folders())
    folder = tempfile.mkdtemp(prefix=PREFIX, dir=runtime_folder())
    if len(os.fsencode(folder)) + longest > IPC_PATH_LIMIT:
        os.rmdir(folder)
        folder = tempfile.mkdtemp(prefix=PREFIX, dir=SHORTEST)
    try:
        with shared(Path(folder)):
            yield Path(folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def run_folders() -> set[Path]:
    """Return the folders that may hold run directories."""
    return {*runtime_folders(), Path(tempfile.gettempdir()), Path(SHORTEST)}


def own_run_directories(folders: Iterable[Path]) -> list[Path]:
    """Return what is named like a run directory and belongs to this user, in folders of anybody."""
    return sorted(path for each in folders for path in each.glob(f"{PREFIX}*") if is_own(path))


def _taken_cores() -> list[int | None]:
    """Return the cores that this user's other graphs have for their nodes."""
    held = filter(is_held, own_run_directories(run_folders()))
    with suppress(OSError, ConfigError):  # one begins or ends just now
        return [RunDocument.read(run_dir).core for run_dir in held]
    return []


def remove_left_over(folders: Iterable[Path]) -> list[Path]:
    """Remove run directories of this user that remain from a crash; return them.

    Only those that were made for one run, whose owners are all dead (:mod:`.run_lock`), and that
    hold no recording: after a crash it may be of use.
    """
    removed = []
    for run_dir in own_run_directories(folders):
        try:
            run = RunDocument.read(run_dir)
            if not run.is_temporary or (run_dir / RECORDING).exists():
                continue
        except (OSError, ConfigError):
            continue  # no run, or one that is just beginning or ending
        with exclusive(run_dir) as is_free:
            if is_free:
                shutil.rmtree(run_dir, ignore_errors=True)
                removed.append(run_dir)
                _logger.info("removed a run directory that remained after a crash: %s", run_dir)
    return removed
