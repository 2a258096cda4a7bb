"""Ground truth of an attack on a certificate: energy along a chosen path, without inertia.

The tip moves on straight lines; between two events (a reading, a write, a cut by the watchdog) it
makes :data:`PIECES` of them. In each piece every term of the energy is known in closed form:

* viscous loss, b v² h;
* friction: f_c times the way, along the path or on each axis by itself. With presliding, the
  friction acts on a bristle: it follows the tip elastically over z_m, and then slides. The energy
  that it stores is the hand's, too, so it counts as not lost;
* work against the motor, whose force relaxes to the written one with the time constant of the
  amplifier's lag, and has an error of gain;
* work against a weight that is not compensated.

Inertia would only add: the energy that the hand puts in is this energy and the kinetic one.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.devices.plant import quantise

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

PIECES = 3  # straight lines between two events


class TrueDevice(NamedTuple):
    """What the device really is; arrays have one number for each axis."""

    damping: Floats  # N s/m
    friction: Floats  # N; alike on all axes if it acts along the path
    presliding: Floats  # m; likewise
    half_resolution: Floats  # m
    weight: Floats  # N, that nothing compensates
    acts_on_each_axis: bool  # of friction
    gain: float  # force of the motor per written force
    lag: float  # s, time constant of the amplifier; 0: none
    largest_speed: float  # m/s, that the hand never exceeds


class Plan(NamedTuple):
    """The path, as far as it does not depend on the forces; one row for each sample."""

    read_ns: Integers  # time of the reading
    write_ns: Integers  # time at which the force of this sample takes effect
    cut_ns: Integers  # after the write, when the watchdog drops the force
    punctual_ns: Integers  # after the write, until when the hold is punctual
    rest_ns: Integers  # when the drift begins or ends, in the interval before the sample
    rests_first: Integers  # 1: the drift begins there; 0: it ends
    drift: Floats  # m/s, shape (samples, axes)
    tremor: Floats  # m, shape (samples, axes): way in the interval before the sample, besides
    thief: Floats  # speed as a share of that which takes the most energy
    commanded: Floats  # N, shape (samples, axes)
    glitch: Floats  # m, what a reading is wrong by besides, shape (samples, axes)
    applied: Floats  # share of the bounded force that the device applies
    error: Floats  # of readings, in half resolutions, shape (samples, axes)


# Rows of the state of the device's axes, and places in its energies and times.
POSITION, BRISTLE, MOTOR, WRITTEN = range(4)
ENERGY, AT_WRITE, LOWEST, LOWEST_PUNCTUAL = range(4)
WRITTEN_NS, CUT_AT_NS, WAS_CUT_NS, LATE_SINCE_NS = range(4)
NEVER = np.iinfo(np.int64).max // 2


class Motion(NamedTuple):
    """The state of the device."""

    axes: Floats  # of each axis, shape (4, axes)
    energies: Floats  # now, at the last write, and the lowest of this interval, see `walk`
    times: Integers  # ns: of the last write, its cut, the last cut that happened, and lateness


def start(axes: int) -> Motion:
    """Return the state at rest."""
    return Motion(np.zeros((4, axes)), np.zeros(4), np.full(4, NEVER))


def walk(
    n: int,
    sensor: int,
    plan: Plan,
    device: TrueDevice,
    force: Floats,
    axes: Floats,
    energies: Floats,
    times: Integers,
    readings: Floats,
) -> tuple[float, float, float, int]:
    """Go from reading ``n - 1`` to reading ``n``; ``force`` is the one written between them.

    Args:
        n: Sample, at least 1.
        sensor: Kind of reading error.
        plan: The path.
        device: The device.
        force: In N, shape (axes,).
        axes: State of each axis, see :class:`Motion`; with ``energies`` and ``times`` it changes.
        energies: See :class:`Motion`.
        times: See :class:`Motion`.
        readings: Of this sample, and at the cut, shape (2, axes); they change.

    Returns:
        The energy; the lowest since the last reading; the most by which a punctual hold has brought
        it below what it had and below zero, in J; and the time of the last cut, in ns, or 0.
    """
    now, end, write = plan.read_ns[n - 1], plan.read_ns[n], plan.write_ns[n - 1]
    times[WAS_CUT_NS] = 0
    energies[LOWEST], energies[LOWEST_PUNCTUAL] = energies[ENERGY], 0.0
    while True:
        if now == write:
            axes[WRITTEN] = force
            times[WRITTEN_NS], times[CUT_AT_NS] = write, write + plan.cut_ns[n - 1]
            times[LATE_SINCE_NS] = write + plan.punctual_ns[n - 1]
            energies[AT_WRITE] = energies[ENERGY]
        if now >= end:
            break
        if now == times[CUT_AT_NS]:
            axes[WRITTEN] = 0.0
            times[WAS_CUT_NS] = now
            read(n, sensor, plan, device, axes, readings[1])
        until = end
        for event in (write, times[CUT_AT_NS], times[LATE_SINCE_NS], plan.rest_ns[n]):
            if now < event < until:
                until = event
        is_punctual = until <= times[LATE_SINCE_NS]
        drifts = plan.rests_first[n] == (now >= plan.rest_ns[n])
        share = (until - now) / (end - plan.read_ns[n - 1])
        move(n, plan, device, (until - now) * 1e-9, share, drifts, is_punctual, axes, energies)
        now = until
    read(n, sensor, plan, device, axes, readings[0])
    return energies[ENERGY], energies[LOWEST], energies[LOWEST_PUNCTUAL], times[WAS_CUT_NS]


def move(
    n: int,
    plan: Plan,
    device: TrueDevice,
    duration: float,
    share: float,
    drifts: bool,
    is_punctual: bool,
    axes: Floats,
    energies: Floats,
) -> None:
    """Move in :data:`PIECES` straight lines for ``duration``, in s, ``share`` of the interval."""
    h = duration / PIECES
    for _ in range(PIECES):
        velocity = plan.tremor[n] * (share / duration)
        if drifts:
            velocity += plan.drift[n]
        velocity += plan.thief[n] * best_theft(device, axes[MOTOR] + device.weight)
        speed = math.sqrt(np.sum(velocity * velocity))
        if speed > device.largest_speed:
            velocity *= device.largest_speed / speed
        step = velocity * h
        spent = np.sum(device.damping * velocity * velocity) * h + np.sum(device.weight * step)
        spent += work_of_motor(device, step, h, axes) + work_of_friction(device, step, axes)
        axes[POSITION] += step
        energies[ENERGY] += spent
        energies[LOWEST] = min(energies[LOWEST], energies[ENERGY])
        if is_punctual:
            fall = energies[ENERGY] - min(energies[AT_WRITE], 0.0)
            energies[LOWEST_PUNCTUAL] = min(energies[LOWEST_PUNCTUAL], fall)


def best_theft(device: TrueDevice, force: Floats) -> Floats:
    """Return the velocity, in m/s, at which a ``force``, in N, gives the most energy away."""
    if device.acts_on_each_axis:
        excess = np.maximum(np.abs(force) - device.friction, 0.0)
        return np.asarray(-np.sign(force) * excess / (2.0 * device.damping))
    size = math.sqrt(np.sum(force * force))
    excess_share = max(1.0 - device.friction[0] / size, 0.0) if size > 0.0 else 0.0
    return np.asarray(-force * (excess_share / (2.0 * device.damping[0])))


def work_of_motor(device: TrueDevice, step: Floats, h: float, axes: Floats) -> float:
    """Let the motor's force relax for ``h``, in s; return the work against it, in J."""
    work = 0.0
    for i in range(step.size):
        target = device.gain * axes[WRITTEN, i]
        if device.lag > 0.0:
            left = -math.expm1(-h / device.lag)
            mean = target + (axes[MOTOR, i] - target) * left * device.lag / h
            axes[MOTOR, i] += (target - axes[MOTOR, i]) * left
        else:
            mean = axes[MOTOR, i] = target
        work += mean * step[i]
    return work


