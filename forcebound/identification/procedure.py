"""The procedure of an identification: experiments in order, and what is made of them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from forcebound.devices import Device, DeviceModel
from forcebound.errors import DeviceError
from forcebound.identification import estimators, experiments, helped
from forcebound.identification.clock import Clock
from forcebound.identification.drive import BANDWIDTH, Drive
from forcebound.identification.estimators import Bounded, Floats, Point
from forcebound.identification.experiments import Kick, Pass
from forcebound.identification.lag import lag_of
from forcebound.identification.rig import Limits, Rig, Trace, rest
from forcebound.identification.stalls import Result, lateness, recover, repeated
from forcebound.identification.windows import points_of
from forcebound.messages.packets import Vector

RANGE = 0.7  # share of the reach that is measured; the rest is for turning
BEYOND = 1.4  # times the reach: the rig stops there
TOO_FAST = 4.0  # times the largest speed of the passes
FINER = 3  # times the parts of the range: where cogging is looked for
TURNS = 4  # damping and inertia each need the other
SETTLED = 2.5  # time constants of the position control, until a speed is even
PUSHED = 0.8  # share of what friction holds
WEIGHED, SLOW = 0.4, 0.4  # share of the reach and of the largest speed, with a weight
MOST_LOAD = 0.8  # share of the friction


@dataclass(frozen=True)
class Plan:
    """How an identification goes.

    Attributes:
        reach: How far each axis may move from where it begins, in m (rad).
        force: Largest force of an axis, in N (N m).
        rate: Of reading and writing, in Hz.
        levels: Speeds of the passes, as shares of the largest.
        poses: Of the other axes, as shares of the range.
        repeats: Of each pass.
        parts: Of the range; friction is found in each.
        pushes: Below the friction; for presliding.
        strokes: With a force that jumps; for the lag.
        weight: Force of the weight that the user hangs on each axis, in N (N m), for the gain; 0:
            none.
        by_hand: Time for which the user moves the device, in s, for the largest speed; 0: none.
    """

    reach: float
    force: float
    rate: float = 1000.0
    levels: tuple[float, ...] = (0.15, 0.4, 1.0)
    poses: tuple[float, ...] = (-1.0, 0.0, 1.0)
    repeats: int = 2
    parts: int = 8
    pushes: int = 36
    strokes: int = 24
    weight: float = 0.0
    by_hand: float = 0.0


@dataclass(frozen=True)
class AxisFound:
    """What was found of one axis; a bound is on the careful side.

    Attributes:
        damping: b, in N s/m (joints: N m s).
        friction: f_c, in N (N m), least of all places.
        friction_of_parts: Estimate by pose of the other axes and part of the range.
        presliding: z_m, in m (rad).
        resolution: Of the encoder, in m (rad).
        lag: Of the amplifier, in s; None: it cannot be told, such as with late ticks.
        load: Force that depends on the place (weight, cogging), in N (N m), positive against
            positive motion: its mean; the bound is of the largest, without sign.
        inertia: In kg (kg m^2).
        decay: Loss in free motion over what damping and friction say: 1 if they agree.
        speeds: From slowest to fastest, in m/s (rad/s).
        passes: What damping was found from: whole passes, there and back.
    """

    damping: Bounded
    friction: Bounded
    friction_of_parts: dict[tuple[int, int], float]
    presliding: Bounded
    resolution: Bounded
    lag: Bounded | None
    load: Bounded
    inertia: float
    decay: float
    speeds: tuple[float, ...]
    passes: tuple[Point, ...]


@dataclass(frozen=True)
class Found:
    """What was found of a device.

    Attributes:
        axes: Of each axis.
        measured_range: Least and largest place of each axis, in m (rad).
        duration: Of the identification, in s.
        write_delay: From reading to the effect of the write, in s: median, and what 999 of 1000
            writes keep.
        interval: Between two writes, in s, alike.
        gain: What each motor gives over what it is told; empty: not measured.
        largest_speed: Of a motion by hand, of all axes together, in m/s (rad/s); None: not
            measured.
    """

    axes: tuple[AxisFound, ...]
    measured_range: tuple[tuple[float, float], ...]
    duration: float
    write_delay: Bounded
    interval: Bounded
    gain: tuple[Bounded, ...] = ()
    largest_speed: Bounded | None = None


def identify(
    device: Device,
    model: DeviceModel,
    clock: Clock,
    plan: Plan,
    say: Callable[[str], None] = lambda line: None,
    middle: Vector | None = None,
    bring_back: Callable[[], object] = lambda: None,
) -> Found:
    """Return what is found of a device that nobody holds.

    Args:
        device: Open, at rest.
        model: What it states.
        clock: Real or virtual.
        plan: How far, how hard, how often.
        say: Is told what comes next.
        middle: Readings in the middle of the workspace; None: where the device is now.
        bring_back: Lets somebody bring the device back to where it is now, after a stall of the
            machine has thrown it far away.

    Raises:
        DeviceError: If the device fails, does not move, moves the wrong way, too fast or too far.
    """
    holds = model.watchdog == "none"
    wide = Limits(plan.force, math.inf, BEYOND * plan.reach)
    rig = Rig(device, clock, 1.0 / plan.rate, wide, holds, bring_back)
    say("at rest: noise of the encoders")
    resting = rest(rig)
    kicks, drive, speeds = _first_look(rig, rig.start if middle is None else middle, plan, say)
    passes: list[list[Pass]] = []
    for axis in range(rig.axes):
        say(f"axis {axis + 1}: there and back at several speeds, over its range")
        passes.append(_passes(drive, axis, speeds[axis], plan))
    rig.release()  # no force stays on while this is computed
    half = RANGE * plan.reach
    span = tuple((start - half, start + half) for start in rig.start)
    losses = [_losses(*one, plan) for one in zip(passes, kicks, span, strict=True)]
    drive.take_over(rest(rig, experiments.STOPPING).readings[-1])
    strokes: list[list[Pass]] = [[] for _ in range(rig.axes)]
    if plan.strokes:
        say("there and back with a force that jumps: does it come late?")
        for axis, own in enumerate(strokes):
            own += experiments.strokes(drive, axis, speeds[axis], plan.reach, plan.strokes)
    say("pushes below the friction: how far does it yield?")
    forces = tuple(_below_friction(axis, one) for axis, one in enumerate(losses))
    pushed = experiments.pushes(drive, forces, plan.pushes)
    gain, largest_speed = _helped(drive, losses, speeds, plan, say)
    rig.release()
    if rig.repetitions:
        say(f"movements begun anew: {rig.repetitions}. {lateness(rig)}")
    axes = tuple(
        _axis(
            losses[axis], passes[axis], strokes[axis], resting, kicks[axis],
            np.array([push.yielded[axis] for push in pushed]), forces[axis],
        )
        for axis in range(rig.axes)
    )  # fmt: skip
    return Found(
        axes,
        span,
        rig.elapsed,
        _largest(rig.delays),
        _largest(rig.intervals),
        gain,
        largest_speed,
    )


def _helped(
    drive: Drive,
    losses: Sequence["_Losses"],
    speeds: Sequence[float],
    plan: Plan,
    say: Callable[[str], None],
) -> tuple[tuple[Bounded, ...], Bounded | None]:
    """Gains and largest speed, as far as the user wants and helps; a failure is said."""
    gains: list[Bounded] = []
    largest_speed = None
    try:
        for axis, one in enumerate(losses if plan.weight else ()):
            way = WEIGHED * plan.reach, SLOW * speeds[axis]
            found = helped.gain(drive, axis, plan.weight, one.friction.upper, way, say)
            gains += [] if found is None else [found]
        if plan.by_hand:
            largest_speed = helped.largest_speed(drive.rig, WEIGHED * plan.reach, plan.by_hand, say)
    except DeviceError as error:
        say(f"{error}. What was measured before is kept")
    return tuple(gains) if len(gains) == len(losses) else (), largest_speed


def _first_look(
    rig: Rig, middle: Vector, plan: Plan, say: Callable[[str], None]
) -> tuple[list[list[Kick]], Drive, list[float]]:
    """What short pushes say of each axis, its drive, now in the middle, and its largest speed."""
    say("a slow ramp on each axis: does it move, and the right way?")
    kicks, rough = [], []
    for axis in range(rig.axes):
        inwards = 1 if middle[axis] >= rig.start[axis] else -1
        sides = (inwards, -inwards)
        started = max(
            _steadily(rig, partial(experiments.start_to_move, rig, axis, side)) for side in sides
        )
        say(f"axis {axis + 1} moves at {started:.3g}; short pushes: how heavy is it?")
        own: list[Kick] = []
        for side in (*sides, *sides):
            own.append(_steadily(rig, partial(experiments.kick, rig, axis, side, started)))
            rest(rig, experiments.STOPPING)
        kicks.append(own)
        rough.append(experiments.rough_of(own, started))
    drive = Drive(rig, rough)
    speeds = [_largest_speed(drive, axis, plan) for axis in range(rig.axes)]
    experiments.centre(drive, middle, speeds)
    rig.limits = Limits(plan.force, TOO_FAST * max(speeds), BEYOND * plan.reach)
    return kicks, drive, speeds


def _steadily(rig: Rig, movement: Callable[[], Result]) -> Result:
    return repeated(rig, movement, lambda: recover(rig))


def _largest_speed(drive: Drive, axis: int, plan: Plan) -> float:
    """Speed that an axis reaches, and settles at, within the part of the reach for turning."""
    room, acceleration = (1.0 - RANGE) * plan.reach, drive.acceleration(axis)
    lag = SETTLED / BANDWIDTH
    return acceleration * (math.sqrt(lag * lag + 2.0 * room / acceleration) - lag)


def _passes(drive: Drive, axis: int, speed: float, plan: Plan) -> list[Pass]:
    start = drive.rig.start
    found: list[Pass] = []
    poses = plan.poses if drive.rig.axes > 1 else (0.0,)
    repeats = plan.repeats if drive.rig.axes > 1 else 2 * plan.repeats
    for pose, share in enumerate(poses):
        for other in range(drive.rig.axes):
            if other != axis:
                drive.go(other, start[other] + RANGE * plan.reach * share, speed)
        drive.go(axis, start[axis] - plan.reach, speed)
        for level, part in enumerate(plan.levels):
            for _ in range(repeats):
                for side in (1, -1):
                    end = start[axis] + side * plan.reach
                    way, trace = drive.pass_along(axis, end, part * speed)
                    found.append(Pass(axis, pose, level, side, way, trace))
    for each in range(drive.rig.axes):
        drive.go(each, start[each], speed)
    return found


@dataclass(frozen=True)
class _Losses:
    damping: Bounded
    friction: Bounded
    parts: dict[tuple[int, int], float]
    load: Bounded
    inertia: float
    passes: tuple[Point, ...]


def _losses(
    passes: Sequence[Pass], kicks: Sequence[Kick], span: tuple[float, float], plan: Plan
) -> _Losses:
    """Damping and friction of an axis, from its passes.

    Raises:
        DeviceError: If it did not move evenly enough.
    """
    raw = points_of(passes, *span, 1)
    raw_slow = points_of(
        [one for one in passes if one.level < len(plan.levels) - 1], *span, plan.parts
    )
    if len(raw) < 5 or len(raw_slow) < 2 * plan.parts:
        raise DeviceError(
            f"axis {passes[0].axis + 1}: {len(raw)} of {len(passes) // 2} pairs of passes can be"
            " used: it did not follow its way, or ticks were late; see `forcebound doctor`"
        )
    damping = Bounded(0.0, 0.0, 0.0)
    for _ in range(TURNS):
        inertia = float(np.median([one.inertia(damping.estimate) for one in kicks]))
        whole = [one.at_rest(inertia) for one in raw]
        damping = estimators.slope(whole)
    if damping.lower <= 0.0:
        raise DeviceError(
            f"axis {passes[0].axis + 1}: its damping, {damping.estimate:.3g}, cannot be told from 0"
            " at these speeds: a larger --reach lets it move faster. Without damping no law can"
            " show a force beyond the friction"
        )
    slow = [one.at_rest(inertia) for one in raw_slow]
    friction, parts = estimators.friction(slow, damping)
    least = estimators.below_all(whole, damping.lower, friction.lower)
    friction = Bounded(friction.estimate, least, friction.upper)
    slowest = [one for one in passes if one.level == 0]
    fine = [one.at_rest(inertia) for one in points_of(slowest, *span, FINER * plan.parts)]
    return _Losses(damping, friction, parts, estimators.load(fine), inertia, tuple(whole))


def _below_friction(axis: int, losses: _Losses) -> float:
    """Force of pushes that let an axis yield, not slide.

    Raises:
        DeviceError: If its friction hardly holds what pulls at it.
    """
    friction, load = losses.friction.lower, losses.load.upper
    if load > MOST_LOAD * friction:
        raise DeviceError(
            f"axis {axis + 1}: weight, cogging or a spring pull at it with up to {load:.3g},"
            f" its friction is only {friction:.3g}: it would drift off by itself, and no law can"
            " promise anything. Balance it, or compensate the weight in the device"
        )
    return PUSHED * (friction - load)


def _axis(
    losses: _Losses,
    passes: Sequence[Pass],
    strokes: Sequence[Pass],
    resting: Trace,
    kicks: Sequence[Kick],
    yielded: Floats,
    force: float,
) -> AxisFound:
    axis = passes[0].axis
    moving = np.concatenate([one.trace.readings[:, axis] for one in passes])
    resolution = estimators.resolution(moving, resting.readings[:, axis])
    b, f = losses.damping, losses.friction
    decay = [losses.inertia * one.lost / (f.estimate + b.estimate * one.speed) for one in kicks]
    levels = sorted({one.level for one in passes})
    return AxisFound(
        damping=b,
        friction=f,
        friction_of_parts=losses.parts,
        presliding=estimators.presliding(yielded, force, f.estimate, f.upper, resolution.estimate),
        resolution=resolution,
        lag=lag_of(strokes, b.estimate),
        load=losses.load,
        inertia=losses.inertia,
        decay=float(np.median(decay)),
        speeds=tuple(next(p.way.top_speed for p in passes if p.level == n) for n in levels),
        passes=losses.passes,
    )


def _largest(times: Sequence[float]) -> Bounded:
    """The median, and what 999 of 1000 keep, with a twentieth more for what was not seen.

    The rest is up to this machine: each run measures its own late writes, counts and pays for them.
    """
    usual, most = np.quantile(np.array(times), (0.5, 0.999))
    return Bounded(float(usual), min(times), 1.05 * float(most))
