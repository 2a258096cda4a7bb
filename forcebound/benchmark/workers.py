"""Contestants of a benchmark as processes, and the conditions of the machine.

Each contestant is a process that is started and ended by its handle. It writes its times to
standard output as int64 (:func:`write_times`); the last three are the number of misses, the
processor time and the elapsed time, both in ns.
"""

import contextlib
import os
import platform
import shutil
import subprocess
import sys
from array import array
from collections.abc import Iterator, Sequence
from importlib import metadata, resources
from pathlib import Path
from typing import Any

from forcebound.benchmark.figures import Measured
from forcebound.errors import RunError
from forcebound.processes import PROCESSES

WARMUP = 100  # ticks of each round before the first that counts
READY = 10.0  # s for the processes of a contestant to start and find each other
TIMEOUT_NS = 100_000_000  # an answer that takes longer counts as lost
_GRACE = 10.0  # s beyond its planned duration before a contestant counts as hung


def write_times(times_ns: Sequence[int], missed: int, processor_ns: int, elapsed_ns: int) -> None:
    """Hand the results of one round to the benchmark that started this process."""
    values = array("q", [*times_ns, missed, processor_ns, elapsed_ns])
    sys.stdout.buffer.write(values.tobytes())
    sys.stdout.buffer.flush()


def read_times(data: bytes, measured: Measured) -> None:
    """Add what :func:`write_times` wrote to ``measured``.

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


def compile_c(source: str, folder: Path) -> Path:
    """Compile a C file of this package with ``cc -O2`` and return the program.

    Raises:
        RunError: If there is no C compiler or it refused.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise RunError(
            f"no C compiler (cc, gcc, clang) on PATH to build the limit {source}; "
            "install one, for example with: apt install gcc"
        )
    program = folder / Path(source).stem
    with resources.as_file(resources.files("forcebound.benchmark").joinpath(source)) as path:
        built = subprocess.run(
            [compiler, "-O2", "-o", str(program), str(path)], capture_output=True, text=True
        )
    if built.returncode:
        raise RunError(f"{compiler} could not build {source}:\n{built.stderr.strip()}")
    return program


def permitted_policies() -> list[str]:
    """Return the scheduling classes that this process may use, ``"other"`` first."""
    priority = max(process.priority for process in PROCESSES.values())
    command = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({priority}))"
    tried = subprocess.run([sys.executable, "-c", command], capture_output=True)
    return ["other"] if tried.returncode else ["other", "fifo"]


def conditions() -> dict[str, Any]:
    """Return on what the figures depend: machine, kernel, versions, permissions, load."""
    return {
        "cores": sorted(os.sched_getaffinity(0)),
        "kernel": f"{platform.system()} {platform.release()} {platform.machine()}",
        "policies": permitted_policies(),
        "load_average": round(os.getloadavg()[0], 2),
        "python": platform.python_version(),
        "pyzmq": metadata.version("pyzmq"),
        "forcebound": metadata.version("forcebound"),
    }
