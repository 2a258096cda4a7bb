r"""An arm of two links whose joints hold torques, with the hand's energy taken at the tip.

The ledger runs in the joints. Here the hand moves the *tip* straight and uniformly, so the joints
do not, and the energy is what the hand's force does at the tip:

.. math:: E = \int F_h \cdot v \, dt, \qquad J^T F_h = b \omega + \tau_{friction} + \tau_{motor}

by Gauss-Legendre quadrature over short pieces, to rounding.
"""

import math

import numpy as np

from forcebound.compiled import outlined
from forcebound_proofs.paths.truth import AXES, Device, Floats, given, relax, walk, work_of_axis

LINKS = (0.25, 0.2)  # m
FIRST_POSE = (0.4, 1.3)  # rad, where the encoders read zero
PARTS = 4  # of a move
FOLDED, STRETCHED = 2.6, 0.3  # rad, of the elbow: between them the tip goes straight

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


@outlined
def tip_of(first: float, second: float) -> tuple[float, float]:
    """Return the place of the tip, m, for the two angles, rad, from the first pose."""
    shoulder = FIRST_POSE[0] + first
    elbow = shoulder + FIRST_POSE[1] + second
    return (
        LINKS[0] * math.cos(shoulder) + LINKS[1] * math.cos(elbow),
        LINKS[0] * math.sin(shoulder) + LINKS[1] * math.sin(elbow),
    )


@outlined
def angles_of(x: float, y: float) -> tuple[float, float]:
    """Return the two angles, rad, from the first pose, elbow on one side."""
    square = x * x + y * y
    cosine = (square - LINKS[0] ** 2 - LINKS[1] ** 2) / (2.0 * LINKS[0] * LINKS[1])
    bend = math.acos(min(max(cosine, -1.0), 1.0))
    shoulder = math.atan2(y, x) - math.atan2(
        LINKS[1] * math.sin(bend), LINKS[0] + LINKS[1] * math.cos(bend)
    )
    return shoulder - FIRST_POSE[0], bend - FIRST_POSE[1]


@outlined
def jacobian(first: float, second: float) -> tuple[float, float, float, float]:
    """Return a, b, c, d of J = [[a, c], [b, d]], in m, for the two angles from the first pose."""
    shoulder = FIRST_POSE[0] + first
    elbow = shoulder + FIRST_POSE[1] + second
    c, d = -LINKS[1] * math.sin(elbow), LINKS[1] * math.cos(elbow)
    return c - LINKS[0] * math.sin(shoulder), d + LINKS[0] * math.cos(shoulder), c, d


@outlined
def power_at_tip(
    first: float, second: float, speed_x: float, speed_y: float, device: Device, torque: Floats
) -> float:
    """Return the power of the hand, W, at the tip, against damping and motors."""
    a, b, c, d = jacobian(first, second)
    size = a * d - b * c
    turn_1 = (d * speed_x - c * speed_y) / size
    turn_2 = (a * speed_y - b * speed_x) / size
    torque_1 = device.damping[0] * turn_1 + torque[0]
    torque_2 = device.damping[1] * turn_2 + torque[1]
    force_x = (d * torque_1 - b * torque_2) / size  # J^-T
    force_y = (a * torque_2 - c * torque_1) / size
    return float(force_x * speed_x + force_y * speed_y)


@outlined
def turn_rate(axis: int, first: float, second: float, speed_x: float, speed_y: float) -> float:
    """Return a number with the sign of a joint's speed while the tip moves straight."""
    a, b, c, d = jacobian(first, second)
    turn = d * speed_x - c * speed_y if axis == 0 else a * speed_y - b * speed_x
    return float(turn * math.copysign(1.0, a * d - b * c))


