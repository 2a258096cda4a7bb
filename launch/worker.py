"""One process of a graph: builds the node and runs it.

A supervised process ends with its launcher in any case. When the launcher has ended, the kernel
sends SIGTERM to the device and the recorder, which have work to finish (zero force; the recording),
and SIGKILL to the others. The device or the recorder then removes the run directory.

A process never waits for its launcher: its output goes to a pipe and is dropped when the pipe is
full.
"""

import logging
import os
import shutil
import stat
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from forcebound import process, realtime
from forcebound.config.document import folder_of
from forcebound.config.graph import GraphConfig
from forcebound.config.resolved import CODE_OF_PROCESS, restore
from forcebound.errors import ConfigError, DeviceError, GuardianError
from forcebound.launch.application import Tuner
from forcebound.launch.build import build_node
from forcebound.launch.children import name_begins
from forcebound.launch.links import build_links
from forcebound.launch.results import run_metadata
from forcebound.launch.run_directory import (
    RECORDING,
    RUN_FILE,
    RunDocument,
    read_launch_document,
    recorded_streams,
    run_directory,
    write_launch_document,
)
from forcebound.launch.run_lock import is_held, shared
from forcebound.messages.packets import TOPICS
from forcebound.network.ends import RemoteEnd
from forcebound.nodes.environment import EnvironmentNode
from forcebound.processes import LOST, PROCESSES

_logger = logging.getLogger(__name__)


def run_node(
    kind: str,
    file: Path,
    run_dir: Path | None,
    supervised: bool,
    arguments: Sequence[str] = (),
) -> int:
    """Run one process of a graph to its end; return its exit status.

    Args:
        kind: ``"device"``, ``"controller"``, ``"environment"`` or ``"recorder"``.
        file: Supervised: the resolved launch document; by hand: any launch file.
        run_dir: Directory of the run's sockets; every process of a run names the same. None, for
            an environment alone: it serves the graph on another machine that ``remote`` of the
            launch file names.
        supervised: Whether a launcher started it, which lets the force engage and with which it
            ends. By hand, the device engages when the first command has come.
        arguments: Of a launch file that is run by hand.

    Raises:
        ConfigError: If the launch file is wrong, others may enter the run directory, an endpoint is
            in use, or a key is missing.
        DeviceError: If the device failed; its last force is zero, if it still took it.
    """
    description = " ".join((str(file), *arguments))
    with process.Stop() as stop:
        if run_dir is None:
            _serve_remotely(kind, _loaded(file, arguments), description, folder_of(file), stop)
            return 0
        if not supervised:
            config = _loaded(file, arguments)
            check_run_directory(run_dir)
            _run_by_hand(kind, config, description, folder_of(file), run_dir, stop)
            return 0
        run = RunDocument.read(run_dir)
        never_wait_for_a_reader()
        realtime.die_with_parent(PROCESSES[kind].death_signal)
        try:
            if _has_launcher(run):  # it may have ended before the line above
                config = restore(read_launch_document(run_dir), CODE_OF_PROCESS[kind])
                return _run_or_lose(kind, config, run, run_dir, stop)
        except (ConfigError, DeviceError):
            raise
        except Exception:
            _logger.exception("%s failed", kind)
            return 1
        finally:
            if not _has_launcher(run):
                shutil.rmtree(run_dir, ignore_errors=True)
        return 0


def _run_or_lose(
    kind: str, config: GraphConfig, run: RunDocument, run_dir: Path, stop: process.Stop
) -> int:
    """Run one process; return ``LOST`` for a device that failed and waits for its user."""
    try:
        _run(kind, config, run, run_dir, stop, engages_itself=False)
    except DeviceError as failure:
        if config.device.model.on_loss != "wait" and not isinstance(failure, GuardianError):
            raise
        _logger.error("%s", failure)
        return LOST
    return 0


def _loaded(file: Path, arguments: Sequence[str]) -> GraphConfig:
    """Return the configuration of a launch file for a node started by hand."""
    from forcebound.config.loader import load_tried  # a supervised process reads no launch file

    return load_tried(file, arguments)


def _serve_remotely(
    kind: str, config: GraphConfig, description: str, folder: Path, stop: process.Stop
) -> None:
    if kind != "environment":
        raise ConfigError(f"a {kind} needs the run directory of the other nodes: --run-dir DIR")
    if config.remote is None:
        raise ConfigError(
            "this launch file has no section remote: with the address of the graph; to serve a "
            "graph on this machine, give its run directory with --run-dir"
        )
    config.remote.check_here("environment")
    end = config.remote.end("environment")
    with run_directory() as run_dir:
        _run_by_hand(kind, config, description, folder, run_dir, stop, end)


