"""Simulated observers: a hand that approaches at the asked speed, and a noisy comparison.

The hand is the launch file's own, with its target's speed and its start set; the answer follows
from the displayed stiffness of both touches. Nothing here was fitted to a study.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from random import Random
from statistics import fmean
from typing import Any, Literal

from forcebound.errors import ConfigError, RunError
from forcebound.graph.graph import GraphConfig
from forcebound.lab.engine import Campaign, Row, run_here
from forcebound.lab.runs import run_all
from forcebound.lab.study.measures import Measures, measure
from forcebound.lab.study.plan import Block, Study, load_study, wall_of
from forcebound.lab.study.session import Session, Step
from forcebound.run.results import RunResult
from forcebound.run.virtual import run_virtual

#: Standard deviation of the difference of two stiffnesses as felt, over their size, which is the
#: point of 84 % right answers. 0.23 is from Jones and Hunter 1990, by adjustment; 84 % is the
#: criterion of that method in an abstract on viscosity (Jones, Hunter and Lafontaine, Perception
#: 26, 1997). That both hold for two touches of a wall is our assumption.
WEBER = 0.23
LAPSE = 0.02  # of the answers are guesses
SCATTER = 0.15  # of the speed from touch to touch, standard deviation of its logarithm; assumed
RUN_UP = 0.030  # m before the starting line, from where the hand begins
LAG = 0.5  # s by which the handle may be late at the wall
PHASES = 8
TRIED = [0.3 + 0.1 * i for i in range(14)]  # speeds of the target, over the asked speed


@dataclass(frozen=True)
class Observer:
    """A simulated participant."""

    seed: int
    weber: float = WEBER
    lapse: float = LAPSE
    records: bool = False  # every touch, in the graph in place of the compiled loop

    def session(self, study: Study, folder: Path, participant: str) -> Session:
        """Return a session of this observer."""
        about = f"seed {self.seed}, Weber fraction {self.weber:g}, lapse rate {self.lapse:g}"
        return Session(study, folder, participant, "simulated", observer=about)

    def take_part(self, study: Study, folder: Path, participant: str) -> None:
        """Answer all trials of a study that are left; in virtual time.

        Raises:
            ConfigError: As :class:`Session`; or if the hand cannot be brought into a band.
        """
        with self.session(study, folder, participant) as session:
            felt: list[Measures] = []
            while (step := session.step).kind != "finished":
                if step.kind == "touch":
                    felt = felt if step.interval == 2 else []
                    session.begin()
                    measures = self._touch(study, step)
                    felt += [measures] if session.touched(measures) else []
                elif step.kind == "question":
                    assert step.trial is not None
                    session.answer(self._choice(felt, Random(f"{self.seed}/{step.trial.seed}")))
                else:
                    session.go_on()

    def _choice(self, felt: list[Measures], random: Random) -> Literal[1, 2]:
        """Return the touch that feels stiffer."""
        guess: Literal[1, 2] = 1 if random.random() < 0.5 else 2
        is_lapse, noises = random.random() < self.lapse, (random.gauss(), random.gauss())
        if is_lapse:
            return guess
        share = self.weber / math.sqrt(2.0)  # of each touch, so that the difference has all of it
        first, second = (
            (one.stiffness or 0.0) * (1.0 + share * noise)
            for one, noise in zip(felt, noises, strict=True)
        )
        return 1 if first > second else 2

    def _touch(self, study: Study, step: Step) -> Measures:
        """Return the measures of a touch by a hand whose speed scatters about the asked one."""
        assert step.trial is not None
        assert step.config is not None
        random, block = Random(f"{self.seed}/{step.config.seed}"), study.blocks[step.trial.block]
        speed = _target_speed(study, step.trial.block)
        speed *= math.exp(random.gauss(0.0, SCATTER))
        start, phase = -1e-4 * random.random(), random.uniform(0.0, math.tau)
        config = _approaching(study, block, step.config, speed, start, phase)
        run = _run(config, step.recording if self.records else None)
        return measure(run, study.guidance.line, study.touch_time)


def _run(config: GraphConfig, recording: Path | None = None) -> RunResult:
    if recording is not None:
        return run_virtual(config, record=recording)
    (ran,) = run_all([config])  # the same to the bit
    if ran.result is None:
        raise RunError(f"a touch failed: {ran.error}") from ran.error
    return ran.result


def _approaching(
    study: Study, block: Block, config: GraphConfig, speed: float, lead: float, phase: float
) -> GraphConfig:
    """Return the graph of a touch whose hand approaches; ``speed`` is that of its target."""
    operator: Any = config.only.operator
    wall = wall_of(config)
    assert wall is not None, "the study's file was checked"
    if not hasattr(operator, "approach_speed"):
        raise ConfigError(
            "a simulated observer needs a launch file whose operator has an approach_speed, such as"
            " pressing or trembling"
        )
    start = wall - study.guidance.line - RUN_UP
    settings: dict[str, float] = {"start": start + lead, "approach_speed": speed}
    if hasattr(operator, "tremor_phase"):
        settings["tremor_phase"] = phase
    slowest = block.band[0] if block.band else operator.approach_speed
    duration = (wall - start) / max(slowest, 0.01) + LAG + study.touch_time  # for all touches
    return replace(config.with_hand(operator=replace(operator, **settings)), duration=duration)


@cache
def _target_speed(study: Study, block: str) -> float:
    """Return the speed of the hand's target, in m/s, that brings the handle to mid-band.

    The handle, a mass on a spring that trembles, runs before or behind its target, while people
    see the colour of the handle; so its speed is a mean over phases of the tremor.

    Raises:
        ConfigError: If no speed that was tried brings the handle into the band.
    """
    config, own = study.config(study.pairs[0][0]), study.blocks[block]  # the same before contact
    if own.band is None:
        return float(getattr(config.only.operator, "approach_speed", 0.1))
    asked, found = 0.5 * sum(own.band), dict[float, float]()
    for speed in (asked * share for share in TRIED):
        graphs = (
            _approaching(study, own, config, speed, 0.0, phase * math.tau / PHASES)
            for phase in range(PHASES)
        )
        shortened = (replace(one, duration=one.duration - study.touch_time) for one in graphs)
        runs = (measure(_run(one), study.guidance.line, study.touch_time) for one in shortened)
        speeds = [run.speed for run in runs if run.speed is not None]
        if len(speeds) == PHASES and own.holds(fmean(speeds)):
            found[abs(fmean(speeds) - asked)] = speed
    if not found:
        raise ConfigError(f"block {block!r}: the simulated hand cannot reach its band of speed")
    return found[min(found)]


def run_observers(
    observer: Observer, file: str, folder: Path, count: int, workers: int | None = None
) -> None:
    """Let simulated participants take part, each in a process or one after the other.

    Raises:
        ConfigError: As :class:`Session`.
        RunError: If a process ends before its work is done.
    """
    study = load_study(file)
    for block in study.blocks:
        _target_speed(study, block)  # a hand that is refused uses up no number
    names = [f"simulated-{number:02d}" for number in range(1, count + 1)]
    for name in names:  # in this order they get their numbers
        observer.session(study, folder, name).__exit__()
    work = partial(_take_part, observer, file, folder)
    run_here(Campaign(study.name, names, work, part=1), workers)


def _take_part(observer: Observer, file: str, folder: Path, names: Sequence[str]) -> list[Row]:
    for name in names:
        observer.take_part(_study(file), folder, name)
        sys.stderr.write(f"{name} has answered all trials\n")
    return []


_study = cache(load_study)  # one in each process, for all that is cached of it
