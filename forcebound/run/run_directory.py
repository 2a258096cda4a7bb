"""The run directory: where it is, its documents and streams, what remains of it after a crash.

It is private (0700) and holds the sockets of a run and two documents for its processes:
``launch.json``, the resolved launch file, and ``run.json``, what only this run knows
(:class:`RunDocument`). The next run removes what remains after a crash.

Its owner, a launcher or an environment for a graph on another machine, keeps a lock on a file in it
while it lives. The kernel frees the lock with the process, however that ends; a process id could be
reused.
"""

import fcntl
import json
import logging
import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from forcebound.errors import ConfigError
from forcebound.files import printable, read_bytes
from forcebound.folders import is_own, runtime_folder, runtime_folders
from forcebound.graph.graph import GraphConfig
from forcebound.graph.model import Makes, never, restore
from forcebound.graph.parameters import by_node, node_of
from forcebound.graph.resolved import run_document
from forcebound.messages.control import Configure
from forcebound.messages.packets import TOPIC_OF, EnvironmentReply, Event, Telemetry
from forcebound.messages.topology import ONE_HAND, Document, Graph, endpoint, is_bound
from forcebound.network.sockets import IPC_PATH_LIMIT
from forcebound.roles import LAUNCHER

MAX_DOCUMENT = 10_000_000  # bytes of either document of a run; ten launch files have 3 MB

TELEMETRY, REPLY, EVENT = TOPIC_OF[Telemetry], TOPIC_OF[EnvironmentReply], TOPIC_OF[Event]

LAUNCH_FILE, RUN_FILE, RECORDING = "launch.json", "run.json", "recording.mcap"
BEFORE_FILE = "launch.before.json"  # the launch document before its last change

LOCK_FILE = "lock"  # its lock belongs to the owner of a run directory
UPDATE_LOCK = "launch.lock"  # file; its lock belongs to the process that changes launch.json
UPDATE_POLL = 1e-3  # s between two attempts to lock it; a change takes some 10 ms

PREFIX = "forcebound-"  # of the names of run directories
SHORTEST = "/tmp"  # folder for temporary files whose path is short enough for any socket

_logger = logging.getLogger(__name__)


class RunDocument(msgspec.Struct, frozen=True):
    """Facts that the processes of a run need beside the launch document."""

    launcher: int  # process id of the launcher, with which they end
    core: int | None  # that the chain of nodes shares
    record: str  # absolute path of the recording
    recorded: list[str]  # names of streams; for each, the loop wakes the recorder
    metadata: dict[str, str] = {}  # of the recording
    file: str = ""  # launch file with its arguments, to identify the graph
    folder: str = ""  # the files that a parameter names while the graph runs are in it or below
    is_graph: bool = True  # False: one environment for a graph on another machine
    graph: Graph = ONE_HAND  # processes and streams, with their sockets in this directory

    def write(self, run_dir: Path) -> None:
        """Write this for the processes; ConfigError if a name of a file in it is not UTF-8."""
        try:
            (run_dir / RUN_FILE).write_bytes(msgspec.json.encode(self))
        except UnicodeEncodeError as error:
            name = printable(error.object)
            raise ConfigError(f"{name} is not UTF-8", "rename it, or set LC_ALL=C.UTF-8") from None

    @classmethod
    def read(cls, run_dir: Path) -> "RunDocument":
        """Read what the launcher wrote; ConfigError if it is not there, or not of this version."""
        try:
            return msgspec.json.decode(read_bytes(run_dir / RUN_FILE, MAX_DOCUMENT), type=cls)
        except (OSError, msgspec.MsgspecError) as error:
            raise ConfigError(f"{run_dir} is not the run directory of a running graph") from error


def graph_in(run_dir: Path) -> Graph:
    """Return the graph of a run; of one that begins or ends just now, that of one hand."""
    try:
        return RunDocument.read(run_dir).graph
    except ConfigError:
        return ONE_HAND


def has_launcher(run_dir: Path) -> bool:
    """Return whether a launcher answers in a run directory, or is about to."""
    return is_bound(run_dir, graph_in(run_dir).nodes[LAUNCHER])


def read_launch_document(run_dir: Path, name: str = LAUNCH_FILE) -> Document:
    """Return the launch document of a graph; ConfigError if it cannot be read."""
    try:
        document: Document = json.loads(read_bytes(run_dir / name, MAX_DOCUMENT))
    except (OSError, ValueError, RecursionError) as error:
        raise ConfigError(f"cannot read what the graph in {run_dir} runs with: {error}") from error
    return document


def read_configuration(run_dir: Path, makes: Makes = never, name: str = LAUNCH_FILE) -> GraphConfig:
    """Return what a graph runs with, with the parts that this process ``makes``.

    ConfigError if it cannot be read.
    """
    return restore(read_launch_document(run_dir, name), makes)


