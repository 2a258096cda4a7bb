"""Contestants of a benchmark as processes, and the conditions of the machine.

Each contestant is a process. It writes its times to standard output as int64
(:meth:`Stopwatch.write_times`); the last three numbers are the misses, the processor time and the
elapsed time, both in ns.
"""

import contextlib
import os
import platform
import shutil
import signal
import subprocess
import sys
import time
from array import array
from collections.abc import Iterator, Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import Any

from forcebound.benchmark.figures import Measured
from forcebound.errors import RunError
from forcebound.processes import PROCESSES
from forcebound.realtime import Settings, die_with_parent

WARMUP = 100  # ticks of each round before the first that counts
READY = 60.0  # s for the processes of a contestant to start and find each other, on a busy machine
TIMEOUT_NS = 100_000_000  # an answer that takes longer counts as lost
_GRACE = 10.0  # s beyond its planned duration before a contestant counts as hung


def enter_contestant() -> None:
    """Let this process end with the benchmark that started it, also on Ctrl-C there."""
    die_with_parent(signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


class Stopwatch:
    """Processor time and elapsed time of one round, from the creation of the object."""

    def __init__(self) -> None:
        self._processor_ns, self._began_ns = time.process_time_ns(), time.monotonic_ns()

    def write_times(self, times_ns: Sequence[int], missed: int) -> None:
        """Write the results of the round for the benchmark that started this process."""
        processor_ns = time.process_time_ns() - self._processor_ns
        elapsed_ns = time.monotonic_ns() - self._began_ns
        values = array("q", [*times_ns, missed, processor_ns, elapsed_ns])
        sys.stdout.buffer.write(values.tobytes())
        sys.stdout.buffer.flush()


def read_times(data: bytes, measured: Measured) -> None:
    """Add the output of :meth:`Stopwatch.write_times` to ``measured``.

    Raises:
        RunError: If ``data`` is not such a row of numbers.
    """
    values = array("q")
    if len(data) % values.itemsize or len(data) < 3 * values.itemsize:
        raise RunError(f"a benchmark process answered with {len(data)} bytes instead of times")
    values.frombytes(data)
    *times_ns, missed, processor_ns, elapsed_ns = values.tolist()
    measured.add(times_ns, missed, processor_ns, elapsed_ns)


def module(name: str, *arguments: object) -> list[str]:
    """Return the command that runs ``forcebound.benchmark.<name>`` in this interpreter."""
    return [sys.executable, "-m", f"forcebound.benchmark.{name}", *map(str, arguments)]


@contextlib.contextmanager
def started(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process during the body and end it with the body in any case."""
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        process_group=0,  # Ctrl-C reaches the benchmark alone, which ends it
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def collect(command: list[str], duration: float, measured: Measured) -> None:
    """Run a contestant to its end and add its times to ``measured``.

    Args:
        command: The process.
        duration: How long it is meant to take, in s.
        measured: Takes the times.

    Raises:
        RunError: If it failed or hung.
    """
    with started(command) as process:
        try:
            output, _ = process.communicate(timeout=duration + _GRACE)
        except subprocess.TimeoutExpired:
            raise RunError(
                f"{_name(command)} was meant to take {duration:.1f} s and did not end "
                f"{_GRACE:.0f} s later"
            ) from None
    if process.returncode:
        raise RunError(f"{_name(command)} ended with status {process.returncode}")
    read_times(output, measured)


def _name(command: list[str]) -> str:
    return " ".join(command[1:3] if command[0] == sys.executable else command[:1])


def compile_c(source: str, folder: Path, name: str = "", flags: Sequence[str] = ("-O2",)) -> Path:
    """Compile a C file of this package and return the program or library.

    Args:
        source: Name of the file.
        folder: Folder for the result.
        name: Name of the result; empty: that of the file, without its ending.
        flags: Options of the compiler.

    Raises:
        RunError: If there is no C compiler, or if it fails.
    """
    target = folder / (name or Path(source).stem)
    command = [compiler(), *flags, "-o", str(target)]
    with resources.as_file(resources.files("forcebound.benchmark").joinpath(source)) as path:
        built = subprocess.run([*command, str(path), "-lm"], capture_output=True, text=True)
    if built.returncode:
        raise RunError(f"{command[0]} could not build {source}:\n{built.stderr.strip()}")
    return target


def compiler() -> str:
    """Return the path of a C compiler.

    Raises:
        RunError: If there is none.
    """
    path = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if path is None:
        raise RunError("no C compiler (gcc, cc, clang) on PATH; for example: apt install gcc")
    return path


def permitted_policies() -> list[str]:
    """Return the scheduling classes that this process may use, ``"other"`` first."""
    priority = max(process.priority for process in PROCESSES.values())
    command = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({priority}))"
    tried = subprocess.run([sys.executable, "-c", command], capture_output=True)
    return ["other"] if tried.returncode else ["other", "fifo"]


def conditions(settings: Settings | None = None) -> dict[str, Any]:
    """Return the conditions of the figures: machine, kernel, versions, permissions, load.

    With ``settings``, also the real-time settings of the contestants.
    """
    chosen: dict[str, Any] = {}
    if settings is not None:
        chosen = {"core": settings.core, "policy_asked": settings.policy}
        chosen["deep_sleep"] = settings.deep_sleep
    return chosen | {
        "cores": sorted(os.sched_getaffinity(0)),
        "kernel": f"{platform.system()} {platform.release()} {platform.machine()}",
        "policies": permitted_policies(),
        "load_average": round(os.getloadavg()[0], 2),
        "python": platform.python_version(),
        "pyzmq": metadata.version("pyzmq"),
        "forcebound": metadata.version("forcebound"),
    }
