"""Benchmark of the compiled kernel against C: ``sweep.c`` has the same algorithm and layout.

Contestants run blocks of ``WIDTH`` simulations side by side, each one second of the stiff wall
under the certified law with 20 integration steps a sample, alternately: the kernel and C on one
thread, then both on all cores. ``gcc`` may contract products and sums (its default); a second build
without contraction must give the kernel's numbers to the last bit; it is compared first.
"""

import ctypes
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.benchmark.figures import Measured, compare, judge, report
from forcebound.benchmark.workers import compile_c, compiler, conditions
from forcebound.config.graph import GraphConfig
from forcebound.config.loader import load
from forcebound.devices.phantom import PhantomPremium15
from forcebound.environments.wall import Wall
from forcebound.errors import RunError
from forcebound.sweep.engine import block_arguments, ticks_of
from forcebound.sweep.kernel import WIDTH, KernelArguments, kernel
from forcebound.sweep.timing import timing_of

RATIO_TARGET = 0.8  # of the speed of C
REAL_TIME_TARGET = 1000.0  # simulated seconds a second, on each core
SUBSTEPS = 20  # integration steps a sample
SECONDS = 1.0  # that each simulation lasts
#: The last two change no result; they only let gcc vectorise roots and choices as LLVM does.
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math")

Run: TypeAlias = Callable[[KernelArguments], None]


def run(duration: float, rate: float, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run the benchmark; see :meth:`forcebound.benchmark.Benchmark.run`."""
    surroundings = conditions()
    cores: int = len(surroundings["cores"])
    compiled = kernel("certified", "wall")

    def by_kernel(arguments: KernelArguments) -> None:
        compiled(*arguments)

    with tempfile.TemporaryDirectory(prefix="forcebound-") as folder:
        progress("building C")
        by_c = _library(Path(folder), "contracting", ())
        exactly = _library(Path(folder), "exact", ("-ffp-contract=off",))
        difference = _largest_difference(by_kernel, exactly, _block(rate))
        if difference > 0.0:
            raise RunError(f"kernel and C differ by {difference:g}, so their times mean nothing")
        pairs = [
            _race(by_kernel, by_c, threads, duration / 2, rate, progress)
            for threads in dict.fromkeys((1, cores))
        ]
    contestants: dict[str, Measured] = {}
    comparisons: dict[str, Any] = {}
    for threads, ours, limit in pairs:
        name = f"threads_{threads}"
        contestants |= {f"kernel_{name}": ours, f"c_{name}": limit}
        comparisons |= _judged(name, threads, ours, limit)
    comparisons["difference"] = judge("kernel - C, largest difference", difference, "", 0.0)
    surroundings |= {
        "width": WIDTH,
        "substeps": SUBSTEPS,
        "compiler": _compiler_version(),
        "flags": list(FLAGS),
        "a block": f"{WIDTH} simulations of {SECONDS:g} s at {rate:g} Hz",
    }
    return report("sweep", duration, rate, contestants, comparisons, surroundings)


def _judged(name: str, threads: int, ours: Measured, limit: Measured) -> dict[str, Any]:
    ratio = compare(limit, ours, "p50", None)  # time of C over ours: our speed in that of C
    what = f"speed / C, {_threads(threads)}"
    ratio |= judge(what, ratio["value"], "ratio", RATIO_TARGET, at_least=True)
    speed = WIDTH * SECONDS / (ours.at("p50") * 1e-9)
    what = f"times real time on each core, {_threads(threads)}"
    return {
        f"{name}_ratio": ratio,
        f"{name}_real_time": judge(what, speed, "times", REAL_TIME_TARGET, at_least=True),
    }


def _threads(threads: int) -> str:
    return "1 thread" if threads == 1 else f"{threads} threads"


def _block(rate: float) -> KernelArguments:
    """Return a block of walls from 0.5 N/mm to 16 N/mm, all different."""
    base = load("stiff_wall", ["law:=certified"])
    model = base.device.model
    assert isinstance(model, PhantomPremium15)
    model = replace(model, substep=1.0 / rate / SUBSTEPS)
    device = replace(base.device, model=model, servo=replace(base.device.servo, rate=rate))
    base = replace(base, duration=SECONDS, device=device)
    wall = base.environment.model
    assert isinstance(wall, Wall)
    configs: list[GraphConfig] = []
    for lane in range(WIDTH):
        walls = replace(wall, stiffness=500.0 * (lane + 1))
        configs.append(replace(base, environment=replace(base.environment, model=walls)))
    timing = timing_of(base, ticks_of(base))
    return block_arguments(configs, [timing] * WIDTH)


def _race(
    ours: Run,
    limit: Run,
    threads: int,
    duration: float,
    rate: float,
    progress: Callable[[str], None],
) -> tuple[int, Measured, Measured]:
    """Run both alternately; each thread has a block of its own."""
    blocks = [_block(rate) for _ in range(threads)]
    pair = (
        (ours, Measured(f"block, kernel, {_threads(threads)}")),
        (limit, Measured(f"block, C, {_threads(threads)}")),
    )
    ours(blocks[0])  # compile
    began = time.perf_counter()
    limit(blocks[0])
    each = max(time.perf_counter() - began, 1e-5)
    rounds = max(3, int(duration / 0.5))
    repeats = max(8, int(duration / rounds / 2 / each))
    with ThreadPoolExecutor(threads) as pool:
        for number in range(rounds):
            progress(f"round {number + 1} of {rounds}, {_threads(threads)}")
            for contestant, measured in pair:
                _round(contestant, measured, blocks, repeats, pool)
    return threads, pair[0][1], pair[1][1]


def _round(
    contestant: Run,
    measured: Measured,
    blocks: Sequence[KernelArguments],
    repeats: int,
    pool: ThreadPoolExecutor,
) -> None:
    def work(arguments: KernelArguments) -> list[int]:
        times = []
        for _ in range(repeats):
            began = time.perf_counter_ns()
            contestant(arguments)
            times.append(time.perf_counter_ns() - began)
        return times

    processor, began = time.process_time_ns(), time.perf_counter_ns()
    times = [one for several in pool.map(work, blocks) for one in several]
    elapsed = time.perf_counter_ns() - began
    measured.add(times, 0, time.process_time_ns() - processor, elapsed)


def _compiler_version() -> str:
    out = subprocess.run([compiler(), "--version"], capture_output=True, text=True)
    return out.stdout.partition("\n")[0]


def _library(folder: Path, name: str, flags: Sequence[str]) -> Run:
    """Return the function of ``sweep.c``, built with additional ``flags``."""
    flags = (*FLAGS, *flags, f"-DWIDTH={WIDTH}", "-shared", "-fPIC")
    function = ctypes.CDLL(str(compile_c("sweep.c", folder, f"{name}.so", flags))).run
    function.restype = None

    def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data)

    def call(arguments: KernelArguments) -> None:
        ticks, period, wait, substep, cutoff, _, _, answered, *arrays = arguments
        engagement, rows, answers, traces = arrays
        function(
            *(ctypes.c_int64(number) for number in (ticks, period, wait)),
            ctypes.c_double(substep),
            ctypes.c_double(cutoff),
            pointer(answered),
            pointer(engagement),
            pointer(rows),
            pointer(answers),
            ctypes.c_int64(answers.size // WIDTH),
            pointer(traces),
        )

    return call


def _largest_difference(one: Run, other: Run, arguments: KernelArguments) -> float:
    one(arguments)
    expected = arguments[-1].copy()
    arguments[-1].fill(np.nan)
    other(arguments)
    return float(np.max(np.abs(arguments[-1] - expected)))
