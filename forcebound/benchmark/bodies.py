"""Benchmark of rigid bodies: an answer of the environment against a bare step of MuJoCo.

Both go through the scene of the launch file ``push_boxes``, twenty boxes pushed by the same motion,
one step at a time with a pause between, as in a graph.
"""

import math
import time
from collections.abc import Callable
from typing import Any

from forcebound.benchmark.figures import Measured, compare, judge, plan, report
from forcebound.benchmark.workers import conditions
from forcebound.config.loader import load
from forcebound.environments.bodies import Bodies, engine
from forcebound.realtime import wait_until

ANSWER_TARGET_US = 150.0  # p50
REACH = 0.025  # m, amplitude of the hand's motion into the boxes
SPEED = 3.0  # rad/s of that motion


def run(duration: float, rate: float, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run the benchmark; see :meth:`forcebound.benchmark.Benchmark.run`."""
    answer, bare = Measured("answer, 20 boxes"), Measured("bare mj_step, 20 boxes")
    rounds, count = plan(duration, 2, rate)
    period_ns = round(1e9 / rate)
    model = load("push_boxes").environment.model
    assert isinstance(model, Bodies)
    ask, step = _answers(model), _steps(model)
    for number in range(rounds):
        progress(f"round {number + 1} of {rounds}")
        for contestant, work in ((answer, ask), (bare, step)):
            start_ns, processor_ns = time.monotonic_ns(), time.process_time_ns()
            times = []
            for tick in range(count):
                wait_until(start_ns + tick * period_ns, 0)
                begun_ns = time.monotonic_ns()
                work((number * count + tick) / rate)
                times.append(time.monotonic_ns() - begun_ns)
            processor_ns = time.process_time_ns() - processor_ns
            contestant.add(times, 0, processor_ns, time.monotonic_ns() - start_ns)
    comparisons = {
        "answer_us": judge("answer, p50", answer.at("p50") / 1e3, "us", ANSWER_TARGET_US),
        "ratio": compare(answer, bare, "p50", None),
    }
    contestants = {"answer": answer, "bare": bare}
    return report("bodies", duration, rate, contestants, comparisons, conditions())


def _answers(model: Bodies) -> Callable[[float], object]:
    environment = model.open(3)

    def ask(elapsed: float) -> object:
        phase = SPEED * elapsed
        position = (REACH * math.sin(phase), 0.0, 0.010)
        return environment.force("", position, (REACH * SPEED * math.cos(phase), 0.0, 0.0), elapsed)

    return ask


def _steps(model: Bodies) -> Callable[[float], object]:
    """The same scene without a hand, shaken by gravity that leans to and fro."""
    mujoco = engine()
    scene = mujoco.MjModel.from_xml_path(str(model.file))
    data = mujoco.MjData(scene)

    def step(elapsed: float) -> object:
        scene.opt.gravity[0] = math.sin(SPEED * elapsed)
        return mujoco.mj_step(scene, data)

    return step
