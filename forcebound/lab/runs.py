"""Runs of many graphs: in the compiled loop of one axis where it is exact, else in virtual time.

What the loop serves it runs to the same bits (``tests/test_one_axis.py``). What the network does to
a packet never depends on the forces in it. So a run of the graph with nobody at the device gives
the timing: which answer each tick has, how far the force is engaged, what is rejected. Cases that
differ in nothing that decides it share it.

    python -m forcebound.lab.runs        which shipped launch files the loop serves
"""

import sys
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, TypeAlias

import numpy as np

from forcebound.errors import RunError
from forcebound.graph.document import shipped
from forcebound.graph.graph import EnvironmentConfig, GraphConfig, HandConfig
from forcebound.graph.loader import load
from forcebound.graph.resolved import kind_of, to_document
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.plant import Axis
from forcebound.haptics.environments.walls import Wall
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.hands import NoHand, WallInPlace
from forcebound.haptics.hands.pointer import PointerHand
from forcebound.haptics.laws import LAWS
from forcebound.lab.one_axis import ENVIRONMENTS, NO_MOTION, TRACE, Course, Floats, System, loop
from forcebound.messages.topology import HAND, flat
from forcebound.network.impairment import Impairment
from forcebound.nodes import safety
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.run.results import RunResult
from forcebound.run.virtual import run_virtual, run_virtual_hands

Engine: TypeAlias = Literal["kernel", "graph"]

MAX_TICKS = 1_000_000  # a case keeps some 200 bytes of each

#: The stages of the safety chain that the loop stands for.
STAGES = (safety.fresh, safety.ramp)
#: Numbers of a device that the loop takes to be zero.
ZEROS = (
    *("presliding", "weight", "weight_error", "gain_error", "lag", "write_delay"),
    "watchdog_tolerance",
)


@dataclass(frozen=True)
class Ran:
    """Outcome of one case: its engine (``kernel``: the loop), and its results or error."""

    engine: Engine
    results: Mapping[str, RunResult]  # by hand; empty if it failed
    error: Exception | None = None

    @property
    def result(self) -> RunResult | None:
        """Of the first hand; None if it failed."""
        return next(iter(self.results.values()), None)


def run_all(configs: Sequence[GraphConfig]) -> list[Ran]:
    """Return an outcome of each case, in their order; a failed one does not stop the others.

    ::

        graphs = [fb.Graph.read("stiff_wall", delay=delay) for delay in ("0 ms", "2 ms")]
        peaks = [ran.result.summary["peak_force_n"] for ran in run_all(graphs)]  # N
    """
    return [_run(config) for config in configs]


def _run(config: GraphConfig) -> Ran:
    try:
        rate = sum(hand.servo.rate for hand in config.hands.values())
        if config.duration * rate > MAX_TICKS:
            raise RunError(f"a case has at most {MAX_TICKS} ticks; use a shorter duration")
        if len(config.hands) == 1 and not any(unserved(config)):
            result = run_compiled(config)
            if result is not None:
                return Ran("kernel", dict.fromkeys(config.hands, result))
        return Ran("graph", run_virtual_hands(config))
    except Exception as error:  # any failure of a user's part is this case's error
        return Ran("graph", {}, error)


def unserved(config: GraphConfig) -> Iterator[str]:
    """Yield in words why the loop does not serve a graph; nothing if it does.

    ::

        list(unserved(fb.Graph.read("three_axes")))  # ["3 axes"]
    """
    device: Any = config.only.device
    environment, hand, servo = config.environment, config.only.operator, config.only.servo
    if type(device) is not PhantomPremium15:
        yield f"the device {kind_of('device', device)}"
    elif device.axes != 1:
        yield f"{device.axes} axes"
    else:
        yield from (name for name in ZEROS if getattr(device, name))
        yield from (name for name, value in vars(device).items() if isinstance(value, tuple))
        yield from ["attenuating motors"] if device.attenuates != "never" else []
        yield from ["truth"] if device.truth is not None else []
        yield from ["no watchdog"] if device.watchdog == "none" else []
    if isinstance(hand, PointerHand | WallInPlace) or not isinstance(hand, Operator | None):
        yield f"the operator {kind_of('operator', hand)}"
    elif not isinstance(hand, Hashable):
        yield "an operator that may change"
    if type(config.only.controller) is not DirectController:
        yield f"the controller {kind_of('controller', config.only.controller)}"
    kind = kind_of("environment", environment.model)
    if kind not in ENVIRONMENTS:
        yield f"the environment {kind}"
    yield from ["fixtures"] if environment.fixtures is not None else []
    yield from ["phases"] if config.phases else []
    if any(link.rate for link in config.only.links.values()):
        yield "a link with a rate"  # the size of a packet matters
    if any(link.deadband for link in config.only.links.values()):
        yield "a link with a deadband"  # the content of a packet matters
    if safety.stages_of(servo) != STAGES:
        yield "a stage of the safety chain"
    yield from ["a dead-man button"] if servo.dead_man is not None else []
    if servo.period_ns / 1e9 > servo.longest_hold:
        yield "a hold limit of one period that is rounded down"


