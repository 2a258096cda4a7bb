"""Benchmark of the guardian: ``python benchmarks/guardian.py [--rounds 20] [--graph] [--json]``.

A process writes a force to a pseudo-terminal each millisecond, as a driver does. Then it is killed
(-9), stopped, or hangs, and the other side of the terminal notes when zero force comes. The target
is 20 ms from the signal, or from the last force of a process that hangs.

With ``--graph`` it is the device process of ``forcebound launch haply_2diy``, killed in contact,
and the time is that of zero torque in the record of the emulated board.
"""

import json
import os
import select
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import click

from forcebound.devices.truth_file import TruthFile
from forcebound.messages.control import GetStatus
from forcebound.monitor.control import ask_launcher

ROOT = Path(__file__).parent.parent
TARGET = 0.020  # s
FORCE, ZERO = b"force...", b"no force"
FORCES = 50  # before its fate
PATIENCE = 10.0  # s
LOOK = 1e-3  # s, between two looks at the emulator's record
ATTEMPTS = 20
AFTERWARDS = 0.1  # s without any further message after zero force

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
    time.sleep({PATIENCE})  # it hangs
    guardian.check()
except DeviceError as error:
    print(error)
guardian.close()
port.close()
"""


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
        if any(_message(board, PATIENCE) != FORCE for _ in range(FORCES)):
            return None
        start = time.monotonic()
        if ending is not None:
            process.send_signal(ending)
        messages, seconds, patience = [], float("inf"), PATIENCE
        while message := _message(board, patience):
            messages.append(message)
            if message == ZERO:
                seconds, patience = time.monotonic() - start, AFTERWARDS
    finally:
        process.kill()
        process.wait()
        os.close(slave)
        os.close(board)
    return Fate(messages, seconds)


def _message(board: int, patience: float) -> bytes:
    """Return the next message; empty if none comes in time."""
    data = b""
    while len(data) < len(FORCE) and select.select((board,), (), (), patience)[0]:
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
            except ChildProcessError:
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
    (run_dir,) = (each.parent for each in folder.glob("*/control-launcher"))
    device = ask_launcher(run_dir, GetStatus()).nodes["device"].pid
    _awaited(has_torque, launch)
    start_ns = time.monotonic_ns()
    assert device is not None  # it runs
    os.kill(device, signal.SIGKILL)
    end = time.monotonic() + PATIENCE
    while has_torque() and time.monotonic() < end:
        select.select((), (), (), LOOK)
    found = truth.look()
    truth.close()
    assert found is not None
    return float("inf") if any(found.torque) else (found.torque_ns - start_ns) * 1e-9


def _awaited(look: Callable[[], Any], launch: "subprocess.Popen[bytes]") -> Any:
    """Return what is found as soon as it is; ChildProcessError if the graph ends before."""
    while not (found := look()):
        if launch.poll() is not None:
            raise ChildProcessError("the graph has ended")
        select.select((), (), (), LOOK)
    return found


@click.command()
@click.option("--rounds", default=20, show_default=True, help="Of each fate.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
@click.option("--graph", "is_graph", is_flag=True, help="Kill that of a whole graph.")
def main(rounds: int, as_json: bool, is_graph: bool) -> None:
    """Measure how soon the guardian writes zero force."""
    if is_graph:
        times = {"killed": sorted(watch_graph() for _ in range(rounds))}
    else:
        times = {fate: sorted(watch(fate).seconds for _ in range(rounds)) for fate in FATES}
    if as_json:
        click.echo(json.dumps(times))
        return
    for fate, seconds in times.items():
        late = sum(each > TARGET for each in seconds)
        click.echo(
            f"{fate:8} median {1e3 * statistics.median(seconds):6.2f} ms, longest"
            f" {1e3 * seconds[-1]:6.2f} ms, later than {1e3 * TARGET:.0f} ms: {late} of {rounds}"
        )


if __name__ == "__main__":
    main()
