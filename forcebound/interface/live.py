"""A live graph: real processes in real time, started and ended from Python."""

import atexit
import json
import shutil
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from forcebound.ending import end
from forcebound.errors import ConfigError, RunError
from forcebound.extras import check_installed
from forcebound.files import recording_file
from forcebound.graph.graph import KINDS, GraphConfig
from forcebound.graph.resolved import to_document
from forcebound.interface.figures import Figures
from forcebound.interface.runs import LaunchFile, Run, configuration, split, time_of
from forcebound.messages.control import (
    EpisodeAction,
    Episodes,
    GetStatus,
    LauncherStatus,
    Point,
    Pointed,
    Refused,
)
from forcebound.observe import tuning
from forcebound.observe.control import ask, chosen_hand
from forcebound.observe.episodes import mark
from forcebound.observe.kernels import Kernels
from forcebound.observe.runs import launched
from forcebound.roles import DEVICE, LAUNCHER
from forcebound.run import fork_server
from forcebound.run.results import results_of
from forcebound.run.run_directory import graph_in
from forcebound.stop import INTERRUPTED
from forcebound.units import parse_quantity

UNTIL_ENDED = 86_400.0  # s; a graph without a duration runs until its block ends, at most a day
END_TIMEOUT = 20.0  # s for zero force, the last packets and the result
POLL = 0.02  # s
FIRST_SAMPLES = 5.0  # s to wait for them
RUNNING = "running"  # phase of a launcher whose force is engaged

_ELSEWHERE = (
    "a live graph consists of processes that cannot see an object of this one; keep its class in a"
    " file and name that, 'my_file.py', or use a package"
)


_servers: list[fork_server.ForkServer] = []  # of this program, which has one


def server() -> fork_server.ForkServer:
    """Return the server of this program, which is started when it is first asked for."""
    if not _servers:
        _servers.append(fork_server.started())
        atexit.register(end_server)
    return _servers[0]


def _launcher(command: Sequence[str], log: int) -> fork_server.Launched:
    try:
        return server().launch(command, log)
    except OSError as error:
        end_server()
        raise RunError(f"the graph cannot be started: {error.strerror}") from error


def end_server() -> None:
    """End the process that this program keeps for its next launch; its graphs go on."""
    while _servers:
        _servers.pop().close()


class Page(NamedTuple):
    """The live page of a graph; a notebook shows it in its cell."""

    address: str  # with the token: who has it may change the graph
    height: int = 720  # pixels, in a notebook

    def _repr_html_(self) -> str:
        style = f"width: 100%; height: {self.height}px; border: 1px solid #ccc"
        return f'<iframe src="{self.address}" style="{style}"></iframe>'


