"""An answer of a scene of twenty boxes (`push_boxes`) against a bare step of MuJoCo.

One step at a time with a pause between, as in a graph, both pushed by the same motion.
"""

import math
from collections.abc import Callable
from itertools import count

from benchmarks.harness import Result, alternate, at, compare, timed
from forcebound.graph.loader import load
from forcebound.haptics.environments.bodies import Bodies
from forcebound.haptics.environments.mujoco_scene import engine
from forcebound.observe.measure import Round, Timing, pace
from forcebound.realtime import Settings

DURATION = 6.0
ASKED = "answer of a world of 20 boxes"
REACH, SPEED = 0.025, 3.0  # m and rad/s of the hand's motion into the boxes


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    model = load("push_boxes").environment.model
    assert isinstance(model, Bodies)
    works = {"answer, 20 boxes": _answer(model), "mj_step, 20 boxes": _step(model)}
    answer, bare = found = alternate(
        duration, rate, {label: _timed(work, rate) for label, work in works.items()}
    )
    return found, [
        at(answer, "p50", 150.0, is_shown=True),
        compare(answer, bare, shown="a bare step of MuJoCo"),
    ]


def _timed(work: Callable[[float], object], rate: float) -> Callable[[Timing], Round]:
    ticks = count()

    def contestant(timing: Timing) -> Round:
        return pace(lambda _: timed(lambda: work(next(ticks) / rate)), Settings(spin_ns=0), timing)

    return contestant


def _answer(model: Bodies) -> Callable[[float], object]:
    environment = model.open(3)

    def answer(elapsed: float) -> object:
        phase = SPEED * elapsed
        position = (REACH * math.sin(phase), 0.0, 0.010)
        return environment.force("", position, (REACH * SPEED * math.cos(phase), 0.0, 0.0), elapsed)

    return answer


def _step(model: Bodies) -> Callable[[float], object]:
    """The same scene without a hand, shaken by gravity that leans to and fro."""
    mujoco = engine()
    scene = mujoco.MjModel.from_xml_path(str(model.file))
    data = mujoco.MjData(scene)

    def step(elapsed: float) -> object:
        scene.opt.gravity[0] = math.sin(SPEED * elapsed)
        return mujoco.mj_step(scene, data)

    return step
