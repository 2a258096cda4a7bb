r"""The plant of an arm: joints with friction, and a hand at the tip.

Each joint has an inertia, a damper and Coulomb friction that may yield over a presliding
angle; the motor's torque may lag. The hand, a mass on a spring and a damper, is fixed to the tip
and pulls at the joints through the Jacobian :math:`J` of the pose. In place of its spring and
damper there may be walls across coordinates of the tip, and limits of the joints, which are springs
and dampers, too: in each step they act, or not, as the step begins. What a limit takes and gives
back counts as the hand's, as what a wall does.

**The step.** The implicit midpoint rule of :mod:`forcebound.haptics.devices.plant` in joint space:
with mean speeds :math:`\bar w`,

.. math::

    I \frac{2 (\bar w - w_0)}{h} + b \bar w + \tau_f + \bar\tau = \bar J^T f , \qquad
    f = k (x_t - \bar x) + c (v_t - \bar J \bar w) - m_h \frac{2 (\bar J \bar w - J_0 w_0)}{h}

with :math:`\bar J` the Jacobian at the angles that the joints have, at their first speeds, in the
middle of the step. :math:`f` is the force at the interface of hand and device: muscle less what
accelerates the hand's mass, centripetal part included. The equation for :math:`\bar w` is the
minimum of a strictly convex function (a quadratic form and the friction of each joint by itself);
sweeps over the joints, each solved exactly, find it.

**The energy** that flows from the hand into the device is :math:`\int f^T J w\,dt`; summed in
joints it is what the joints gain in kinetic energy, store in their bristles, lose, and give to the
motors. Each term of that sum is exact for the step's mean speeds, so the energy is exact to
rounding, whatever :math:`\bar w` is: what the step leaves out (the third order of the motion of the
tip, the last digits of the sweeps) changes which hand it was, never what the device got. The law
promises its bound for any hand. A joint that would turn back within a step stops instead, as in the
plain plant; the device loses a little more then than it states.

What is left out: the links' inertia as it changes with the pose (each joint's is constant), the
gravity of the links, their flexibility.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from forcebound.compiled import allow_in_kernels, jit
from forcebound.haptics.devices.kinematics import Floats, Pose
from forcebound.haptics.devices.plant import count_steps, mean_speed, quantise, yield_by

# Rows of the ``numbers`` of an arm, each with an entry per joint, or per coordinate of the tip.
ANGLE, SPEED, BRISTLE, TORQUE = 0, 1, 2, 3  # rad, rad/s, rad, N m: the joints
INERTIA, DAMPING, FRICTION, PRESLIDING, RESOLUTION = 4, 5, 6, 7, 8  # what they have
TARGET, TARGET_END, COMMANDED = 9, 10, 11  # m, m, N m: of a move
READING, TIP, TIP_SPEED, MUSCLE = 12, 13, 14, 15  # rad, m, m/s, N: after it
GAP, LOWEST, HIGHEST = 16, 17, 18  # m, rad, rad: walls (NaN: none), limits
ROWS = 19
# Of ``settings``, which end with the geometry of the pose.
MASS, STIFFNESS, HAND_DAMPING, SUBSTEP, LAG = 0, 1, 2, 3, 4  # kg, N/m, N s/m, s, s
IS_HAND, LIMIT_STIFFNESS, LIMIT_DAMPING, GEOMETRY = 5, 6, 7, 8  # 1: no walls; N m/rad, N m s/rad
SWEEPS, CONVERGED = 100, 1e-13


@cache
def arm_kernel(pose: Pose) -> Any:
    """Return the compiled motion of one kind of arm.

    It takes ``numbers`` and ``settings`` (rows and entries above), and for how long to move, in s.
    The hand's target moves evenly; ``MUSCLE`` becomes the mean force of the hand's spring and
    damper in the last step. It returns the energy that has flowed from the hand into the device, in
    J, and whether there is a tip that torques could move: the Jacobian is not zero.
    """

    def advance(numbers: Floats, settings: Floats, duration: float) -> tuple[float, bool]:
        size = numbers.shape[1]
        geometry, lag = settings[GEOMETRY:], settings[LAG]
        steps = count_steps(duration, settings[SUBSTEP])
        h = duration / steps
        decay = math.exp(-h / lag) if lag > 0.0 else 0.0
        share = lag / h * (1.0 - decay)
        scratch = np.zeros((7, size))
        goal, goal_speed, force, motor, mean, ahead, held = scratch
        tip, muscle = numbers[TIP], numbers[MUSCLE]
        jacobian, matrix = np.zeros((size, size)), np.zeros((size, size))
        energy = 0.0
        for i in range(steps):
            for j in range(size):
                commanded, target = numbers[COMMANDED, j], numbers[TARGET, j]
                lack = numbers[TORQUE, j] - commanded
                motor[j] = commanded + lack * share
                numbers[TORQUE, j] = commanded + lack * decay
                goal_speed[j] = (numbers[TARGET_END, j] - target) / duration
                goal[j] = target + goal_speed[j] * (i + 0.5) * h
                ahead[j] = numbers[ANGLE, j] + 0.5 * h * numbers[SPEED, j]
            pose(ahead, geometry, tip, jacobian)
            for j in range(size):
                mean[j] = numbers[SPEED, j]
            pose(numbers[ANGLE], geometry, tip, matrix)
            for k in range(size):  # of the hand, if the tip stood still in this step
                held[k] = meet_wall(goal, numbers[GAP, k], tip, k, settings[IS_HAND])
                drive = settings[STIFFNESS] * (goal[k] - tip[k])
                drive = held[k] * (drive + settings[HAND_DAMPING] * goal_speed[k])
                force[k] = drive + 2.0 * settings[MASS] / h * speed_of_tip(matrix, mean, k)
            find_speeds(mean, numbers, motor, jacobian, force, held, settings, h, matrix)
            for k in range(size):
                speed = speed_of_tip(jacobian, mean, k)
                spring = settings[STIFFNESS] * (goal[k] - tip[k] - 0.5 * h * speed)
                muscle[k] = held[k] * (spring + settings[HAND_DAMPING] * (goal_speed[k] - speed))
            energy += turn(numbers, motor, mean, h)
        pose(numbers[ANGLE], geometry, tip, jacobian)
        is_held = False
        for k in range(size):
            numbers[READING, k] = quantise(numbers[ANGLE, k], numbers[RESOLUTION, k])
            numbers[TIP_SPEED, k] = speed_of_tip(jacobian, numbers[SPEED], k)
            for j in range(size):
                is_held = is_held or jacobian[k, j] != 0.0
        return energy, is_held

    allow_in_kernels([pose])
    return jit(advance)


def meet_wall(goal: Floats, gap: float, tip: Floats, k: int, is_hand: float) -> float:
    """Return 1 if spring and damper act on coordinate ``k``; its goal becomes that of a wall."""
    if math.isnan(gap):
        return is_hand
    goal[k] += gap
    return 1.0 if (tip[k] - goal[k]) * math.copysign(1.0, gap) > 0.0 else 0.0


def speed_of_tip(jacobian: Floats, speeds: Floats, k: int) -> float:
    """Return the speed of the tip along coordinate ``k``, in m/s."""
    speed = 0.0
    for j in range(speeds.size):
        speed += jacobian[k, j] * speeds[j]
    return speed


def find_speeds(
    mean: Floats,
    numbers: Floats,
    motor: Floats,
    jacobian: Floats,
    force: Floats,
    held: Floats,
    settings: Floats,
    h: float,
    matrix: Floats,
) -> None:
    """Set ``mean`` to the mean speeds of the step, in rad/s; ``matrix`` is overwritten."""
    size = mean.size
    mass, stiffness = 2.0 * settings[MASS] / h, 0.5 * h * settings[STIFFNESS]
    limit = settings[LIMIT_DAMPING] + 0.5 * h * settings[LIMIT_STIFFNESS]
    for j in range(size):
        for m in range(size):
            matrix[j, m] = 0.0
            for k in range(size):
                impedance = mass + held[k] * settings[HAND_DAMPING] + held[k] * stiffness
                matrix[j, m] += impedance * jacobian[k, j] * jacobian[k, m]
        matrix[j, j] += 2.0 * numbers[INERTIA, j] / h + numbers[DAMPING, j]
        if beyond_limit(numbers, j) != 0.0:
            matrix[j, j] += limit
    for _ in range(SWEEPS):
        change = largest = 0.0
        for j in range(size):
            drive = 2.0 * numbers[INERTIA, j] / h * numbers[SPEED, j] - motor[j]
            drive -= settings[LIMIT_STIFFNESS] * beyond_limit(numbers, j)
            for k in range(size):
                drive += jacobian[k, j] * force[k]
                if k != j:
                    drive -= matrix[j, k] * mean[k]
            speed = mean_speed(
                drive,
                matrix[j, j],
                h,
                numbers[FRICTION, j],
                numbers[PRESLIDING, j],
                numbers[BRISTLE, j],
            )
            change = max(change, abs(speed - mean[j]))
            largest = max(largest, abs(speed))
            mean[j] = speed
        if change <= CONVERGED * largest:
            break


def beyond_limit(numbers: Floats, j: int) -> float:
    """Return how far a joint is beyond one of its limits, in rad; 0 between them."""
    angle, lowest, highest = numbers[ANGLE, j], numbers[LOWEST, j], numbers[HIGHEST, j]
    return float(max(angle - highest, 0.0) + min(angle - lowest, 0.0))


def turn(numbers: Floats, motor: Floats, mean: Floats, h: float) -> float:
    """Turn the joints by one step; return the energy that they took from the hand, in J."""
    energy = 0.0
    for j in range(mean.size):
        before, end = numbers[SPEED, j], 2.0 * mean[j] - numbers[SPEED, j]
        turned = h * mean[j]
        energy += 0.5 * numbers[INERTIA, j] * (end * end - before * before)
        energy += (numbers[DAMPING, j] * mean[j] + motor[j]) * turned
        friction, presliding = numbers[FRICTION, j], numbers[PRESLIDING, j]
        bristle = numbers[BRISTLE, j]
        if presliding > 0.0:
            yielded = yield_by(bristle, turned, presliding)
            energy += 0.5 * friction / presliding * (yielded * yielded - bristle * bristle)
            energy += friction * abs(turned - (yielded - bristle))
            numbers[BRISTLE, j] = yielded
        else:
            energy += friction * abs(turned)
            end = end if end * mean[j] > 0.0 else 0.0
        numbers[ANGLE, j] += turned
        numbers[SPEED, j] = end
    return energy