class Running:
    """A running graph; leaving its block ends it, with zero force in any case.

    Without ``records`` it has no figures.

    Attributes:
        run_dir: Its run directory, for the commands' ``--run``.
    """

    def __init__(
        self, command: list[str], record: Path | None, folder: Path, records: bool = True
    ) -> None:
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self._recording = folder / "run.mcap" if record is None else record
        self._log = folder / "log"
        self._result: Run | None = None
        self._view: subprocess.Popen[str] | None = None
        recorded = ["--record", str(self._recording)] if records else []
        with self._log.open("wb") as log:
            self._process = _launcher([*command, *recorded], log.fileno())
        try:
            self.run_dir = self._await_force()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "Running":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
        if kind is None:
            self._check()

    @property
    def is_running(self) -> bool:
        """True while the graph runs."""
        return self._process.poll() is None

    @property
    def log(self) -> str:
        """Log of its processes so far."""
        return self._log.read_text(errors="replace")

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters that can be changed, by name, with their present values in SI units."""
        self._check_runs()
        return tuning.find_parameters(tuning.configuration(self.run_dir), ())

    def set(self, name: str, value: Any) -> None:
        """Change a parameter, as ``forcebound param set`` does; return when it has effect.

        Args:
            name: Such as ``"links.environment_query.delay"`` or ``"device.law"``.
            value: A number in SI units, or text with its unit.

        Raises:
            ConfigError: If there is no such parameter, or it cannot have this value.
            RunError: If the graph has ended, or a node does not answer.
        """
        self._check_runs()
        with closing(Kernels(self.run_dir)) as kernels:
            tuning.set_parameters(self.run_dir, {name: value}, kernels)

    def episode(self, action: EpisodeAction) -> Episodes:
        """Start an episode of the recording, or keep or discard the open one.

        At a start and after a discard the world begins again, and the force comes back over
        ``engage_time``; so it does for ``forcebound episode``. The hand stays where it is: bring
        it back first.

        Args:
            action: ``"start"``, ``"keep"`` or ``"discard"``.

        Returns:
            How many were begun and kept, and whether one is open.

        Raises:
            ConfigError: If one is open at a start, none at an end, or there is no such action.
            RunError: If the graph has ended, or the world does not begin again.
        """
        self._check_runs()
        return mark(self.run_dir, action)

    def point(self, target: Sequence[float], hand: str | None = None) -> tuple[float, ...]:
        """Move the pointer that a simulated hand follows, of ``operator: {kind: pointer}``.

        Args:
            target: Where, in m, of 1 to all axes; the others stay.
            hand: Its name; None: the only one.

        Returns:
            Where the pointer is now, in m, within the hand's reach.

        Raises:
            ConfigError: If no hand follows a pointer there, or it is no such place.
            RunError: If the graph has ended, or the device does not answer.
        """
        self._check_runs()
        device = graph_in(self.run_dir).of_role(DEVICE, chosen_hand(self.run_dir, hand))
        answer = ask(self.run_dir, device, Point(tuple(map(float, target))))
        if isinstance(answer, Refused):
            raise ConfigError(answer.error)
        if not isinstance(answer, Pointed):
            raise RunError(f"{device} does not answer")
        return answer.target

    def wait(self, seconds: float | str) -> None:
        """Let time pass; return earlier if the graph ends by itself, RunError if it fails."""
        until = time.monotonic() + parse_quantity(seconds, "s")
        while self.is_running and (left := until - time.monotonic()) > 0.0:
            time.sleep(min(left, POLL))
        self._check()

    def page(self, height: int = 720) -> Page:
        """Return the live page of this graph, which ends with it.

        As the last line of a cell it is shown below the cell, if the browser is on this machine.

        Args:
            height: Of the page in a notebook, in pixels.

        Raises:
            ConfigError: If tornado is not installed.
            RunError: If the graph has ended.
        """
        self._check_runs()
        check_installed("the page", "tornado")
        words = ["view", "--launcher", str(self._process.pid), "--no-open", "--embed"]
        self._close_page()
        self._view = subprocess.Popen(
            [sys.executable, "-u", "-m", "forcebound", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C is for the notebook
        )
        assert self._view.stdout is not None
        line = self._view.stdout.readline()
        if not line:
            raise RunError("the page cannot be shown: the graph has ended")
        return Page(line.split()[-1], height)

    def _close_page(self) -> None:
        if self._view is not None:
            self._view.terminate()
            self._view.communicate()
            self._view = None

    def figures(self, last: float | str | None = None) -> Figures:
        """Return the figures so far, or those of the ``last`` seconds, as :meth:`Run.last`.

        Of several hands, ``graph.run.hands["left"].figures`` are those of one.

        The last quarter of a second may be missing, on a busy machine more.
        """
        run = self.run
        return run.figures if last is None else run.last(last).figures

    @property
    def run(self) -> Run:
        """The run: all of it once it has ended, until then what is recorded so far."""
        if self._result is not None:
            return self._result
        has_ended = not self.is_running
        end = time.monotonic() + FIRST_SAMPLES
        while True:
            try:
                results = results_of(self._recording, is_growing=not has_ended)
                break
            except ConfigError:  # the recorder has not written its first samples yet
                if has_ended or time.monotonic() > end:
                    raise
                time.sleep(POLL)
        run = Run(results, self._recording, self)
        if has_ended:
            self._result = run
        return run

    def close(self) -> None:
        """End the graph, with zero force first, and its page; no error if it has ended."""
        self._process.stdin.close()
        try:
            self._process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            end(self._process, END_TIMEOUT)
        self._close_page()

    def _check_runs(self) -> None:
        self._check()
        if not self.is_running:
            raise RunError("the graph has ended")

    def _check(self) -> None:
        """Raise what the command says if it failed."""
        status = self._process.poll()
        # Interrupted: ended here while it computed figures that nobody reads.
        if status in (None, 0, INTERRUPTED):
            return
        lines = [line for line in self.log.splitlines() if line.startswith("forcebound: ")]
        at = self.log.rfind(lines[-1]) if lines else 0
        words = self.log[at:].removeprefix("forcebound: ").strip()
        raise (ConfigError if status == 2 else RunError)(words or f"it ended with status {status}")

    def _await_force(self) -> Path:
        """Return the run directory once the force is engaged."""
        while self.is_running:
            run_dir = launched(self._process.pid)
            if run_dir is not None:
                answer = ask(run_dir, LAUNCHER, GetStatus(), timeout=1.0)
                if isinstance(answer, LauncherStatus) and answer.phase == RUNNING:
                    return run_dir
            time.sleep(POLL)
        self._check()
        raise RunError("the graph has ended before its force engaged")


def launch(
    launch: LaunchFile,
    *,
    duration: float | str | None = None,
    record: str | Path | None = None,
    **arguments: Any,
) -> Running:
    """Start a launch file in real time, as ``forcebound launch`` does; return when it has force.

    ::

        with forcebound.launch("stiff_wall") as graph:
            graph.set("links.environment_query.delay", "20 ms")
            graph.wait(2)
            graph.figures()

    The graph consists of other processes, so this works in a thread and in a notebook. It ends with
    zero force when the block is left, and when this program ends in any other way.

    Args:
        launch: A :class:`forcebound.Graph`; or a launch file: a path, the name of one that comes
            with forcebound, or its content.
        duration: After which it ends by itself, in s or with its unit; default: with the block.
        record: Recording to keep, ``.mcap``; one that exists is replaced.
        arguments: Values for the file's arguments: text with its unit, or a number in SI units.

    Raises:
        ConfigError: If the launch file or an argument is wrong, or an argument is an object: the
            processes of a live graph need a file or a package that has it.
        RunError: If a process did not become ready.
    """
    parts, texts = split(arguments)
    if parts:
        raise ConfigError(f"{', '.join(parts)}: {_ELSEWHERE}")
    seconds = UNTIL_ENDED
    if duration is not None:
        seconds = time_of("duration", duration)
    folder = Path(tempfile.mkdtemp(prefix="forcebound-python-"))
    if not isinstance(launch, str | Path):
        config = configuration(launch, arguments)
        _check_elsewhere(config)
        launch, texts = _written(config, folder), []
    command = ["launch", str(launch), *texts, "--duration", repr(seconds), "--overwrite"]
    return Running(command, None if record is None else recording_file(Path(record)), folder)


def launch_unrecorded(config: GraphConfig) -> Running:
    """Start a graph in real time, for its ``duration``. Errors are as of :func:`launch`."""
    folder = Path(tempfile.mkdtemp(prefix="forcebound-python-"))
    file = _written(config, folder)
    command = ["launch", str(file), "--duration", repr(config.duration)]
    return Running(command, None, folder, records=False)


def _written(config: GraphConfig, folder: Path) -> Path:
    file = folder / "launch.yaml"
    file.write_text(json.dumps(to_document(config)))
    return file


def _check_elsewhere(config: GraphConfig) -> None:
    """Raise ConfigError for a part whose class only this process has."""
    parts = {"environment": config.environment.model}
    for hand in config.hands.values():
        own = {"device": hand.device, "operator": hand.operator, "controller": hand.controller}
        for section, part in (parts | own).items():
            if KINDS[section].kind_of(type(part)) in KINDS[section].added:
                raise ConfigError(f"{section} {type(part).__name__}: {_ELSEWHERE}")
