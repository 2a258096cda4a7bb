"""The compiled kernel of sweeps against C with the same algorithm and layout (`sweep.c`).

A block is simulations side by side, each one second of the stiff wall under the certified law with
20 integration steps a sample, on one thread. gcc may contract products and sums (its default); a
build without contraction must give the kernel's numbers to the last bit, which is tested first.
"""

import ctypes
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Figure, Result, alternate, compare, compiled, timed
from forcebound.config.graph import GraphConfig
from forcebound.config.loader import load
from forcebound.devices.phantom import PhantomPremium15
from forcebound.environments.walls import Wall
from forcebound.errors import RunError
from forcebound.monitor.measure import Round, Timing
from forcebound.sweep.engine import block_arguments, ticks_of
from forcebound.sweep.kernel import WIDTH, KernelArguments, kernel
from forcebound.sweep.timing import timing_of

DURATION = 6.0
SUBSTEPS = 20  # integration steps a sample
SECONDS = 1.0  # that each simulation lasts
#: The last two change no result; they only let gcc vectorise roots and choices as LLVM does.
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math")

Run: TypeAlias = Callable[[KernelArguments], None]


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    by_kernel = kernel("certified", "wall")
    block = _block(rate)
    with tempfile.TemporaryDirectory(prefix="forcebound-") as folder:
        contestants = {
            "kernel": partial(_blocks, lambda arguments: by_kernel(*arguments), block),
            "C": partial(_blocks, _library(folder, "contracting"), block),
        }
        difference = _largest_difference(
            lambda arguments: by_kernel(*arguments),
            _library(folder, "exact", "-ffp-contract=off"),
            block,
        )
        if difference > 0.0:
            raise RunError(f"kernel and C differ by {difference:g}, so their times mean nothing")
        ours, limit = found = alternate(duration, rate, contestants)
    ratio = compare(limit, ours)._replace(what="speed / C", target=0.8, at_least=True)
    speed = WIDTH * SECONDS / (ours.at("p50") * 1e-9)
    return found, [ratio, Figure("times real time on a core", speed, "", 1000.0, True)]


def _blocks(run_block: Run, block: KernelArguments, timing: Timing) -> Round:
    end, times_ns = time.monotonic() + timing[0] * timing[1] * 1e-9, list[int]()
    while not times_ns or time.monotonic() < end:
        times_ns.append(timed(lambda: run_block(block)))
    return Round(times_ns)


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


def _library(folder: str, name: str, *flags: str) -> Run:
    """Return the function of ``sweep.c``, built with additional ``flags``."""
    flags = (*FLAGS, *flags, f"-DWIDTH={WIDTH}", "-shared", "-fPIC")
    function = ctypes.CDLL(str(compiled("sweep.c", folder, f"{name}.so", *flags))).run
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
