"""How soon the guardian of a serial device writes zero force.

A process writes a force to a pseudo-terminal each millisecond, as a driver does. Then it is killed
(-9), stopped, or hangs, and the other side of the terminal notes when zero force comes: within 20
ms from the signal, or from the last force of a process that hangs. `in a graph`: the device process
of `forcebound launch haply_2diy` is killed in contact, until zero torque at the emulated board.
"""

import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.harness import Contestant, Result, alternate, at
from forcebound.errors import DeviceError
from forcebound.haptics.devices.truth_file import TruthFile
from forcebound.messages.control import GetStatus
from forcebound.messages.topology import ONE_HAND
from forcebound.observe.control import ask_launcher
from forcebound.observe.measure import Round, Timing
from forcebound.roles import LAUNCHER

DURATION = 60.0
ASKED = "zero force after the device process of a graph was killed"
IN_GRAPH = "killed in a graph"
ROOT = Path(__file__).parent.parent
TARGET = 0.020  # s
FORCE, ZERO = b"force...", b"no force"
FORCES = 50  # before its fate
TIMEOUT_S = 10.0  # s
LOOK = 1e-3  # s, between two looks at the emulator's record
ATTEMPTS = 20
QUIET_S = 0.1  # s without any further message after zero force

PROGRAM = f"""
import signal, sys, time
from forcebound.errors import DeviceError
from forcebound.hardware.guardian import Guardian
from forcebound.hardware.port import Port

port = Port(sys.argv[1])
guardian = Guardian(port.descriptor, {ZERO!r})
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
    """Run the benchmark, each way to die once a second of its share of ``duration``."""
    contestants: dict[str, Contestant] = {fate: partial(_dies, fate) for fate in FATES}
    contestants[IN_GRAPH] = _dies_in_a_graph
    found = alternate(duration, rate, contestants)
    return found, [at(one, "max", 1e6 * TARGET, one.label == IN_GRAPH) for one in found]


def _dies(fate: str, _: Timing) -> Round:
    return Round([round(1e9 * watch(fate).seconds)])


def _dies_in_a_graph(_: Timing) -> Round:
    return Round([round(1e9 * watch_graph())])


class Fate(NamedTuple):
    """What became of a force.

    Attributes:
        messages: After the signal, or after the last force of a process that hangs.
        seconds: Until zero force came, in s; inf: it never did.
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
    arguments = (os.ttyname(slave), str(FORCES if ending is None else 1_000_000))
    process = subprocess.Popen([sys.executable, "-c", PROGRAM, *arguments], cwd=ROOT)
    try:
        if any(_message(board, TIMEOUT_S) != FORCE for _ in range(FORCES)):
            return None
        start = time.monotonic()
        if ending is not None:
            process.send_signal(ending)
        messages, seconds, timeout_s = [], float("inf"), TIMEOUT_S
        while message := _message(board, timeout_s):
            messages.append(message)
            if message == ZERO:
                seconds, timeout_s = time.monotonic() - start, QUIET_S
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


def watch_graph() -> float:
    """Kill the device process of a graph in contact; return when the torque was zero, in s.

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
                return _seconds_to_zero(Path(folder), launch)
            except (ChildProcessError, DeviceError):  # it has ended, or so has its emulator
                pass
            finally:
                launch.send_signal(signal.SIGINT)
                launch.wait()
    raise TimeoutError("no graph came into contact: this machine is too busy")


def _seconds_to_zero(folder: Path, launch: "subprocess.Popen[bytes]") -> float:
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
    os.kill(device, signal.SIGKILL)
    end = time.monotonic() + TIMEOUT_S
    while has_torque() and time.monotonic() < end:
        select.select((), (), (), LOOK)
    found = truth.look()
    truth.close()
    assert found is not None
    return float("inf") if any(found.torque) else (found.torque_ns - start_ns) * 1e-9


def _awaited(look: Callable[[], Any], launch: "subprocess.Popen[bytes]") -> Any:
    """Return the first result that is true; ChildProcessError if the graph ends before."""
    while not (found := look()):
        if launch.poll() is not None:
            raise ChildProcessError("the graph has ended")
        select.select((), (), (), LOOK)
    return found
