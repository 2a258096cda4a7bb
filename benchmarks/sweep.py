"""The compiled loop of sweeps against C with the same order of operations (`sweep.c`).

A run is two seconds of the stiff wall under the certified law with 20 integration steps a sample,
on one thread. gcc may contract products and sums (its default); a build without contraction must
give the loop's numbers to the last bit, which is tested first.
"""

import ctypes
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.harness import Figure, Result, alternate, compare, compiled, timed
from forcebound.errors import RunError
from forcebound.graph.loader import load
from forcebound.graph.servo import dissipation_of
from forcebound.haptics.laws import LAWS
from forcebound.lab.one_axis import NO_MOTION, TRACE, Course, Floats, System, loop
from forcebound.lab.runs import course_of, system_of, timing_of
from forcebound.observe.measure import Round, Timing

DURATION = 6.0
ASKED = "compiled loop of sweeps, on one core"
SECONDS = 2.0  # that a run lasts
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC")


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    config = replace(
        load("stiff_wall", ["law:=certified", "device.hand_speed:=null"]), duration=SECONDS
    )
    device = LAWS["certified"].device(dissipation_of(config.only.device, config.only.servo))
    system, course = system_of(config), course_of(config, timing_of(config))
    trace = np.empty((course.answered.size, len(TRACE)))
    ours = partial(loop("certified"), system, device, course, trace, NO_MOTION)
    with tempfile.TemporaryDirectory(prefix="forcebound-") as folder:
        contracting = _library(folder, "contracting", system, device, course, trace)
        exact = _library(folder, "exact", system, device, course, trace, "-ffp-contract=off")
        ours()
        expected = trace.copy()
        trace.fill(np.nan)
        exact()
        if not np.array_equal(trace, expected):
            raise RunError("loop and C differ, so their times mean nothing")
        contestants = {"loop": partial(_runs, ours), "C": partial(_runs, contracting)}
        loops, limit = found = alternate(duration, rate, contestants)
    ratio = compare(limit, loops, shown="the speed of C")
    ratio = ratio._replace(what="speed / C", at_least=True)
    speed = SECONDS / (loops.at("p50") * 1e-9)
    times = Figure("times real time on a core", speed, "", 3000.0, True, shown="real time")
    return found, [times, ratio]


def _runs(run_once: Callable[[], object], timing: Timing) -> Round:
    end, times_ns = time.monotonic() + timing[0] * timing[1] * 1e-9, list[int]()
    while not times_ns or time.monotonic() < end:
        times_ns.append(timed(run_once))
    return Round(times_ns)


def _library(
    folder: str, name: str, system: System, device: Any, course: Course, trace: Floats, *flags: str
) -> Callable[[], object]:
    """Return a call of the function of ``sweep.c``, built with additional ``flags``."""
    function = ctypes.CDLL(str(compiled("sweep.c", folder, f"{name}.so", *FLAGS, *flags))).run
    axis = system.axis
    hand = (axis.hand_stiffness, axis.hand_damping, system.hand_mass, system.substep)
    limits = (system.resolution, system.saturation, system.largest_speed, system.cutoff)
    numbers = (axis.mass, axis.damping, axis.friction, *hand, *limits, *system.numbers[:2], *device)
    arrays = (*course[:5], trace)
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
    constants = (ctypes.c_double * len(numbers))(*numbers)
    return partial(function, ctypes.c_int64(course.answered.size), constants, *pointers)
