"""Engine of each case: the kernel where it is exact, the virtual-time graph elsewhere."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.bounding import LAWS
from forcebound.config.graph import GraphConfig
from forcebound.config.resolved import kind_of, to_document
from forcebound.controllers.direct import DirectController
from forcebound.devices.phantom import PhantomPremium15
from forcebound.errors import RunError
from forcebound.launch.results import RunResult
from forcebound.launch.virtual import run_virtual
from forcebound.nodes.servo import dissipation_of
from forcebound.operators import Operator
from forcebound.operators.hands import PressingHand, SinusoidalHand
from forcebound.sweep import kernel as lanes
from forcebound.sweep.timing import Timing, timing_of
from forcebound.telemetry import TelemetryColumns

Engine: TypeAlias = Literal["kernel", "graph"]


@dataclass(frozen=True)
class Ran:
    """Outcome of one case: its engine, and its result or error."""

    engine: Engine
    result: RunResult | None
    error: Exception | None = None


MAX_TICKS = 1_000_000  # a case keeps some 100 bytes of each until its part is done


def ticks_of(config: GraphConfig) -> int:
    """Return the number of complete ticks of a run."""
    servo = config.device.servo
    wait_ns = round(servo.reply_wait * servo.period_ns)
    return max(0, -((wait_ns - round(config.duration * 1e9)) // servo.period_ns))


def run_all(configs: Sequence[GraphConfig], engine: Engine | None = None) -> list[Ran]:
    """Run all cases; similar ones run in the kernel in parallel.

    Args:
        configs: The cases.
        engine: ``"graph"``: do not use the kernel; None: choose.

    Returns:
        One outcome for each, in their order; a failed case does not stop the others.
    """
    outcomes: list[Ran | None] = [None] * len(configs)
    groups: dict[tuple[Any, ...], list[tuple[int, Timing]]] = {}
    for index, config in enumerate(configs):
        if ticks_of(config) > MAX_TICKS:
            error = RunError(
                f"a case of a sweep has at most {MAX_TICKS} ticks; use a shorter duration"
            )
            outcomes[index] = Ran("graph", None, error)
            continue
        key = None if engine == "graph" else _group_of(config)
        timing = None if key is None else timing_of(config, ticks_of(config))
        if key is None or timing is None or not timing.is_exact:
            outcomes[index] = _run_graph(config)
        else:
            groups.setdefault(key, []).append((index, timing))
    for members in groups.values():
        for first in range(0, len(members), lanes.WIDTH):
            block = members[first : first + lanes.WIDTH]
            chosen = [configs[index] for index, _ in block]
            for (index, _), ran in zip(
                block, _run_block(chosen, [timing for _, timing in block]), strict=True
            ):
                outcomes[index] = ran
    return [outcome for outcome in outcomes if outcome is not None]


def _run_graph(config: GraphConfig) -> Ran:
    try:
        return Ran("graph", run_virtual(config))
    except Exception as error:  # any failure of a user's part is this case's error
        return Ran("graph", None, error)


def _group_of(config: GraphConfig) -> tuple[Any, ...] | None:
    """Return the values that cases in one block share; None if the kernel cannot run the case."""
    model: object = config.device.model
    servo, operator = config.device.servo, config.operator
    environment = kind_of("environment", config.environment.model)
    if (
        type(model) is not PhantomPremium15
        or not model.is_plain
        or operator is None
        or model.axes != 1
        or environment not in lanes.ENVIRONMENTS
        or config.environment.fixtures is not None
        or type(config.controller) is not DirectController
        or servo.period_ns / 1e9 > servo.longest_hold  # by rounding, every hold would be too long
    ):
        return None
    return (
        ticks_of(config),
        servo.law,
        environment,
        servo.period_ns,
        servo.reply_wait,
        servo.velocity_cutoff,
        model.substep,
        type(operator) if _path_numbers(operator) else operator,
    )


def _path_numbers(hand: Operator) -> list[float]:
    """What the kernel computes the path of a hand from; empty: it gets a table of the path."""
    if isinstance(hand, PressingHand):
        start, end = hand.start, hand.end
        if not isinstance(start, tuple) and not isinstance(end, tuple):
            return [start, end, hand.approach_speed]
    elif isinstance(hand, SinusoidalHand):
        return [hand.centre, hand.amplitude, hand.frequency]
    return []


def _run_block(configs: Sequence[GraphConfig], timings: Sequence[Timing]) -> list[Ran]:
    first = configs[0]
    if ticks_of(first) == 0:
        error = RunError("the run ended before its first sample; use a longer duration")
        return [Ran("kernel", None, error) for _ in configs]
    kind = kind_of("environment", first.environment.model)
    arguments = block_arguments(configs, timings)
    lanes.kernel(first.device.servo.law, kind)(*arguments)
    traces = arguments[-1].reshape(-1, len(lanes.TRACES), lanes.WIDTH)
    by_lane = np.ascontiguousarray(traces.transpose(2, 1, 0))
    return [
        _run_graph(config)
        if _is_too_fast(config, trace)
        else Ran("kernel", RunResult(_columns(config, timing, trace), to_document(config)))
        for config, timing, trace in zip(configs, timings, by_lane, strict=False)
    ]


def _is_too_fast(config: GraphConfig, trace: NDArray[np.float64]) -> bool:
    """Return whether the bounder would refuse a reading, which the kernel takes."""
    fastest = config.device.model.largest_speed or math.inf
    steps = np.abs(np.diff(trace[lanes.TRACES.index("reading")]))
    return bool((steps > fastest * config.device.servo.period_ns * 1e-9).any())


def block_arguments(
    configs: Sequence[GraphConfig], timings: Sequence[Timing]
) -> lanes.KernelArguments:
    """Return the arguments of a kernel for up to ``WIDTH`` cases of one group.

    Empty lanes repeat the last case. The last argument takes the traces.
    """
    first = configs[0]
    model: Any = first.device.model
    servo = first.device.servo
    ticks = ticks_of(first)
    lane_of = [min(i, len(configs) - 1) for i in range(lanes.WIDTH)]
    rows = np.zeros((lanes.ROWS, lanes.WIDTH))
    environment = kind_of("environment", first.environment.model)
    for lane, index in enumerate(lane_of):
        rows[: lanes.CONSTANTS, lane] = _constants(configs[index], environment)
    path, targets = _path(first, ticks)
    answered = np.stack([timings[index].answered for index in lane_of], axis=1)
    engagement = np.stack([timings[index].engagement for index in lane_of], axis=1)
    distance = int((np.arange(ticks)[:, np.newaxis] - answered)[answered >= 0].max(initial=0))
    answers = np.zeros((1 << distance.bit_length(), lanes.WIDTH))
    return (
        ticks,
        servo.period_ns,
        round(servo.reply_wait * servo.period_ns),
        model.substep,
        servo.velocity_cutoff,
        path,
        targets.ravel(),
        np.maximum(answered, 0).ravel(),
        engagement.ravel(),
        rows.reshape(-1),
        answers.reshape(-1),
        np.empty(ticks * len(lanes.TRACES) * lanes.WIDTH),
    )


def _constants(config: GraphConfig, environment: str) -> list[float]:
    model: Any = config.device.model
    hand, servo = config.operator, config.device.servo
    assert hand is not None  # _group_of excludes graphs without a hand
    law = LAWS[servo.law].device(dissipation_of(model, servo))
    place = config.environment.model
    answer = [getattr(place, name) for name in lanes.ENVIRONMENTS[environment][1]]
    return [
        model.mass + hand.mass,
        hand.mass,
        model.damping,
        model.friction,
        model.resolution,
        model.saturation,
        hand.stiffness,
        hand.damping,
        *law,
        *(answer + [0.0] * 4)[:4],
        *(_path_numbers(hand) + [0.0] * 3)[:3],
    ]


def _path(config: GraphConfig, ticks: int) -> tuple[int, NDArray[np.float64]]:
    operator = config.operator
    assert operator is not None
    if _path_numbers(operator):
        kind = lanes.PRESSING if isinstance(operator, PressingHand) else lanes.SINUSOIDAL
        return kind, np.zeros(1)
    servo = config.device.servo
    wait_ns = round(servo.reply_wait * servo.period_ns)
    times = [k * servo.period_ns + wait for k in range(ticks) for wait in (0, wait_ns)]
    targets = np.array([operator.target(time * 1e-9)[0] for time in times])
    return lanes.TABLE, np.repeat(targets, lanes.WIDTH)


def _columns(config: GraphConfig, timing: Timing, trace: NDArray[np.float64]) -> TelemetryColumns:
    servo = config.device.servo
    ticks = trace.shape[1]
    wait_ns = round(servo.reply_wait * servo.period_ns)
    seq = np.arange(ticks, dtype=np.int64)
    time_ns = seq * servo.period_ns + wait_ns
    reading, commanded, applied, estimated, energy, position = trace
    unknown = np.full(ticks, np.nan)
    elapsed = np.multiply(time_ns, 1e-9, dtype=np.float64)
    age = (time_ns - timing.answered * servo.period_ns) * 1e-9
    return TelemetryColumns(
        time=(time_ns - time_ns[int(np.argmax(timing.engagement > 0.0))]) * 1e-9,
        time_ns=time_ns,
        seq=seq,
        elapsed=elapsed,
        position=reading[:, np.newaxis],
        commanded_force=commanded[:, np.newaxis],
        applied_force=applied[:, np.newaxis],
        torques=unknown[:, np.newaxis],
        force_limit=unknown,
        estimated_energy=estimated,
        true_energy=energy,
        true_position=position[:, np.newaxis],
        hand_force=unknown[:, np.newaxis],
        engagement=timing.engagement,
        device_seq=timing.answered,
        is_told=np.zeros(ticks, dtype=np.bool_),
        proxy=unknown[:, np.newaxis],
        normal=unknown[:, np.newaxis],
        loop_delay=np.where(timing.answered >= 0, age, np.nan),
        reply_age=np.where(timing.answered >= 0, age, np.nan),
        deadline_misses=np.zeros(ticks, dtype=np.int64),
        rejected=timing.rejected,
    )