def work_of_friction(device: TrueDevice, step: Floats, axes: Floats) -> float:
    """Move the bristles by ``step``, in m; return the energy lost or stored, in J.

    Of all ways to keep the bristles' ends within z_m of the tip, they go the shortest.
    """
    bristle = axes[BRISTLE]
    if device.acts_on_each_axis:
        work = 0.0
        for i in range(step.size):
            length = abs(bristle[i] + step[i])
            work += pull(device.friction[i], device.presliding[i], abs(bristle[i]), length)
            bristle[i] += step[i]
            if length > device.presliding[i]:
                bristle[i] *= device.presliding[i] / length
        return work
    before = math.sqrt(np.sum(bristle * bristle))
    bristle += step
    length = math.sqrt(np.sum(bristle * bristle))
    if length > device.presliding[0]:
        bristle *= device.presliding[0] / length
    return pull(device.friction[0], device.presliding[0], before, length)


def pull(friction: float, presliding: float, before: float, length: float) -> float:
    """Return the energy, in J, that friction takes when its bristle is pulled to ``length``, in m.

    What it had stored ``before``, in m, comes back; what is longer than ``presliding`` slides.
    """
    if presliding <= 0.0:
        return friction * length
    kept = min(length, presliding)
    stored = (kept * kept - before * before) / (2.0 * presliding)
    return friction * (length - kept + stored)


def read(
    n: int, sensor: int, plan: Plan, device: TrueDevice, axes: Floats, readings: Floats
) -> None:
    """Read each axis at sample ``n``, at most half a resolution wrong."""
    for i in range(readings.size):
        r, x = device.half_resolution[i], axes[POSITION, i]
        if sensor == 0:
            readings[i] = quantise(x, 2.0 * r)
        elif sensor == 1:
            readings[i] = x + r * plan.error[n, i]
        elif sensor == 2:
            readings[i] = x + math.copysign(r, plan.error[n, i])
        elif sensor == 3:
            readings[i] = x + math.copysign(r, plan.drift[n, i] - axes[WRITTEN, i])
        else:
            readings[i] = x - math.copysign(r, plan.commanded[n, i] - axes[WRITTEN, i])