def write_configuration(run_dir: Path, config: GraphConfig) -> None:
    """Write the configuration for processes that start and for commands that read the run."""
    unfinished = run_dir / f"{LAUNCH_FILE}.{os.getpid()}"  # others may write, too
    with suppress(FileNotFoundError):  # the first one
        unfinished.write_bytes((run_dir / LAUNCH_FILE).read_bytes())
        unfinished.replace(run_dir / BEFORE_FILE)
    unfinished.write_text(json.dumps(run_document(config)), encoding="utf-8")
    unfinished.replace(run_dir / LAUNCH_FILE)


def requests(config: GraphConfig, changed: Iterable[str]) -> dict[str, Configure]:
    """Return what brings each node that some parameters belong to to a configuration, by node.

    All parameters of the node, since an earlier request may not have reached it.
    """
    now_ns, units, values = time.monotonic_ns(), dict(config.units), by_node(config)
    nodes = sorted({node_of(name, config) for name in changed})
    return {node: Configure(now_ns, values.get(node, {}), units) for node in nodes}


@contextmanager
def updating(run_dir: Path, timeout: float) -> Iterator[bool]:
    """Lock the launch document between reading and writing it; yield whether that was possible.

    ``timeout`` is how long to wait for another command that changes it, in s.
    """
    end = time.monotonic() + timeout
    descriptor = os.open(run_dir / UPDATE_LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        while not (is_locked := try_lock(descriptor)) and time.monotonic() < end:
            time.sleep(UPDATE_POLL)
        yield is_locked
    finally:
        os.close(descriptor)  # this frees the lock


@contextmanager
def shared(run_dir: Path) -> Iterator[None]:
    """Own a run directory during the body.

    Raises:
        OSError: If the lock's file cannot be made.
    """
    descriptor = os.open(run_dir / LOCK_FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH)  # waits only microseconds, for `exclusive`
        yield
    finally:
        os.close(descriptor)


@contextmanager
def exclusive(run_dir: Path) -> Iterator[bool]:
    """Keep a run directory without owner during the body; yield False if it has one."""
    try:
        descriptor = os.open(run_dir / LOCK_FILE, os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        yield False  # unknown
        return
    try:
        yield try_lock(descriptor)
    finally:
        os.close(descriptor)


def try_lock(descriptor: int) -> bool:
    """Lock an open file for this process alone; return whether that was possible."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def is_held(run_dir: Path) -> bool:
    """Return whether a run directory has a living owner."""
    with exclusive(run_dir) as is_free:
        return not is_free and (run_dir / LOCK_FILE).exists()


@contextmanager
def run_directory() -> Iterator[Path]:
    """Create a private directory whose ``ipc`` endpoints are short enough; remove it at the end."""
    longest = max(len(endpoint(Path(), stream)) for stream in ONE_HAND.streams)
    remove_left_over(run_folders())
    folder = tempfile.mkdtemp(prefix=PREFIX, dir=runtime_folder())
    if len(os.fsencode(folder)) + longest > IPC_PATH_LIMIT:
        os.rmdir(folder)
        folder = tempfile.mkdtemp(prefix=PREFIX, dir=SHORTEST)
    try:
        with shared(Path(folder)):
            yield Path(folder)
    finally:
        try:
            shutil.rmtree(folder, ignore_errors=True)
        except KeyboardInterrupt:  # a signal just now: the rest, and then the end
            shutil.rmtree(folder, ignore_errors=True)
            raise


def run_folders() -> set[Path]:
    """Return the folders that may hold run directories."""
    return {*runtime_folders(), Path(tempfile.gettempdir()), Path(SHORTEST)}


def own_run_directories(folders: Iterable[Path]) -> list[Path]:
    """Return the directories of this user in some folders that are named like run directories."""
    return sorted(path for each in folders for path in each.glob(f"{PREFIX}*") if is_own(path))


def remove_left_over(folders: Iterable[Path]) -> list[Path]:
    """Remove run directories of this user that remain from a crash; return them.

    Only those whose owner is dead, and that hold no recording: after a crash it
    may be of use.
    """
    removed = []
    for run_dir in own_run_directories(folders):
        try:
            RunDocument.read(run_dir)
            if (run_dir / RECORDING).exists():
                continue
        except (OSError, ConfigError):
            continue  # no run, or one that is just beginning or ending
        with exclusive(run_dir) as is_free:
            if is_free:
                shutil.rmtree(run_dir, ignore_errors=True)
                removed.append(run_dir)
                _logger.info("removed a run directory that remained after a crash: %s", run_dir)
    return removed