def run_compiled(config: GraphConfig) -> RunResult | None:
    """Run a graph that the loop serves; None if a reading is refused, which the graph alone can.

    Raises:
        RunError: If the run is too short to have a sample.
    """
    servo, timing = config.only.servo, timing_of(config)
    trace = np.zeros((timing.seq.size, len(TRACE)))
    device = LAWS[servo.law].device(dissipation_of(config.only.device, servo))
    run = loop(servo.law)
    if (
        run(system_of(config), device, course_of(config, timing), trace, NO_MOTION)
        < timing.seq.size
    ):
        return None
    columns: dict[str, Any] = {}
    for name, column in zip(TRACE, trace.T.copy(), strict=True):
        columns[name] = column.reshape(getattr(timing, name).shape)
    return RunResult(replace(timing, **columns), flat(to_document(config)))


def system_of(config: GraphConfig) -> System:
    """Return device, hand and environment of a graph that the loop serves."""
    model: Any = config.only.device
    hand, servo = config.only.operator or NoHand(), config.only.servo
    relied_on = dissipation_of(model, servo)
    place = config.environment.model
    environment, fields = ENVIRONMENTS[kind_of("environment", place)]
    a, b, c, d = (*(float(getattr(place, name)) for name in fields), 0.0, 0.0, 0.0)[:4]
    mass, damping, friction = model.mass + hand.mass, model.damping, model.friction
    return System(
        Axis(mass, damping, friction, 0.0, 0.0, 0.0, hand.stiffness, hand.damping),
        hand_mass=hand.mass,
        substep=model.substep,
        pieces=1,
        resolution=model.resolution,
        saturation=model.saturation,
        hold_ns=round(relied_on.hold_limit * 1e9),
        largest_speed=relied_on.largest_speed,
        cutoff=servo.velocity_cutoff,
        environment=environment,
        numbers=(a, b, c, d),
    )


def course_of(config: GraphConfig, timing: TelemetryColumns) -> Course:
    """Return the course of a run of a graph, whose :func:`timing_of` is ``timing``."""
    servo, hand = config.only.servo, config.only.operator or NoHand()
    ticks = timing.seq.size
    targets = _targets if getattr(hand, "file", None) is None else _targets.__wrapped__
    nothing = np.zeros(ticks)
    return Course(
        np.stack((timing.time_ns - servo.reply_wait_ns, timing.time_ns), axis=1).ravel(),
        targets(hand, servo.period_ns, servo.reply_wait_ns, ticks),
        timing.device_seq,
        timing.engagement,
        answers=np.zeros(ticks),
        chances=nothing,
        errors=nothing,
    )


@lru_cache(maxsize=64)
def _targets(hand: Operator, period_ns: int, wait_ns: int, ticks: int) -> Floats:
    """Return the targets of a hand at the samples and writes of each tick, in m."""
    waits = (0, wait_ns) if wait_ns else (0,)  # sample and write may be one instant
    times = (k * period_ns + wait for k in range(ticks) for wait in waits)
    targets = np.array([hand.target(time * 1e-9)[0] for time in times])
    return np.repeat(targets, 2 // len(waits))


def timing_of(config: GraphConfig) -> TelemetryColumns:
    """Return the telemetry of a graph with nobody at its device, whose timing is the same.

    Raises:
        RunError: If the run is too short to have a sample.
    """
    links, computation = tuple(sorted(config.only.links.items())), config.environment.computation
    delays = [*dict(links).values(), computation]
    is_fixed = all(one == Impairment(one.delay) for one in delays)
    reads_file = any(one.trace for one in delays)
    servo = replace(config.only.servo, law="none", velocity_cutoff=100.0, energy_cap="auto")
    environment = replace(config.environment, model=Wall(), fixtures=None)
    timing = _timing.__wrapped__ if reads_file else _timing
    return timing(0 if is_fixed else config.seed, config.duration, servo, environment, links)


@lru_cache(maxsize=64)  # some MB each
def _timing(
    seed: int,
    duration: float,
    servo: ServoSettings,
    environment: EnvironmentConfig,
    links: tuple[tuple[str, Impairment], ...],
) -> TelemetryColumns:
    hand = HandConfig(PhantomPremium15(watchdog="silent"), servo, links=dict(links))
    return run_virtual(GraphConfig(seed, duration, {HAND: hand}, environment)).columns


def coverage() -> Iterator[tuple[str, str]]:
    """Yield each shipped launch file, and what of it the loop does not serve; empty: nothing."""
    for file in shipped():
        config = load(file)
        reasons = unserved(config) if len(config.hands) == 1 else ("several hands",)
        yield file.removesuffix(".yaml"), ", ".join(reasons)


if __name__ == "__main__":
    for name, reasons in coverage():
        sys.stdout.write(f"| `{name}` | {reasons or 'served'} |\n")