@outlined
def rub(
    device: Device,
    axis: int,
    line: tuple[float, float, float, float],
    start: float,
    end: float,
    angle: float,
) -> float:
    """Move the bristle of a joint along a straight ``line`` of the tip; return the work, in J.

    A joint that turns round within the piece goes to its turning point and back.
    """
    x, y, speed_x, speed_y = line
    low, high = start, end
    one, two = angles_of(x + speed_x * low, y + speed_y * low)
    before = turn_rate(axis, one, two, speed_x, speed_y)
    one, two = angles_of(x + speed_x * high, y + speed_y * high)
    work = 0.0
    if before * turn_rate(axis, one, two, speed_x, speed_y) < 0.0:
        for _ in range(50):
            middle = (low + high) / 2.0
            one, two = angles_of(x + speed_x * middle, y + speed_y * middle)
            if before * turn_rate(axis, one, two, speed_x, speed_y) > 0.0:
                low = middle
            else:
                high = middle
        turning = one if axis == 0 else two
        work = work_of_axis(device, axis, turning - device.position[axis])
        device.position[axis] = turning
    work += work_of_axis(device, axis, angle - device.position[axis])
    device.position[axis] = angle
    return work


@outlined
def is_within_reach(
    elbow: float, end_elbow: float, x: float, y: float, end_x: float, end_y: float
) -> bool:
    """Return whether the tip can go straight with the elbow between folded and stretched."""
    low, high = min(elbow, end_elbow) + FIRST_POSE[1], max(elbow, end_elbow) + FIRST_POSE[1]
    way_x, way_y = end_x - x, end_y - y
    square = way_x * way_x + way_y * way_y
    nearest = min(max(-(x * way_x + y * way_y) / square, 0.0), 1.0) if square > 0.0 else 0.0
    near = (x + nearest * way_x) ** 2 + (y + nearest * way_y) ** 2
    folded = LINKS[0] ** 2 + LINKS[1] ** 2 + 2.0 * LINKS[0] * LINKS[1] * math.cos(FOLDED)
    return bool(low > STRETCHED and high < FOLDED and near > folded)


@outlined
def walk_at_tip(device: Device, duration: float, move: Floats) -> float:
    """Move the tip straight to where ``move`` of the joints ends; return the hand's energy, J.

    Where it cannot, near the stretched or the folded arm, the joints move uniformly.
    """
    first, second = device.position[0], device.position[1]
    x, y = tip_of(first, second)
    end_x, end_y = tip_of(first + move[0], second + move[1])
    if not is_within_reach(second, second + move[1], x, y, end_x, end_y):
        return walk(device, duration, move)
    speed_x, speed_y = (end_x - x) / duration, (end_y - y) / duration
    lag, energy = device.lag, 0.0
    torque = np.zeros(AXES)
    part = duration / PARTS
    for number in range(PARTS):
        for node in range(len(_NODES)):
            after = part * (1.0 + _NODES[node]) / 2.0
            now = number * part + after
            angle_1, angle_2 = angles_of(x + speed_x * now, y + speed_y * now)
            left = math.exp(-after / lag) if lag > 0.0 else 0.0
            a, b, c, d = jacobian(angle_1, angle_2)
            for axis in range(2):
                target = device.target[axis]
                torque[axis] = target + (device.output[axis] - target) * left
                torque[axis] *= device.gain[axis]
                turn = turn_rate(axis, angle_1, angle_2, speed_x, speed_y) / abs(a * d - b * c)
                length = _WEIGHTS[node] / 2.0 * part
                work = length * torque[axis] * turn
                torque[axis] *= given(device, axis, work) / work if work != 0.0 else 1.0
                torque[axis] += device.weight[axis]
            power = power_at_tip(angle_1, angle_2, speed_x, speed_y, device, torque)
            energy += _WEIGHTS[node] / 2.0 * part * power
        end = (number + 1) * part
        angle_1, angle_2 = angles_of(x + speed_x * end, y + speed_y * end)
        if number == PARTS - 1:
            angle_1, angle_2 = first + move[0], second + move[1]
        line = (x, y, speed_x, speed_y)
        energy += rub(device, 0, line, number * part, end, angle_1)
        energy += rub(device, 1, line, number * part, end, angle_2)
        relax(device, part)
    return energy
