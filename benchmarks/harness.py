"""The harness of all benchmarks: contestants in turns, their figures, and their targets.

Each benchmark runs its reference in the same run, alternately: on a shared machine the same program
may be five times slower a minute later, but ratios of neighbouring rounds mean something. A bare
loop, which is measured before and after each round, shows how steady the machine was.
"""

import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

import zmq

from forcebound.errors import RunError
from forcebound.observe.measure import Round, Timing, percentile, plan, serving
from forcebound.realtime import Settings, choose_core, permits_fifo

HERE = Path(__file__).parent
STEADY = 1.3  # most that the bare loop may take, in times its quickest median
LOOP_S = 0.25  # s, for which the bare loop is measured between two rounds
MESSAGE = bytes(150)  # as large as a state of one axis
FIRST_ANSWER_MS = 60_000
Contestant = Callable[[Timing], Round]


class BareLoop(NamedTuple):
    """Times of one exchange of the bare loop, in ns.

    The mean notices other programs on the core, which the median hardly does.
    """

    mean_ns: float
    median_ns: float


@dataclass
class Measured:
    """All rounds of one contestant, which ``label`` names in tables.

    Attributes:
        label: Its name.
        rounds: In their order.
        loops: The bare loop before each round and after the last one.
    """

    label: str
    rounds: list[Round] = field(default_factory=list)
    loops: list[BareLoop] = field(default_factory=list)

    def at(self, share: str) -> float:
        """Return a percentile of all rounds together, in ns; see :func:`percentile`."""
        return percentile(self.rounds, share)

    @property
    def missed(self) -> int:
        """Instants of all rounds that were skipped, or had no answer in time."""
        return sum(one.missed for one in self.rounds)

    @property
    def processor_share(self) -> float | None:
        """Share of one processor that it used; None: not measured."""
        elapsed_ns = sum(one.elapsed_ns for one in self.rounds)
        return sum(one.processor_ns for one in self.rounds) / elapsed_ns if elapsed_ns else None


class Figure(NamedTuple):
    """A figure with its target; ``lowest`` and ``highest``: of two neighbouring rounds.

    ``shown`` is what stands after the value on the page; empty: the figure is not on it.
    """

    what: str
    value: float
    unit: str = ""
    target: float | None = None  # None: only for information
    at_least: bool = False  # whether a larger value is better
    lowest: float | None = None
    highest: float | None = None
    shown: str = ""

    @property
    def reached(self) -> bool | None:
        """Whether the target is reached; None: there is none."""
        if self.target is None:
            return None
        return self.value >= self.target if self.at_least else self.value <= self.target


Result = tuple[list[Measured], list[Figure]]


def alternate(
    duration: float, rate: float, contestants: Mapping[str, Contestant], rounds: int | None = None
) -> list[Measured]:
    """Run contestants in turns, for ``duration`` s together; return them in their order.

    Args:
        duration: Without the start of the contestants.
        rate: Of their exchanges, in Hz.
        contestants: By label.
        rounds: Of each; None: about one a second.
    """
    number, timing = plan(duration, len(contestants), rate)
    loops: list[BareLoop] = []
    found = [Measured(label, loops=loops) for label in contestants]
    for turn in between_loops(rounds or number, loops):
        for measured in found:
            note(f"round {turn + 1} of {rounds or number}: {measured.label}")
            measured.rounds.append(contestants[measured.label](timing))
    note("")
    return found


def between_loops(rounds: int, loops: list[BareLoop]) -> Iterator[int]:
    """Yield the number of each round; append the bare loop before and after each to ``loops``."""
    with bare_loop() as measure:
        for turn in range(rounds):
            loops.append(measure())
            yield turn
        loops.append(measure())


@contextmanager
def bare_loop() -> Iterator[Callable[[], BareLoop]]:
    """Give a function that measures a bare loop of pyzmq, this process and another one.

    Both are on the core of the nodes in the ordinary scheduling class, so that any other program
    there makes it slower. Nothing of it runs between two measurements.
    """
    core = choose_core("auto")
    assert core is not None
    with tempfile.TemporaryDirectory(prefix="forcebound-") as folder:
        address = f"ipc://{folder}/loop"
        with serving(_echo, address, core), zmq.Context() as context:
            with _pinned(core):  # so is the context's own thread, which its first socket starts
                socket = context.socket(zmq.PAIR)
            with socket:
                socket.linger, socket.rcvtimeo = 0, FIRST_ANSWER_MS
                socket.connect(address)
                _exchange(socket)
                yield lambda: _measured_loop(socket, core)


def _measured_loop(socket: "zmq.Socket[bytes]", core: int) -> BareLoop:
    with _pinned(core):
        end_ns, times_ns = time.monotonic_ns() + round(1e9 * LOOP_S), list[int]()
        while time.monotonic_ns() < end_ns:
            times_ns.append(timed(lambda: _exchange(socket)))
    return BareLoop(statistics.fmean(times_ns), statistics.median(times_ns))


