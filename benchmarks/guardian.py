"""How soon the guardian of a serial device writes zero force.

A process writes a force to a pseudo-terminal each millisecond, as a driver does. Then it is killed
(-9), stopped, or hangs, and the other side of the terminal notes when zero force comes, counted
from the last force. `in a graph`: the device process of `forcebound launch haply_2diy` is killed or
stopped in contact, from the signal until zero torque at the emulated board. `busy`: beside two
programs for each core that compute without end, at ordinary priority. The target of the largest is
the watchdog limit of `haply_2diy`.
"""

import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.harness import Contestant, Result, alternate, at
from forcebound.errors import DeviceError
from forcebound.graph.loader import load
from forcebound.haptics.devices.truth_file import TruthFile
from forcebound.hardware.line import TIMEOUT
from forcebound.messages.control import GetStatus
from forcebound.messages.topology import ONE_HAND
from forcebound.observe.control import ask_launcher
from forcebound.observe.measure import Round, Timing
from forcebound.roles import LAUNCHER

DURATION = 60.0
ASKED = "zero force after the device process of a graph was killed"
IN_GRAPH = "killed in a graph"
ROOT = Path(__file__).parent.parent
BUSY = 2  # programs for each core
DEATHS = 10
FORCE, ZERO = b"force...", b"no force"
FORCES = 50  # before its fate
TIMEOUT_S = 10.0  # s
LOOK = 1e-3  # s, between two looks at the emulator's record
ATTEMPTS = 20
QUIET_S = 0.1  # s without any further message after zero force

PROGRAM = f"""
import signal, sys, time
from forcebound import realtime
from forcebound.errors import DeviceError
from forcebound.hardware.guardian import Guardian
from forcebound.hardware.port import Port

port = Port(sys.argv[1])
guardian = Guardian(port.descriptor, {ZERO!r}, float(sys.argv[3]))
realtime.enter(realtime.Settings(core=realtime.choose_core("auto")), "device")  # as a device: last
try:
    for count in range(int(sys.argv[2])):
        guardian.beat(time.monotonic_ns())
        guardian.check()
        port.write({FORCE!r})
        guardian.check()
        time.sleep(0.001)
    time.sleep({TIMEOUT_S})  # it hangs
    guardian.check()
except DeviceError as error:
    print(error)
guardian.close()
port.close()
"""


def run(duration: float, rate: float) -> Result:
    """Run the benchmark; a round is ``DEATHS`` processes, or one graph."""
    ways: dict[str, Callable[[], list[float]]] = {fate: partial(_watched, fate) for fate in FATES}
    for fate in ("killed", "stopped"):
        ways[f"{fate} in a graph"] = partial(_watched_in_a_graph, fate)
    contestants: dict[str, Contestant] = {way: partial(_round, ways[way], 0) for way in ways}
    busy = BUSY * len(os.sched_getaffinity(0))
    contestants |= {f"{way}, busy": partial(_round, ways[way], busy) for way in ways}
    found = alternate(duration, rate, contestants)
    return found, [at(one, "max", 1e6 * _limit(), one.label == IN_GRAPH) for one in found]


@cache
def _limit() -> float:
    """Return the watchdog limit that ships, in s."""
    return load("haply_2diy").only.device.longest_force


def _round(way: Callable[[], list[float]], programs: int, _: Timing) -> Round:
    with _computing(programs):
        return Round([round(1e9 * seconds) for seconds in way()])


@contextmanager
def _computing(programs: int) -> Iterator[None]:
    """Let programs compute beside what is measured."""
    with ExitStack() as ended:
        for _ in range(programs):
            one = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            ended.callback(one.wait)
            ended.callback(one.kill)
        yield


def _watched(fate: str) -> list[float]:
    return [watch(fate).seconds for _ in range(DEATHS)]


def _watched_in_a_graph(fate: str) -> list[float]:
    return [watch_graph(fate)]


class Fate(NamedTuple):
    """What became of a force.

    Attributes:
        messages: After the signal, or after the last force of a process that hangs.
        seconds: From the last force until zero force came, in s; inf: it never did.
    """

    messages: list[bytes]
    seconds: float


