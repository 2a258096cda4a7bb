r"""The plant step with what real axes have: presliding, a motor that lags, weight.

**Presliding.** Friction is a stop operator: a bristle of stiffness :math:`\sigma = f_c / z_m`
yields by :math:`z`, :math:`|z| \le z_m`, before the contact slides (R. Bouc 1967; Prandtl's element
of 1928). Over a step of way :math:`dx` its work is what the bristle stores and what slides,

.. math::

    W = \tfrac12 \sigma (z_1^2 - z_0^2) + f_c |dx - (z_1 - z_0)| , \qquad
    z_1 = \mathrm{clip}(z_0 + dx, \pm z_m) ,

so its mean force is :math:`W / dx`: :math:`\sigma (z_0 + dx / 2)` while it sticks, and
:math:`s f_c - \sigma (z_m - s z_0)^2 / (2\,dx)` once it slides in direction :math:`s`. Put into the
implicit midpoint rule of :mod:`forcebound.devices.plant`, this is a linear or a quadratic equation
for the mean velocity, and has one solution, since the mean force grows with the way. Kinetic
energy, stored energy, losses and the work of hand and motor balance to rounding in each step. There
is no rest to end a step in: what would stop rings on the bristle.

**Lag.** The motor's force approaches the force that it is told to give as :math:`e^{-t/\tau}`. In a
step it is its mean, which is exact, so the balance stays exact with this mean. The exponential's
deviation from a stair of means is :math:`(h/\tau)^2 / 12` of its square, 0.5 % for a substep of a
quarter of the lag.

**Weight** is a constant force.
"""

import math

from forcebound.devices.plant import count_steps, step, step_impedance


def advance_extended(
    x: float,
    v: float,
    work: float,
    bristle: float,
    motor_force: float,
    target: float,
    target_end: float,
    duration: float,
    substep: float,
    told_force: float,
    weight: float,
    lag: float,
    presliding: float,
    mass: float,
    damping: float,
    friction: float,
    hand_stiffness: float,
    hand_damping: float,
) -> tuple[float, float, float, float, float, float]:
    """Advance one axis by ``duration``; the motor is told the same force all the time.

    Args:
        x: Position, in m.
        v: Velocity, in m/s.
        work: Work of the hand's spring and damper so far, in J.
        bristle: How far the friction has yielded, in m, within ``presliding``.
        motor_force: What the motor gives at the start, in N, positive against positive motion.
        target: Where the hand wants to be at the start, in m.
        target_end: And at the end; in between it moves evenly.
        duration: In s, > 0.
        substep: Longest integration step, in s.
        told_force: What the motor approaches, in N.
        weight: Force of gravity, in N, positive against positive motion.
        lag: Time constant of the motor, in s; 0: it gives what it is told.
        presliding: z_m, in m; 0: friction does not yield.
        mass: Of device and hand together, in kg.
        damping: Of the device, in N s/m.
        friction: Coulomb friction of the device, in N.
        hand_stiffness: In N/m.
        hand_damping: In N s/m.

    Returns:
        Position, velocity, work, bristle, motor force, and the mean force of the hand's spring and
        damper in the last step, in N.
    """
    steps = count_steps(duration, substep)
    h = duration / steps
    target_velocity = (target_end - target) / duration
    inertia = 2.0 * mass / h
    impedance = step_impedance(inertia, damping, hand_damping, h, hand_stiffness)
    decay = math.exp(-h / lag) if lag > 0.0 else 0.0
    share = lag / h * (1.0 - decay)  # mean of the exponential
    muscle = 0.0
    for i in range(steps):
        middle = target + target_velocity * (i + 0.5) * h
        force = told_force + (motor_force - told_force) * share + weight
        motor_force = told_force + (motor_force - told_force) * decay
        if presliding > 0.0:
            x, v, work, muscle, bristle = presliding_step(
                x,
                v,
                work,
                bristle,
                middle,
                target_velocity,
                h,
                force,
                inertia,
                impedance,
                friction,
                presliding,
                hand_stiffness,
                hand_damping,
            )
        else:
            x, v, work, muscle = step(
                x,
                v,
                work,
                middle,
                target_velocity,
                h,
                force,
                inertia,
                impedance,
                friction,
                hand_stiffness,
                hand_damping,
            )
    return x, v, work, bristle, motor_force, muscle


def presliding_step(
    x: float,
    v: float,
    work: float,
    bristle: float,
    target_middle: float,
    target_velocity: float,
    h: float,
    force: float,
    inertia: float,
    impedance: float,
    friction: float,
    presliding: float,
    hand_stiffness: float,
    hand_damping: float,
) -> tuple[float, float, float, float, float]:
    """Advance one axis by one step ``h``, with friction that yields over ``presliding`` > 0.

    As :func:`forcebound.devices.plant.step`, and the bristle as last number.
    """
    drive = (
        inertia * v + hand_stiffness * (target_middle - x) + hand_damping * target_velocity - force
    )
    mean = yielding_speed(drive, impedance, h, friction, presliding, bristle)
    dx = h * mean
    muscle = hand_stiffness * (target_middle - x - 0.5 * dx) + hand_damping * (
        target_velocity - mean
    )
    return x + dx, 2.0 * mean - v, work + muscle * dx, muscle, yield_by(bristle, dx, presliding)


def yielding_speed(
    drive: float, impedance: float, h: float, friction: float, presliding: float, bristle: float
) -> float:
    """Return the mean velocity of a step with friction that yields, in m/s.

    Args:
        drive: Force that it would take to stand still, in N.
        impedance: Force per mean velocity, in N s/m.
        h: Length of the step, in s.
        friction: In N.
        presliding: In m, > 0.
        bristle: How far the friction has yielded, in m.
    """
    stiffness = friction / presliding
    mean = (drive - stiffness * bristle) / (impedance + 0.5 * h * stiffness)
    yielded = bristle + h * mean
    if abs(yielded) <= presliding:
        return mean
    side = math.copysign(1.0, yielded)
    room = presliding - side * bristle
    rest = side * drive - friction
    slack = 0.5 * stiffness * room * room / h
    root = math.sqrt(rest * rest + 4.0 * impedance * slack)
    # The positive root of impedance u² - rest u - slack = 0, without cancellation.
    return side * ((rest + root) / (2.0 * impedance) if rest > 0.0 else 2.0 * slack / (root - rest))


def yield_by(bristle: float, dx: float, presliding: float) -> float:
    """Return how far friction has yielded, in m, after a way ``dx``, in m."""
    return min(max(bristle + dx, -presliding), presliding)