@contextmanager
def _pinned(core: int) -> Iterator[None]:
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {core})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def _exchange(socket: "zmq.Socket[bytes]") -> None:
    socket.send(MESSAGE)
    socket.recv()


def _echo(address: str, core: int) -> None:
    os.sched_setaffinity(0, {core})
    with zmq.Context() as context, context.socket(zmq.PAIR) as socket:
        socket.bind(address)
        while True:
            socket.send(socket.recv())


def steadiness(contestants: list[Measured]) -> float:
    """Return the slowest mean of the bare loop over its quickest median: 1 on an idle machine."""
    loops = [loop for one in contestants for loop in one.loops]
    return max(loop.mean_ns for loop in loops) / min(loop.median_ns for loop in loops)


def compare(
    ours: Measured,
    other: Measured,
    share: str = "p50",
    target: float | None = None,
    shown: str = "",
) -> Figure:
    """Return the ratio of a percentile to that of a reference with as many rounds."""

    def ratio(a: list[Round], b: list[Round]) -> float:
        return max(percentile(a, share), 1) / max(percentile(b, share), 1)

    what = f"{ours.label} / {other.label}, {share.replace('_', '.')}"
    return Figure(what, *_related(ours, other, ratio, "", target), shown)


def beyond(
    ours: Measured, base: Measured, share: str, target: float | None, shown: str = ""
) -> Figure:
    """Return the excess of a percentile over the median of a baseline, in us."""

    def difference(a: list[Round], b: list[Round]) -> float:
        return (percentile(a, share) - percentile(b, "p50")) / 1e3

    what = f"{ours.label}, {share} beyond {base.label}"
    return Figure(what, *_related(ours, base, difference, "us", target), shown)


def _related(
    ours: Measured,
    other: Measured,
    relation: Callable[[list[Round], list[Round]], float],
    unit: str,
    target: float | None,
) -> tuple[float, str, float | None, bool, float, float]:
    pairs = zip(ours.rounds, other.rounds, strict=True)
    each = [relation([a], [b]) for a, b in pairs if a.times_ns and b.times_ns]
    return relation(ours.rounds, other.rounds), unit, target, False, min(each), max(each)


def at(
    measured: Measured, share: str, target_us: float | None = None, is_shown: bool = False
) -> Figure:
    """Return a percentile, in us; on the page it has the name of the percentile."""
    name = share.replace("_", ".")
    what = f"{measured.label}, {name}"
    value = measured.at(share) / 1e3
    return Figure(what, value, "us", target_us, shown=f"({name})" if is_shown else "")


def missed(measured: Measured, target: float | None = 0.0) -> Figure:
    """Return how many instants were missed."""
    return Figure(f"{measured.label}, missed", measured.missed, "ticks", target)


def timed(work: Callable[[], object]) -> int:
    """Return how long one call takes, in ns."""
    begun_ns = time.monotonic_ns()
    work()
    return time.monotonic_ns() - begun_ns


def note(text: str) -> None:
    """Show what is being measured, on a terminal."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()


def chain(policy: str = "") -> Settings:
    """Return the settings of a punctual process here: the core of the nodes, the best class."""
    best = "fifo" if permits_fifo() else "other"
    return Settings(policy=policy or best, core=choose_core("auto"))


def compiled(source: str, folder: str, name: str = "", *flags: str) -> Path:
    """Compile a C file of this folder and return the program or library.

    Raises:
        RunError: If there is no C compiler, or if it fails.
    """
    compiler = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if compiler is None:
        raise RunError("no C compiler (gcc, cc, clang) on PATH; for example: apt install gcc")
    target = Path(folder) / (name or Path(source).stem)
    command = [compiler, "-O2", *flags, "-o", str(target), str(HERE / source), "-lm"]
    built = subprocess.run(command, capture_output=True, text=True)
    if built.returncode:
        raise RunError(f"{compiler} could not build {source}:\n{built.stderr.strip()}")
    return target


def conditions() -> dict[str, str]:
    """Return date, commit, machine, versions, permissions and load."""
    git = ["git", "-C", str(HERE), "describe", "--always", "--dirty", "--abbrev=12"]
    commit = subprocess.run(git, capture_output=True, text=True).stdout.strip()
    processor = next(
        (
            line.partition(": ")[2].strip()
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith("model name")
        ),
        platform.machine(),
    )
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "commit": commit or "unknown",
        "processor": f"{len(os.sched_getaffinity(0))} cores of {processor}",
        "kernel": f"{platform.system()} {platform.release()}",
        "scheduling": "SCHED_FIFO permitted" if permits_fifo() else "ordinary",
        "load average": f"{os.getloadavg()[0]:.2f}",
        "versions": f"Python {platform.python_version()}, pyzmq {metadata.version('pyzmq')}",
    }
