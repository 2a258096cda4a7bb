"""A live graph for tests of faults: start, wait for contact, disturb, read the recording.

Nothing here decides by the timing of the machine. What must hold is read from the recording, in the
device's own telemetry; the waits are bounded and only end a test that hangs.
"""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from addresses import LAUNCHERS
from click.testing import CliRunner, Result
from numpy.typing import NDArray
from waiting import TIMEOUT

from forcebound.cli import main
from forcebound.errors import RunError
from forcebound.interface import live
from forcebound.messages.codec import decode
from forcebound.messages.control import GetStatus, LauncherStatus, ProcessState
from forcebound.messages.packets import Event, Telemetry
from forcebound.messages.topology import endpoint
from forcebound.network import sockets
from forcebound.network.sockets import Network
from forcebound.observe.control import ask_launcher
from forcebound.recordings.recording import Recording, read
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.run.fork_server import Launched
from forcebound.run.run_directory import TELEMETRY, graph_in

AGE_LIMIT = 0.1  # s, of the shipped launch files
ENGAGE_TIME = 0.1  # s
STIFFNESS = 10_000.0  # N/m
SURFACE = 0.010  # m
SATURATION = 8.5  # N, of the simulated device
HARD = 1.0  # N, asked for by a wall that is pressed. How much of it a hand gets is the law's, and
#             after a fault it is little: a hand at rest deep in the wall has no energy to get back
SLACK = 0.01  # s from the harm's system call to its effect on the other process

#: Marks of tests that come one after the other, and of whose work coverage would measure nothing.
PROCESSES_OF_THEIR_OWN = [
    pytest.mark.live,
    pytest.mark.xdist_group("processes"),
    pytest.mark.no_cover,
]


