"""What runs inside one process of a graph: build the node, drive it, and die when told.

A supervised process dies with its launcher, however that ends. The kernel sends it a signal when
the launcher is gone: SIGTERM to the device and the recorder, which have something to finish (force
zero; the recording), SIGKILL to the others. Whoever of the former goes then removes the run
directory.
"""

import json
import logging
import os
import shutil
import signal
import socket
import stat
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from forcebound import process, realtime
from forcebound.errors import ConfigError
from forcebound.launch.build import build_links, build_node
from forcebound.launch.changes import Reloader
from forcebound.launch.config import GraphConfig
from forcebound.launch.live import LAUNCH_FILE, RECORDING, RunDocument, recorded_streams
from forcebound.launch.loader import from_document, load
from forcebound.launch.results import run_metadata
from forcebound.messages.packets import TOPICS
from forcebound.recording import Recorder

FINISHERS = ("device", "recorder")  # they get SIGTERM when the launcher dies, the others SIGKILL

_logger = logging.getLogger(__name__)


def run_node(
    kind: str, file: Path, run_dir: Path, supervised: bool, arguments: Sequence[str] = ()
) -> int:
    """Run one process of a graph to its end; return its exit status.

    Args:
        kind: ``"device"``, ``"controller"``, ``"environment"`` or ``"recorder"``.
        file: Supervised: the resolved launch document; by hand: any launch file.
        run_dir: Directory of the run's sockets; every process of a run names the same.
        supervised: Whether a launcher started it, which says when the force engages and with which
            it dies. By hand, the device engages when the first command has come.
        arguments: Of a launch file that is run by hand.

    Raises:
        ConfigError: If the launch file is wrong, others may enter the run directory, or an endpoint
            is in use.
    """
    with process.Stop() as stop:
        if not supervised:
            config = load(file, arguments)
            check_run_directory(run_dir)
            core = realtime.choose_core(config.realtime.cores)
            record = str(run_dir / RECORDING)
            streams = recorded_streams(run_dir, list(TOPICS))
            run = RunDocument(os.getppid(), core, record, streams, run_metadata(config))
            _run(kind, config, run, run_dir, stop, engages_itself=kind == "device")
            return 0
        run = RunDocument.read(run_dir)
        realtime.die_with_parent(signal.SIGTERM if kind in FINISHERS else signal.SIGKILL)
        try:
            if _has_launcher(run):  # it may have died before the line above
                config = from_document(json.loads(file.read_text(encoding="utf-8")))
                _run(kind, config, run, run_dir, stop, engages_itself=False)
        except ConfigError:
            raise
        except Exception:
            _logger.exception("%s failed", kind)
            return 1
        finally:
            if not _has_launcher(run):
                shutil.rmtree(run_dir, ignore_errors=True)
        return 0


def check_run_directory(run_dir: Path) -> None:
    """Refuse a run directory that others may enter: its sockets have no other lock.

    Raises:
        ConfigError: If it is another user's, or open to others.
    """
    status = run_dir.stat()
    if status.st_uid != os.geteuid():
        raise ConfigError(f"the run directory {run_dir} belongs to another user: mkdir -m 700 one")
    if status.st_mode & 0o077:
        mode = stat.S_IMODE(status.st_mode)
        raise ConfigError(
            f"others may enter the run directory {run_dir} (mode {mode:04o}) and command forces: "
            f"chmod 700 {run_dir}"
        )


def _run(
    kind: str,
    config: GraphConfig,
    run: RunDocument,
    run_dir: Path,
    stop: process.Stop,
    engages_itself: bool,
) -> None:
    if kind == "recorder":
        _record(run, run_dir, stop)
        return
    settings = realtime.Settings(
        policy=config.realtime.policy,
        core=run.core,
        lock_memory=config.realtime.lock_memory,
        spin_ns=round(config.realtime.spin * 1e9),
    )
    node = build_node(kind, config, environment_name())
    links = build_links(config)  # a perfect link needs no model: its socket keeps the newest
    reloader = Reloader(config, run_dir / LAUNCH_FILE)
    status = process.run(node, kind, run_dir, links, settings, stop, engages_itself, reloader)
    if status["rejected"]:
        _logger.warning("refused packets, by reason: %s", status["rejected"])


def _record(run: RunDocument, run_dir: Path, stop: process.Stop) -> None:
    offset_ns = time.time_ns() - time.monotonic_ns()
    _logger.info("recording to %s", run.record)
    recorder = Recorder(run.record, run.metadata, offset_ns)
    try:
        streams = [(topic, endpoint) for topic, endpoint in run.streams]
        status = process.record(recorder, "recorder", run_dir, streams, run.core, stop)
    finally:
        with suppress(OSError):  # a full disk: it has been said, and what is there can be read
            recorder.close()
    if status["rejected"]:
        _logger.warning("refused packets, by reason: %s", status["rejected"])


def environment_name() -> str:
    """Return a name that no other environment process has."""
    return f"{socket.gethostname()[:32]}/{os.getpid()}/{os.urandom(4).hex()}"


def _has_launcher(run: RunDocument) -> bool:
    return os.getppid() == run.launcher
