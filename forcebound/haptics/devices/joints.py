r"""The plant of an arm: joints with friction, and a hand at the tip.

Each joint has an inertia, a damper and Coulomb friction that may yield over a presliding
angle; the motor's torque may lag. The hand, a mass on a spring and a damper, is fixed to the tip
and pulls at the joints through the Jacobian :math:`J` of the pose.

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
from forcebound.haptics.devices.plant import count_steps, mean_speed, yield_by

ANGLE, SPEED, BRISTLE, TORQUE = 0, 1, 2, 3  # rows of ``joints``
INERTIA, DAMPING, FRICTION, PRESLIDING = 0, 1, 2, 3  # rows of ``plant``
MASS, STIFFNESS, HAND_DAMPING = 0, 1, 2  # of ``hand``
SWEEPS, CONVERGED = 100, 1e-13


@cache
def arm_kernel(pose: Pose) -> Any:
    """Return the compiled motion of one kind of arm.

    It takes ``joints``, ``plant``, ``hand`` (rows above), ``geometry`` of ``pose``, the torques
    commanded of the motors (N m), the hand's target at the start and at the end (m; in
    between it moves evenly), duration, longest step and the motors' lag (s), and ``muscle``, which
    becomes the mean force of the hand's spring and damper in the last step (N). It returns the
    energy that has flowed from the hand into the device, in J; ``joints`` has moved.
    """

    def advance(
        joints: Floats,
        plant: Floats,
        hand: Floats,
        geometry: Floats,
        commanded: Floats,
        target: Floats,
        target_end: Floats,
        duration: float,
        substep: float,
        lag: float,
        muscle: Floats,
    ) -> float:
        size = commanded.size
        steps = count_steps(duration, substep)
        h = duration / steps
        decay = math.exp(-h / lag) if lag > 0.0 else 0.0
        share = lag / h * (1.0 - decay)
        scratch = np.zeros((7, size))
        tip, goal, goal_speed, force, motor, mean, ahead = scratch
        jacobian, matrix = np.zeros((size, size)), np.zeros((size, size))
        energy = 0.0
        for i in range(steps):
            for j in range(size):
                lack = joints[TORQUE, j] - commanded[j]
                motor[j] = commanded[j] + lack * share
                joints[TORQUE, j] = commanded[j] + lack * decay
                goal_speed[j] = (target_end[j] - target[j]) / duration
                goal[j] = target[j] + goal_speed[j] * (i + 0.5) * h
                ahead[j] = joints[ANGLE, j] + 0.5 * h * joints[SPEED, j]
            pose(ahead, geometry, tip, jacobian)
            for j in range(size):
                mean[j] = joints[SPEED, j]
            pose(joints[ANGLE], geometry, tip, matrix)
            for k in range(size):  # of the hand, if the tip stood still in this step
                force[k] = (
                    hand[STIFFNESS] * (goal[k] - tip[k])
                    + hand[HAND_DAMPING] * goal_speed[k]
                    + 2.0 * hand[MASS] / h * speed_of_tip(matrix, mean, k)
                )
            find_speeds(mean, joints, plant, motor, jacobian, force, hand, h, matrix)
            for k in range(size):
                speed = speed_of_tip(jacobian, mean, k)
                spring = hand[STIFFNESS] * (goal[k] - tip[k] - 0.5 * h * speed)
                muscle[k] = spring + hand[HAND_DAMPING] * (goal_speed[k] - speed)
            energy += turn(joints, plant, motor, mean, h)
        return energy

    allow_in_kernels([pose])
    return jit(advance)


def speed_of_tip(jacobian: Floats, speeds: Floats, k: int) -> float:
    """Return the speed of the tip along coordinate ``k``, in m/s."""
    speed = 0.0
    for j in range(speeds.size):
        speed += jacobian[k, j] * speeds[j]
    return speed


def find_speeds(
    mean: Floats,
    joints: Floats,
    plant: Floats,
    motor: Floats,
    jacobian: Floats,
    force: Floats,
    hand: Floats,
    h: float,
    matrix: Floats,
) -> None:
    """Set ``mean`` to the mean speeds of the step, in rad/s; ``matrix`` is overwritten."""
    size = mean.size
    impedance = 2.0 * hand[MASS] / h + hand[HAND_DAMPING] + 0.5 * h * hand[STIFFNESS]
    for j in range(size):
        for m in range(size):
            matrix[j, m] = 0.0
            for k in range(size):
                matrix[j, m] += impedance * jacobian[k, j] * jacobian[k, m]
        matrix[j, j] += 2.0 * plant[INERTIA, j] / h + plant[DAMPING, j]
    for _ in range(SWEEPS):
        change = largest = 0.0
        for j in range(size):
            drive = 2.0 * plant[INERTIA, j] / h * joints[SPEED, j] - motor[j]
            for k in range(size):
                drive += jacobian[k, j] * force[k]
                if k != j:
                    drive -= matrix[j, k] * mean[k]
            speed = mean_speed(
                drive, matrix[j, j], h, plant[FRICTION, j], plant[PRESLIDING, j], joints[BRISTLE, j]
            )
            change = max(change, abs(speed - mean[j]))
            largest = max(largest, abs(speed))
            mean[j] = speed
        if change <= CONVERGED * largest:
            break


def turn(joints: Floats, plant: Floats, motor: Floats, mean: Floats, h: float) -> float:
    """Turn the joints by one step; return the energy that they took from the hand, in J."""
    energy = 0.0
    for j in range(mean.size):
        before, end = joints[SPEED, j], 2.0 * mean[j] - joints[SPEED, j]
        turned = h * mean[j]
        energy += 0.5 * plant[INERTIA, j] * (end * end - before * before)
        energy += (plant[DAMPING, j] * mean[j] + motor[j]) * turned
        friction, presliding, bristle = plant[FRICTION, j], plant[PRESLIDING, j], joints[BRISTLE, j]
        if presliding > 0.0:
            yielded = yield_by(bristle, turned, presliding)
            energy += 0.5 * friction / presliding * (yielded * yielded - bristle * bristle)
            energy += friction * abs(turned - (yielded - bristle))
            joints[BRISTLE, j] = yielded
        else:
            energy += friction * abs(turned)
            end = end if end * mean[j] > 0.0 else 0.0
        joints[ANGLE, j] += turned
        joints[SPEED, j] = end
    return energy
