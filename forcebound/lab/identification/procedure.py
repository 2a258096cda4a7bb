"""The procedure of an identification: experiments in order, and what is made of them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from forcebound.errors import DeviceError
from forcebound.haptics.devices import Device, DeviceModel
from forcebound.lab.identification import estimators, experiments
from forcebound.lab.identification.drive import BANDWIDTH, Drive
from forcebound.lab.identification.estimators import Bounded, Cell
from forcebound.lab.identification.experiments import Kick, Pass, points_of
from forcebound.lab.identification.gain import gain
from forcebound.lab.identification.lag import lag_of
from forcebound.lab.identification.rig import Clock, Limits, Rig, rest
from forcebound.messages.packets import Vector

RANGE = 0.7  # share of the reach that is measured; the rest is for turning
BEYOND = 1.4  # times the reach: the rig stops there
TOO_FAST = 4.0  # times the largest speed of the passes
FINER = 3  # times the parts of the range: where cogging is looked for
TURNS = 4  # damping and inertia each need the other
SETTLED = 2.5  # time constants of the position control, until a speed is even
PUSHED = 0.8  # share of what friction holds
WEIGHED = 0.4  # share of the reach and of the largest speed, with a weight
MOST_LOAD = 0.8  # share of the friction


@dataclass(frozen=True)
class Plan:
    """How an identification goes."""

    reach: float  # m (rad), how far each axis may move from where it begins
    force: float  # N (N m), largest of an axis
    rate: float = 1000.0  # Hz, of reading and writing
    levels: tuple[float, ...] = (0.15, 0.4, 1.0)  # speeds of the passes, shares of the largest
    poses: tuple[float, ...] = (-1.0, 0.0, 1.0)  # of the other axes, shares of the range
    repeats: int = 2  # of each pass
    parts: int = 8  # of the range; friction is found in each
    pushes: int = 36  # below the friction; for presliding
    strokes: int = 24  # with a force that jumps; for the lag
    weight: float = 0.0  # N (N m), that the user hangs on each axis, for the gain; 0: none


@dataclass(frozen=True, kw_only=True)
class Loss:
    """Result of the passes of an axis; a bound is on the careful side."""

    damping: Bounded  # b, in N s/m (joints: N m s)
    friction: Bounded  # f_c, in N (N m), least of all places
    friction_of_parts: dict[Cell, float]  # estimates
    #: Force that depends on the place (weight, cogging), in N (N m), positive against positive
    #: motion: its mean; the bound is of the largest, without sign.
    load: Bounded
    inertia: float  # kg (kg m^2)


@dataclass(frozen=True, kw_only=True)
class AxisFound(Loss):
    """Identified numbers of one axis."""

    presliding: Bounded  # z_m, in m (rad)
    resolution: Bounded  # of the encoder, in m (rad)
    lag: Bounded | None  # of the amplifier, in s; None: it cannot be found, as with late ticks


@dataclass(frozen=True)
class Found:
    """Identified numbers of a device."""

    axes: tuple[AxisFound, ...]
    measured_range: tuple[tuple[float, float], ...]  # m (rad), least and largest place of each axis
    #: From reading to the effect of the write, in s: median, and what 999 of 1000 writes keep.
    write_delay: Bounded
    interval: Bounded  # s, between two writes, alike
    #: Of each motor, force over command; None: not measured; empty: of none.
    gain: tuple[Bounded | None, ...] = ()


def identify(
    device: Device,
    model: DeviceModel,
    clock: Clock,
    plan: Plan,
    report: Callable[[str], None] = lambda line: None,
    middle: Vector | None = None,
) -> Found:
    """Return the identified numbers of a device that nobody holds.

    Args:
        device: Open, at rest.
        model: What it states.
        clock: Real or virtual.
        plan: How far, how hard, how often.
        report: Is called with what comes next.
        middle: Readings in the middle of the workspace; None: where the device is now.

    Raises:
        DeviceError: If the device fails, does not move, moves the wrong way, too fast or too far,
            or this machine was late while a force was on.
    """
    wide = Limits(plan.force, math.inf, BEYOND * plan.reach)
    rig = Rig(device, clock, 1.0 / plan.rate, wide, holds=model.watchdog == "none")
    axes = range(rig.axes)
    report("at rest: noise of the encoders")
    resting = rest(rig).readings
    drive, kicks = _first_look(rig, rig.start if middle is None else middle, plan, report)
    speeds = [_largest_speed(drive, axis, plan) for axis in axes]
    passes = []
    for axis in axes:
        report(f"axis {axis + 1}: there and back at several speeds, over its range")
        passes.append(_passes(drive, axis, speeds[axis], plan))
    rig.release()  # no force stays on while this is computed
    spans = tuple((x - RANGE * plan.reach, x + RANGE * plan.reach) for x in rig.start)
    losses = [_loss_of(*one, plan) for one in zip(passes, kicks, spans, strict=True)]
    drive.take_over(rest(rig, experiments.STOPPING).readings[-1].tolist())
    report("there and back with a force that jumps: does it come late?")
    strokes = [
        experiments.strokes(drive, axis, speeds[axis], plan.reach, plan.strokes) for axis in axes
    ]
    report("pushes below the friction: how far does it yield?")
    forces = tuple(_below_friction(axis, one) for axis, one in enumerate(losses))
    yielded = experiments.pushes(drive, forces, plan.pushes)
    gains = _gains(drive, losses, speeds, plan, report) if plan.weight else ()
    rig.release()
    found = []
    for axis, loss in enumerate(losses):
        moving = np.concatenate([one.trace.readings[:, axis] for one in passes[axis]])
        resolution = estimators.resolution(moving, resting[:, axis])
        presliding = estimators.presliding(
            yielded[:, axis], forces[axis], loss.friction, resolution.estimate
        )
        lag = lag_of(strokes[axis], loss.damping.estimate)
        found.append(AxisFound(**vars(loss), presliding=presliding, resolution=resolution, lag=lag))
    delay, interval = _largest(rig.delays), _largest(rig.intervals)
    return Found(tuple(found), spans, delay, interval, gains)


def _gains(
    drive: Drive,
    losses: Sequence[Loss],
    speeds: Sequence[float],
    plan: Plan,
    report: Callable[[str], None],
) -> tuple[Bounded | None, ...]:
    """Gains of the motors whose weight was hung; a failure is reported, and ends nothing."""
    gains: list[Bounded | None] = [None] * len(losses)
    try:
        for axis, one in enumerate(losses):
            reach, speed = WEIGHED * plan.reach, WEIGHED * speeds[axis]
            friction = one.friction.upper
            gains[axis] = gain(drive, axis, plan.weight, friction, reach, speed, report)
    except DeviceError as error:
        report(f"{error}. What was measured before is kept")
    return tuple(gains) if any(gains) else ()


def _first_look(
    rig: Rig, middle: Vector, plan: Plan, report: Callable[[str], None]
) -> tuple[Drive, list[list[Kick]]]:
    """Return the drive of the axes, now in the middle, and the kicks of each."""
    report("a slow ramp on each axis: does it move, and the right way?")
    kicks, rough = [], []
    for axis in range(rig.axes):
        inwards = 1 if middle[axis] >= rig.start[axis] else -1
        sides = (inwards, -inwards)
        started = max(experiments.start_to_move(rig, axis, side) for side in sides)
        report(f"axis {axis + 1} moves at {started:.3g}; short pushes: how heavy is it?")
        kicks.append([experiments.kick(rig, axis, side, started) for side in (*sides, *sides)])
        rough.append(experiments.rough_of(kicks[-1], started))
    drive = Drive(rig, rough)
    speeds = [_largest_speed(drive, axis, plan) for axis in range(rig.axes)]
    experiments.centre(drive, middle, speeds)
    rig.limits = Limits(plan.force, TOO_FAST * max(speeds), BEYOND * plan.reach)
    return drive, kicks


def _largest_speed(drive: Drive, axis: int, plan: Plan) -> float:
    """Speed that an axis reaches, and settles at, within the part of the reach for turning."""
    room, acceleration = (1.0 - RANGE) * plan.reach, drive.acceleration(axis)
    lag = SETTLED / BANDWIDTH
    return acceleration * (math.sqrt(lag * lag + 2.0 * room / acceleration) - lag)


def _passes(drive: Drive, axis: int, speed: float, plan: Plan) -> list[Pass]:
    start, axes = drive.rig.start, drive.rig.axes
    found: list[Pass] = []
    poses = plan.poses if axes > 1 else (0.0,)
    count = 2 * plan.repeats if axes > 1 else 4 * plan.repeats
    for pose, share in enumerate(poses):
        for other in range(axes):
            if other != axis:
                drive.go(other, start[other] + RANGE * plan.reach * share, speed)
        drive.go(axis, start[axis] - plan.reach, speed)
        for level, part in enumerate(plan.levels):
            found += experiments.there_and_back(
                drive, axis, plan.reach, part * speed, count, pose, level
            )
    for each in range(axes):
        drive.go(each, start[each], speed)
    return found


def _loss_of(
    passes: Sequence[Pass], kicks: Sequence[Kick], span: tuple[float, float], plan: Plan
) -> Loss:
    """Damping and friction of an axis, from its passes.

    Raises:
        DeviceError: If it did not move evenly enough.
    """
    raw = points_of(passes, *span, 1)
    slower = [one for one in passes if one.level < len(plan.levels) - 1]
    raw_slow = points_of(slower, *span, plan.parts)
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
            f"axis {passes[0].axis + 1}: its damping, {damping.estimate:.3g}, cannot be"
            " distinguished from 0 at these speeds: a larger --reach lets it move faster. Without"
            " damping no law can show a force beyond the friction"
        )
    slow = [one.at_rest(inertia) for one in raw_slow]
    friction, parts = estimators.friction(slow, damping)
    least = estimators.below_all(whole, damping.lower, friction.lower)
    friction = Bounded(friction.estimate, least, friction.upper)
    slowest = [one for one in passes if one.level == 0]
    fine = [one.at_rest(inertia) for one in points_of(slowest, *span, FINER * plan.parts)]
    return Loss(
        damping=damping,
        friction=friction,
        friction_of_parts=parts,
        load=estimators.load(fine),
        inertia=inertia,
    )


def _below_friction(axis: int, losses: Loss) -> float:
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


def _largest(times: Sequence[float]) -> Bounded:
    """The median, and what 999 of 1000 keep, with a twentieth more for what was not seen.

    The rest is up to this machine: each run measures its own late writes, counts and pays for them.
    """
    usual, most = np.quantile(np.array(times), (0.5, 0.999))
    return Bounded(float(usual), min(times), 1.05 * float(most))