class LiveGraph:
    """``forcebound launch`` as a process of its own, in contact; made by :func:`live_graph`.

    Attributes:
        process: The launcher.
        record: The recording, to be read after :meth:`end`.
        run_dir: The run directory.
    """

    def __init__(
        self,
        folder: Path,
        words: tuple[str, ...],
        prefix: Sequence[str] | None = None,
        variables: Mapping[str, str] | None = None,
    ) -> None:
        self.folder = folder
        self.variables = {"XDG_RUNTIME_DIR": str(folder), **(variables or {})}
        self.record = folder / "run.mcap"
        self.log_path = folder / "log"
        self._out_path = folder / "out"
        end = ("--duration", "1200 s", "--record", str(self.record), "--json")
        command = ["launch", *words, *end]
        self.process: Launched | subprocess.Popen[bytes]
        with (
            self.log_path.open("wb") as log,
            self._out_path.open("wb") as out,
            pytest.MonkeyPatch.context() as patch,
        ):
            for name, value in self.variables.items():
                patch.setenv(name, value)
            if prefix is None:
                self.process = live.server().launch(command, log.fileno(), out.fileno())
            else:
                self.process = subprocess.Popen(
                    [*prefix, sys.executable, "-m", "forcebound", *command],
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=log,
                )

    @property
    def log(self) -> str:
        """What the launcher and its processes have said."""
        return self.log_path.read_text(errors="replace")

    @property
    def run_dir(self) -> Path:
        [run_dir] = (path.parent for path in self.runtime.glob(LAUNCHERS))
        return run_dir

    @property
    def runtime(self) -> Path:
        """Folder of run directories."""
        return Path(self.variables["XDG_RUNTIME_DIR"])

    def until(self, happened: Callable[[], object], what: str) -> None:
        """Wait until something happened, in bounded time, while the launcher lives.

        A status that a busy machine answers late means "not yet".
        """
        end = time.monotonic() + TIMEOUT

        def has_happened() -> object:
            with suppress(RunError):
                return happened()
            return False

        while not has_happened():
            assert self.process.poll() is None, f"the run ended; its log:\n{self.log}"
            assert time.monotonic() < end, f"waited {TIMEOUT} s for {what}; log:\n{self.log}"
            sockets.wait((), 20_000_000)

    def status(self) -> LauncherStatus:
        """Return what the launcher says of its processes."""
        return ask_launcher(self.run_dir, GetStatus())

    def node(self, name: str) -> ProcessState:
        """Return state, process id and number of restarts of one process."""
        return self.status().nodes[name]

    def pid(self, name: str) -> int:
        """Return the process id of one process, which runs."""
        pid = self.node(name).pid
        assert pid is not None
        return pid

    def signal(self, name: str, number: int) -> None:
        """Send a signal to one process of the graph."""
        os.kill(self.pid(name), number)

    def wait_until_engaged(self) -> None:
        """Wait until the launcher says that the force is engaged."""
        self.until(lambda: list(self.runtime.glob(LAUNCHERS)), "the launcher")
        self.until(lambda: self.status().phase == "running", "an engaged force")

    def wait_until_forced(self) -> None:
        """Wait until the device has been asked for a force."""
        self.wait_until_engaged()
        self.wait_for_telemetry(lambda t: any(t.commanded_force), "a force")

    def wait_until_in_contact(self) -> None:
        """Wait until the hand presses into a wall whose force is wholly engaged."""
        self.wait_until_engaged()
        self.wait_for_telemetry(
            lambda t: t.engagement == 1.0 and abs(t.commanded_force[0]) > HARD, "contact"
        )

    def wait_until_released(self) -> None:
        """Wait until the device says that it has no answer to use."""
        self.wait_for_telemetry(lambda t: t.device_seq is None, "zero force")

    def wait(self, seconds: float) -> None:
        """Let some time of the device pass."""
        begin: list[int] = []

        def passed(telemetry: Telemetry) -> bool:
            begin.append(telemetry.time_ns)
            return telemetry.time_ns - begin[0] >= seconds * 1e9

        self.wait_for_telemetry(passed, f"{seconds} s to pass")

    def wait_for_telemetry(self, accepts: Callable[[Telemetry], bool], what: str) -> None:
        """Wait for telemetry of a certain kind."""
        with Network() as network:
            [stream] = (s for s in graph_in(self.run_dir).streams if s.topic == TELEMETRY)
            subscriber = network.subscriber(endpoint(self.run_dir, stream))

            def came() -> bool:
                packets = [decode(data) for data in subscriber.receive()]
                return any(accepts(packet) for packet in packets if isinstance(packet, Telemetry))

            self.until(came, what)

    def order(self, *words: str) -> Result:
        """Run another command of forcebound on the graph, in this process."""
        return CliRunner().invoke(main, words, env=self.variables, catch_exceptions=False)

    def do(self, *words: str) -> Result:
        """Run another command on the graph, which must succeed."""
        done = self.order(*words, "--run", str(self.run_dir))
        assert done.exit_code == 0, done.stderr
        return done

    def end(self, timeout: float = TIMEOUT) -> "Ended":
        """Interrupt the run as Ctrl-C does; return what it leaves."""
        self.process.send_signal(signal.SIGINT)
        status, out = self.outcome(timeout)
        assert "Traceback" not in self.log, self.log
        return Ended(status, out, self.log, self.record)

    def outcome(self, timeout: float = TIMEOUT) -> tuple[int, str]:
        """Wait for the end of the launcher; return its status and its output."""
        status = self.process.wait(timeout)
        return status, self._out_path.read_text()


class Ended:
    """What a run has left; of its recording, which goes with its folder, columns and events."""

    def __init__(self, exit_status: int, out: str, log: str, record: Path) -> None:
        self.exit_status = exit_status
        self.log = log
        self.summary: dict[str, Any] = json.loads(out) if exit_status == 0 else {}
        self.recording: Recording = read(record)
        self.columns: TelemetryColumns
        self.columns, self._events = self.recording.run

    @property
    def served(self) -> set[str]:
        """Names of the environments that have served; no recorder joins too late for the log."""
        return set(re.findall(r"environment (\S+) serves now", self.log))

    @property
    def faults(self) -> dict[str, int]:
        faults: dict[str, int] = self.summary["faults"]
        return faults

    def events(self, kind: str) -> list[Event]:
        """Return the events of a kind that were recorded."""
        return [event for event in self._events if event.event == kind]