def _run_by_hand(
    kind: str,
    config: GraphConfig,
    description: str,
    folder: Path,
    run_dir: Path,
    stop: process.Stop,
    remote_end: RemoteEnd | None = None,
) -> None:
    """Run one node without a launcher; write the files that ``forcebound param`` reads."""
    core = realtime.choose_core(config.realtime.cores)
    streams = recorded_streams(run_dir, list(TOPICS))
    metadata = run_metadata(config)
    is_alone = remote_end is not None
    run = RunDocument(
        os.getpid(),
        core,
        str(run_dir / RECORDING),
        streams,
        metadata,
        description,
        str(folder),
        is_graph=not is_alone,
        is_temporary=is_alone,
    )
    is_first = not (run_dir / RUN_FILE).exists() or not is_held(run_dir)
    with shared(run_dir):
        if is_first:  # files of former owners do not describe this run
            write_launch_document(run_dir, config)
            run.write(run_dir)
        _run(kind, config, run, run_dir, stop, kind == "device", remote_end)


def never_wait_for_a_reader() -> None:
    """Drop output to standard output or error while its pipe is full.

    A hung launcher would otherwise stop every process that has a line for its log. A line of up to
    4096 bytes (PIPE_BUF) is written as a whole or not at all. It takes Python's streams unbuffered
    (``PYTHONUNBUFFERED``, as the launcher sets it): a buffer would keep the lines, and raise.
    """
    for stream in (sys.stdout, sys.stderr):
        os.set_blocking(stream.fileno(), False)
    logging.raiseExceptions = False  # else a dropped line would cause a traceback


def check_run_directory(run_dir: Path) -> None:
    """Reject a run directory that others may enter: only its permissions protect its sockets.

    Raises:
        ConfigError: If it is another user's, or open to others.
    """
    status = run_dir.stat()
    make_one = "use a folder of its own: mkdir -m 700 DIR"
    if status.st_uid != os.geteuid():
        raise ConfigError(f"the run directory {run_dir} belongs to another user; {make_one}")
    if status.st_mode & 0o077:
        # Others may need this folder (/tmp, for example), so its mode is not changed.
        mode = stat.S_IMODE(status.st_mode)
        raise ConfigError(
            f"others may enter the run directory {run_dir} (mode {mode:04o}) and command forces; "
            f"{make_one}"
        )


def _run(
    kind: str,
    config: GraphConfig,
    run: RunDocument,
    run_dir: Path,
    stop: process.Stop,
    engages_itself: bool,
    remote_end: RemoteEnd | None = None,
) -> None:
    if kind == "recorder":
        _logger.info("recording to %s", run.record)
        record_run(run, run_dir, stop)
        return
    import numpy  # noqa: F401  # a link that is impaired later must not load it in the loop

    settings = realtime.Settings(
        policy=config.realtime.policy,
        core=run.core,
        lock_memory=config.realtime.lock_memory,
        deep_sleep=config.realtime.deep_sleep,
        spin_ns=round(config.realtime.spin * 1e9),
    )
    if kind == "controller" and config.remote is not None:
        remote_end = config.remote.end("graph")
    node = build_node(kind, config, environment_name(), time.monotonic_ns)
    if isinstance(node, EnvironmentNode):
        _logger.info("this environment is %s", node.name)
    links = build_links(config)  # a perfect link needs no model: its socket keeps the newest
    status = process.run(
        node, kind, run_dir, links, settings, stop, engages_itself, Tuner(config), remote_end
    )
    if isinstance(node, EnvironmentNode):
        _logger.info("queries answered by %s: %d", node.name, node.answered)
    _log_rejected(status)


def record_run(
    run: RunDocument,
    run_dir: Path,
    stop: process.Stop,
    name: str = "recorder",
    is_over: Callable[[str], bool] | None = None,
) -> dict[str, Any]:
    """Record the streams of a run into its file; return the last status of the recorder.

    Arguments are those of :func:`forcebound.process.record`.

    Raises:
        ConfigError: If the file cannot be created.
    """
    from forcebound.recording import Recorder  # slow to import; no other process needs it

    offset_ns = time.time_ns() - time.monotonic_ns()
    recorder = Recorder(run.record, run.metadata, offset_ns)
    is_complete = False
    try:
        streams = [(topic, endpoint) for topic, endpoint in run.streams]
        status = process.record(recorder, name, run_dir, streams, run.core, stop, is_over)
        is_complete = status["recording"] == process.COMPLETE
    finally:
        with suppress(OSError):  # a full disk, which was reported; the file stays readable
            recorder.close() if is_complete else recorder.abandon()
    _log_rejected(status)
    return status


def _log_rejected(status: Mapping[str, Any]) -> None:
    reasons = status["rejected"]
    if reasons:
        counts = ", ".join(f"{reason.replace('_', ' ')} {n}" for reason, n in reasons.items())
        _logger.warning("rejected packets, by reason: %s", counts)


def environment_name() -> str:
    """Return a name that no other environment process has."""
    return f"{name_begins(os.getpid())}{os.urandom(4).hex()}"


def _has_launcher(run: RunDocument) -> bool:
    return os.getppid() == run.launcher
