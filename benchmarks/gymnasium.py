"""A tick of an environment of gymnasium against a bare step of MuJoCo in the same scene.

Both push with the same spring: the bare loop steps data of its own of the environment's model.
"""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness import Contestant, Result, alternate, compare, timed
from forcebound.haptics.environments.mujoco_scene import engine
from forcebound.interface.gym import HapticEnv
from forcebound.observe.measure import Round, Timing

DURATION = 12.0
ASKED = "tick of a `HapticEnv` at twenty boxes; at an arm"
TICKS = 200  # of a measurement
PLACES = {"push_boxes": (0.02, 0.0, 0.010), "hold_arm": (0.02, 0.0, 0.0)}  # m, of the hand's target
TARGETS = {"push_boxes": 2.0, "hold_arm": None}  # times the bare step: half its rate


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    contestants: dict[str, Contestant] = {}
    for file, place in PLACES.items():
        env = HapticEnv(file, frame_skip=TICKS)
        env.reset()
        contestants[f"HapticEnv, {file}"] = _rounds(_stepping(env, np.array(place)))
        contestants[f"mj_step, {file}"] = _rounds(_bare(env))
    found = alternate(duration, rate, contestants)
    pairs = zip(found[::2], found[1::2], TARGETS.values(), strict=True)
    shown = "a bare step of MuJoCo"
    return found, [compare(ours, bare, target=most, shown=shown) for ours, bare, most in pairs]


def _stepping(env: HapticEnv, place: NDArray[np.float64]) -> Callable[[], object]:
    return lambda: env.step(place)


def _bare(env: HapticEnv) -> Callable[[], object]:
    mujoco, opened = engine(), env.world.mujoco()
    assert opened is not None
    scene = opened[0]
    data = mujoco.MjData(scene)

    def steps() -> None:
        for _ in range(TICKS):
            mujoco.mj_step(scene, data)

    return steps


def _rounds(work: Callable[[], object]) -> Contestant:
    def contestant(timing: Timing) -> Round:
        end, times_ns = time.monotonic() + timing[0] * timing[1] * 1e-9, list[int]()
        while not times_ns or time.monotonic() < end:
            times_ns.append(round(timed(work) / TICKS))
        return Round(times_ns)

    return contestant
