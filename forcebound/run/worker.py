"""One process of a graph: builds the node and runs it.

It ends with its launcher in any case. When the launcher has ended, the kernel
sends SIGTERM to the device and the recorder, which have work to finish (zero force; the recording),
and SIGKILL to the others. The device or the recorder then removes the run directory.

A process never waits for its launcher: its output goes to a pipe and is dropped when the pipe is
full.
"""

import logging
import os
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from forcebound import realtime
from forcebound.errors import ConfigError, DeviceError, GuardianError
from forcebound.graph.document import folder_of
from forcebound.graph.graph import GraphConfig
from forcebound.messages.control import ProcessStatus, RecorderStatus
from forcebound.messages.topology import HAND
from forcebound.network.ends import RemoteEnd, check_ends
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.roles import CONTROLLER, ENVIRONMENT, LOST, RECORDER, ROLES
from forcebound.run.application import Tuner
from forcebound.run.build import build_links, build_node, parts_of
from forcebound.run.children import name_begins
from forcebound.run.process.recorder import COMPLETE, clocks, record
from forcebound.run.process.runner import run as run_process
from forcebound.run.results import run_metadata
from forcebound.run.run_directory import (
    RECORDING,
    RunDocument,
    read_configuration,
    run_directory,
    write_configuration,
)
from forcebound.stop import Stop

_logger = logging.getLogger(__name__)


def run_node(name: str, run_dir: Path) -> int:
    """Run one process of a graph, for its launcher, to its end; return its exit status.

    Raises:
        ConfigError: If an endpoint is in use, or a key is missing.
        DeviceError: If the device failed; its last force is zero, if it still took it.
    """
    begun_ns = time.monotonic_ns()  # before it reads its configuration
    with Stop() as stop:
        run = RunDocument.read(run_dir)
        never_wait_for_a_reader()
        realtime.die_with_parent(ROLES[run.graph.nodes[name].role].death_signal)
        try:
            if _has_launcher(run):  # it may have ended before the line above
                config = read_configuration(run_dir, parts_of(run.graph.nodes[name].role))
                return _run_or_lose(name, config, run, run_dir, stop, begun_ns)
        except (ConfigError, DeviceError):
            raise
        except Exception:
            _logger.exception("%s failed", name)
            return 1
        finally:
            if not _has_launcher(run):
                shutil.rmtree(run_dir, ignore_errors=True)
        return 0


def serve_environment(file: Path, arguments: Sequence[str] = ()) -> None:
    """Run the environment of a launch file for hands on other machines, until a stop request.

    It serves those with a section ``remote``. ConfigError if the file is wrong or no hand has one,
    or a key is missing.
    """
    from forcebound.graph.loader import load_tried  # a process of a launcher reads no launch file

    begun_ns = time.monotonic_ns()
    with Stop() as stop:
        config = load_tried(file, arguments)
        remotes = {name: hand.remote for name, hand in config.hands.items() if hand.remote}
        if not remotes:
            raise ConfigError(
                "the launch file has no section remote: with the address of the graph"
            )
        check_ends(remotes, ENVIRONMENT)
        ends = {name: remote.end(ENVIRONMENT) for name, remote in remotes.items()}
        with run_directory() as run_dir:
            core = realtime.choose_core(config.realtime.cores)
            description = " ".join((str(file), *arguments))
            run = RunDocument(
                os.getpid(),
                core,
                str(run_dir / RECORDING),
                list(config.graph.names),
                run_metadata(config),
                description,
                str(folder_of(file)),
                is_graph=False,
                graph=config.graph,
            )
            write_configuration(run_dir, config)  # for `forcebound param`
            run.write(run_dir)
            _run(ENVIRONMENT, config, run, run_dir, stop, begun_ns, ends)


def _run_or_lose(
    name: str, config: GraphConfig, run: RunDocument, run_dir: Path, stop: Stop, begun_ns: int
) -> int:
    """Run one process; return ``LOST`` for a device that failed and waits for its user."""
    try:
        _run(name, config, run, run_dir, stop, begun_ns)
    except DeviceError as failure:
        hand = config.hands[run.graph.nodes[name].hand or HAND]
        if hand.device.on_loss != "wait" and not isinstance(failure, GuardianError):
            raise
        _logger.error("%s", failure)
        return LOST
    return 0