@contextmanager
def live_graph(
    *words: str,
    prefix: Sequence[str] | None = None,
    variables: Mapping[str, str] | None = None,
    is_alone: bool = True,
) -> Iterator[LiveGraph]:
    """Start a graph and wait for contact; afterwards nothing of it is left.

    Args:
        words: Launch file and arguments.
        prefix: In front of its command line, as an interpreter of its own; None: it is forked.
        variables: Of its environment.
        is_alone: Whether it comes into contact without anybody's help; else that is not waited for.
    """
    with tempfile.TemporaryDirectory(prefix="fb-") as folder:
        graph = LiveGraph(Path(folder), words, prefix, variables)
        try:
            if is_alone:
                graph.wait_until_in_contact()
            yield graph
        finally:
            children = children_of(graph.process.pid)
            graph.process.kill()  # the others die with it
            graph.process.wait(TIMEOUT)
            if graph.process.stdin is not None:
                graph.process.stdin.close()
            sys.stderr.write(graph.log)  # which pytest shows if the test fails
            for pid in children:
                with suppress(ProcessLookupError):  # what stands still must go on to end
                    os.kill(pid, signal.SIGCONT)
            end = time.monotonic() + TIMEOUT
            while any(map(is_alive, children)):
                assert time.monotonic() < end, "a process of the run is left"
                sockets.wait((), 10_000_000)


def children_of(pid: int) -> set[int]:
    """Return the process ids of the living children of a process."""
    children = set()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid and fields[0] != "Z":
            children.add(int(entry.name))
    return children


def is_alive(pid: int) -> bool:
    """Return whether a process runs."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def check_always(columns: TelemetryColumns, is_attacked: bool = False) -> None:
    """Check what must hold in every sample of every run with a certified law.

    Args:
        columns: Of the run.
        is_attacked: Whether forces were asked for that are not those of the wall.
    """
    force = np.abs(columns.applied_force[:, 0])
    assert columns.true_energy.min() >= -1e-9
    answered = columns.device_seq >= 0
    assert not force[~answered].any(), "force without an answer"
    assert columns.loop_delay[answered].max() <= AGE_LIMIT, "force from a state that is too old"
    assert (force <= np.abs(columns.commanded_force[:, 0]) * (1 + 1e-12)).all()
    assert force[-1] == 0.0
    for release in np.flatnonzero(answered[1:] & ~answered[:-1]) + 1:
        check_ramp(columns, int(release), is_attacked)


def check_ramp(columns: TelemetryColumns, start: int, is_attacked: bool) -> None:
    """Check that the force that begins to engage at sample ``start`` comes over the ramp."""
    rest = slice(start, None)
    since = (columns.time_ns[rest] - columns.time_ns[start]) * 1e-9
    window = np.flatnonzero(since < ENGAGE_TIME)
    engagement = columns.engagement[rest][window]
    allowed = since[window] / ENGAGE_TIME
    assert engagement[0] == 0.0
    assert (engagement <= allowed + 1e-9).all(), "the ramp is too steep"
    depth = max(
        0.0, float(columns.position[start - 200 if start > 200 else 0 :, 0].max()) - SURFACE
    )
    force = np.abs(columns.applied_force[rest, 0][window])
    highest = SATURATION if is_attacked else min(SATURATION, STIFFNESS * depth)
    assert (force <= engagement * highest + 1e-9).all(), "a jump at the return"


def check_silence(columns: TelemetryColumns, harm_ns: int) -> NDArray[np.int64]:
    """Check that no force outlives a harm by more than the age limit.

    Args:
        columns: Of the run.
        harm_ns: When nobody could answer any more, in ns.

    Returns:
        The samples between force and force.
    """
    answered = columns.device_seq >= 0
    after = np.flatnonzero(columns.time_ns > harm_ns)
    silent = after[~answered[after]]
    assert silent.size, "the harm had no effect"
    first = int(silent[0])
    returns = after[(after > first) & answered[after]]
    assert returns.size, "the force did not return"
    last = int(returns[0])
    late = columns.time_ns > harm_ns + round((AGE_LIMIT + SLACK) * 1e9)
    late[last:] = False
    assert not columns.applied_force[late].any(), "force after the age limit"
    assert not columns.applied_force[first:last].any()
    return np.arange(first, last)


def check_return(columns: TelemetryColumns, gap: NDArray[np.int64]) -> None:
    """Check that the hand is in hard contact again after a gap, and feels it."""
    after = slice(int(gap[-1]) + 1, None)
    contact = np.abs(columns.commanded_force[after, 0]) > HARD
    assert (contact & (columns.engagement[after] == 1.0)).any(), "no contact after the return"
    assert columns.applied_force[after].any(), "no force after the return"