FATES = {"killed": signal.SIGKILL, "stopped": signal.SIGSTOP, "hangs": None}


def watch(fate: str) -> Fate:
    """Let a process write forces, let its fate happen, and note what comes then.

    On a busy machine the process may be late before; then another one is tried.
    """
    for _ in range(ATTEMPTS):
        if (noted := _try(fate)) is not None:
            return noted
    raise TimeoutError(f"no process wrote {FORCES} forces in time: this machine is too busy")


def _try(fate: str) -> Fate | None:
    ending = FATES[fate]
    board, slave = os.openpty()
    forces = FORCES if ending is None else 1_000_000
    arguments = (os.ttyname(slave), str(forces), str(TIMEOUT * _limit()))
    process = subprocess.Popen([sys.executable, "-c", PROGRAM, *arguments], cwd=ROOT)
    try:
        if any(_message(board, TIMEOUT_S) != FORCE for _ in range(FORCES)):
            return None
        last = time.monotonic()
        if ending is not None:
            process.send_signal(ending)
        messages, seconds, timeout_s = [], float("inf"), TIMEOUT_S
        while message := _message(board, timeout_s):
            messages.append(message)
            if message == ZERO:
                seconds, timeout_s = time.monotonic() - last, QUIET_S
            last = time.monotonic()
    finally:
        process.kill()
        process.wait()
        os.close(slave)
        os.close(board)
    return Fate(messages, seconds)


def _message(board: int, timeout_s: float) -> bytes:
    """Return the next message; empty if none comes in time."""
    data = b""
    while len(data) < len(FORCE) and select.select((board,), (), (), timeout_s)[0]:
        data += os.read(board, len(FORCE) - len(data))
    return data


def watch_graph(fate: str) -> float:
    """End the device process of a graph in contact; return when the torque was zero, in s.

    A graph that a busy machine ends before is replaced by another one.
    """
    command = [sys.executable, "-m", "forcebound", "launch", "haply_2diy", "--json"]
    for _ in range(ATTEMPTS):
        with tempfile.TemporaryDirectory(prefix="fb-") as folder:
            launch = subprocess.Popen(
                command,
                env={**os.environ, "XDG_RUNTIME_DIR": folder},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            try:
                return _seconds_to_zero(Path(folder), launch, FATES[fate])
            except (ChildProcessError, DeviceError):  # it has ended, or so has its emulator
                pass
            finally:
                launch.send_signal(signal.SIGINT)
                launch.wait()
    raise TimeoutError("no graph came into contact: this machine is too busy")


def _seconds_to_zero(folder: Path, launch: "subprocess.Popen[bytes]", ending: int | None) -> float:
    (path,) = _awaited(lambda: list(folder.glob("*.truth")), launch)
    truth = TruthFile(path)

    def has_torque() -> bool:
        found = truth.look()
        return found is not None and any(found.torque)

    _awaited(has_torque, launch)
    (run_dir,) = (each.parent for each in folder.glob(f"*/{ONE_HAND.nodes[LAUNCHER].socket}"))
    device = ask_launcher(run_dir, GetStatus()).nodes["device"].pid
    _awaited(has_torque, launch)
    start_ns = time.monotonic_ns()
    assert device is not None  # it runs
    assert ending is not None
    os.kill(device, ending)
    end = time.monotonic() + TIMEOUT_S
    while has_torque() and time.monotonic() < end:
        select.select((), (), (), LOOK)
    found = truth.look()
    truth.close()
    with suppress(ProcessLookupError):
        os.kill(device, signal.SIGKILL)  # one that is stopped
    assert found is not None
    return float("inf") if any(found.torque) else (found.torque_ns - start_ns) * 1e-9


def _awaited(look: Callable[[], Any], launch: "subprocess.Popen[bytes]") -> Any:
    """Return the first result that is true; ChildProcessError if the graph ends before."""
    while not (found := look()):
        if launch.poll() is not None:
            raise ChildProcessError("the graph has ended")
        select.select((), (), (), LOOK)
    return found