def never_wait_for_a_reader() -> None:
    """Drop output to standard output or error while its pipe is full.

    A hung launcher would otherwise stop every process that has a line for its log. A line of up to
    4096 bytes (PIPE_BUF) is written as a whole or not at all. It takes Python's streams unbuffered
    (``PYTHONUNBUFFERED``, as the launcher sets it): a buffer would keep the lines, and raise.
    """
    for stream in (sys.stdout, sys.stderr):
        os.set_blocking(stream.fileno(), False)
    logging.raiseExceptions = False  # else a dropped line would cause a traceback


def _run(
    name: str,
    config: GraphConfig,
    run: RunDocument,
    run_dir: Path,
    stop: Stop,
    begun_ns: int,
    remote_ends: Mapping[str, RemoteEnd] | None = None,
) -> None:
    role = run.graph.nodes[name].role
    if role == RECORDER:
        _logger.info("recording to %s", run.record)
        _log_rejected(_record(run, run_dir, stop))
        return
    import numpy  # noqa: F401  # a link that is impaired later must not load it in the loop

    settings = realtime.Settings(
        policy=config.realtime.policy,
        core=core_of(run, name, config),
        lock_memory=config.realtime.lock_memory,
        deep_sleep=config.realtime.deep_sleep,
        spin_ns=round(config.realtime.spin * 1e9),
    )
    ends = _remote_ends(name, config) if remote_ends is None else remote_ends
    node = build_node(name, config, environment_name(), time.monotonic_ns)
    if isinstance(node, EnvironmentNode):
        _logger.info("this environment is %s", node.name)
    hands = list(config.hands_here)
    if isinstance(node, DeviceNode) and len(hands) > 1:  # one answer after the other
        share = hands.index(node.hand) / len(hands)
        node.phase_ns = round(share * 1e9 / config.hands[node.hand].servo.rate)
    links = build_links(config)  # a perfect link needs no model: its socket keeps the newest
    tuner = Tuner(config, begun_ns)
    status = run_process(node, name, run_dir, links, settings, stop, tuner, ends, run.graph)
    if isinstance(node, EnvironmentNode):
        _logger.info("queries answered by %s: %d", node.name, node.answered)
    _log_rejected(status)


def core_of(run: RunDocument, name: str, config: GraphConfig) -> int | None:
    """Return the core of a node: hands take turns, since a core is full with the nodes of two.

    A core that the launch file gives by its number is that of all.
    """
    hand = run.graph.nodes[name].hand
    if run.core is None or hand is None or config.realtime.cores != "auto":
        return run.core
    cores = [run.core, *sorted(os.sched_getaffinity(0) - {run.core}, reverse=True)]
    return cores[list(config.hands_here).index(hand) % len(cores)]


def _remote_ends(name: str, config: GraphConfig) -> dict[str, RemoteEnd]:
    """Return the ends here of the links of a launcher's node to other machines, by hand."""
    node = config.graph.nodes[name]
    if node.role == ENVIRONMENT:
        return {hand: one.end(ENVIRONMENT) for hand, one in config.served_elsewhere.items()}
    hand = node.hand or HAND
    remote = config.hands[hand].remote if node.role == CONTROLLER else None
    return {} if remote is None else {hand: remote.end("graph")}


def _record(run: RunDocument, run_dir: Path, stop: Stop) -> RecorderStatus:
    """Record the streams of a run into its file; return the last status of the recorder."""
    from forcebound.recordings.recording import (
        Recorder,  # slow to import; no other process needs it
    )

    offset_ns, clock = clocks()
    recorder = Recorder(run.record, run.metadata | clock, offset_ns, run.graph)
    is_complete = False
    try:
        status = record(recorder, run_dir, run.graph, run.recorded, run.core, stop)
        is_complete = status.recording == COMPLETE
    finally:
        with suppress(OSError):  # a full disk, which was reported; the file stays readable
            recorder.close(clocks()[1]) if is_complete else recorder.abandon()
    return status


def _log_rejected(status: ProcessStatus) -> None:
    if status.rejected:
        counts = ", ".join(f"{why.replace('_', ' ')} {n}" for why, n in status.rejected.items())
        _logger.warning("rejected packets, by reason: %s", counts)


def environment_name() -> str:
    """Return a name that no other environment process has."""
    return f"{name_begins(os.getpid())}{os.urandom(4).hex()}"


def _has_launcher(run: RunDocument) -> bool:
    return os.getppid() == run.launcher
