r"""The plant: a mass with friction in a passive hand, integrated over real time.

How one step works. Over a step ``h`` with mean velocity :math:`\bar v`, the implicit midpoint rule

.. math::

    M (v_1 - v_0) / h = k_h (x_t - \bar x) + b_h (v_t - \bar v) - b \bar v - f_c s - F_d ,
    \qquad \bar v = (v_0 + v_1) / 2 , \quad \bar x = x_0 + h \bar v / 2

is solved for :math:`\bar v` with the friction's sign :math:`s = \mathrm{sgn}\,\bar v`, or
:math:`\bar v = 0` where the other forces cannot overcome it: true stick and slip, no smoothing
(J. J. Moreau's time-stepping, 1988). Multiplying by :math:`h \bar v` shows why this rule and no
other: kinetic energy, losses and the work of hand and motor balance *exactly* in each step, to
rounding, however coarse the step. So a negative energy in an audit is the law's fault and never
the integrator's. Where a step would reverse the velocity it ends at rest instead; that loses
kinetic energy to friction, never adds any.

The energy that the paper's Eq. 1 asks about flows from the hand into the *device*. The hand's
mass moves with the handle, so the force at the interface is the muscle's (spring and damper) less
what accelerates that mass, and its work is the muscle's less the hand's kinetic energy.

**Presliding.** Friction is a stop operator: a bristle of stiffness :math:`\sigma = f_c / z_m`
yields by :math:`z`, :math:`|z| \le z_m`, before the contact slides (R. Bouc 1967; Prandtl's element
of 1928). Over a displacement :math:`dx` its work is what the bristle stores and what slides,

.. math::

    W = \tfrac12 \sigma (z_1^2 - z_0^2) + f_c |dx - (z_1 - z_0)| , \qquad
    z_1 = \mathrm{clip}(z_0 + dx, \pm z_m) ,

so its mean force is :math:`W / dx`: :math:`\sigma (z_0 + dx / 2)` while it sticks, and
:math:`s f_c - \sigma (z_m - s z_0)^2 / (2\,dx)` once it slides in direction :math:`s`. Put into the
implicit midpoint rule, this is a linear or a quadratic equation for the mean velocity, and has one
solution, since the mean force grows with the displacement.
Kinetic energy, stored energy, losses and the work of hand and motor balance to rounding in each
step. There is no rest to end a step in: what would stop rings on the bristle.

**Lag.** The motor's force approaches the commanded one as :math:`e^{-t/\tau}`. In a
step it is its mean, which is exact, so the balance stays exact with this mean. The exponential's
deviation from a stair of means is :math:`(h/\tau)^2 / 12` of its square, 0.5 % for a substep of a
quarter of the lag.

**Weight** is a constant force.

**A wall in place of the hand** only pushes, and only beyond a gap: in each step its spring and
damper act, or not, as the step begins.

What is left out: the arm's kinematics (axes are independent), cable compliance, cogging. Friction
acts on each axis by itself, which loses at least as much as friction along the path of several
axes.
"""

import math
from typing import NamedTuple


class Moving(NamedTuple):
    """State of one axis."""

    x: float  # position, m
    v: float  # m/s
    work: float  # of the hand's spring and damper so far, J
    bristle: float  # how far the friction has yielded, within the presliding, m
    motor_force: float  # N, positive against positive motion


class Axis(NamedTuple):
    """One axis of a device, in a hand."""

    mass: float  # of device and hand together, kg
    damping: float  # of the device, N s/m
    friction: float  # of the device, N
    presliding: float  # z_m, m; 0: friction does not yield
    weight: float  # N, positive against positive motion
    lag: float  # time constant of the motor, s; 0: it gives the commanded force
    hand_stiffness: float  # N/m
    hand_damping: float  # N s/m
    gap: float = math.nan  # from the target to a wall in place of the hand, m, its sign the side


def advance_extended(
    moving: Moving,
    axis: Axis,
    target: float,
    target_end: float,
    duration: float,
    substep: float,
    commanded: float,
) -> tuple[Moving, float]:
    """Advance one axis by ``duration``, in s, > 0, in steps of at most ``substep``, in s.

    The motor approaches the force ``commanded``, in N; the hand's target, in m, moves evenly.
    Returns the end, and the mean force of the hand's spring and damper in the last step, in N.
    """
    x, v, work, bristle, motor_force = moving
    steps = count_steps(duration, substep)
    h = duration / steps
    target_velocity = (target_end - target) / duration
    inertia = 2.0 * axis.mass / h
    stiffness, damping = axis.hand_stiffness, axis.hand_damping
    impedance = inertia + axis.damping + damping + 0.5 * h * stiffness
    decay = math.exp(-h / axis.lag) if axis.lag > 0.0 else 0.0
    share = axis.lag / h * (1.0 - decay)  # mean of the exponential
    muscle = 0.0
    for i in range(steps):
        middle = target + target_velocity * (i + 0.5) * h
        if not math.isnan(axis.gap):
            middle += axis.gap
            touches = x > middle if axis.gap >= 0.0 else x < middle
            stiffness = axis.hand_stiffness if touches else 0.0
            damping = axis.hand_damping if touches else 0.0
            impedance = inertia + axis.damping + damping + 0.5 * h * stiffness
        force = commanded + (motor_force - commanded) * share + axis.weight
        motor_force = commanded + (motor_force - commanded) * decay
        drive = inertia * v + stiffness * (middle - x)
        drive = drive + damping * target_velocity - force
        mean = mean_speed(drive, impedance, h, axis.friction, axis.presliding, bristle)
        dx = h * mean
        muscle = stiffness * (middle - x - 0.5 * dx)
        muscle += damping * (target_velocity - mean)
        x += dx
        work += muscle * dx
        v = 2.0 * mean - v
        if axis.presliding > 0.0:
            bristle = yield_by(bristle, dx, axis.presliding)
        elif mean > 0.0:  # no reversal within a step; branches, since a resting hand is predicted
            v = max(v, 0.0)
        else:
            v = min(v, 0.0) if mean < 0.0 else 0.0
    return Moving(x, v, work, bristle, motor_force), muscle


def mean_speed(
    drive: float, impedance: float, h: float, friction: float, presliding: float, bristle: float
) -> float:
    """Return the mean speed of a step, in m/s; see :func:`yielding_speed` for the arguments."""
    if presliding > 0.0:
        return yielding_speed(drive, impedance, h, friction, presliding, bristle)
    if drive > friction:
        return (drive - friction) / impedance
    return (drive + friction) / impedance if drive < -friction else 0.0


def yielding_speed(
    drive: float, impedance: float, h: float, friction: float, presliding: float, bristle: float
) -> float:
    """Return the mean velocity of a step of ``h`` s with friction that yields, in m/s.

    ``drive`` is the force that it would take to stand still, in N, ``impedance`` the force per mean
    velocity, in N s/m, ``bristle`` how far the friction has yielded of the ``presliding``, in m.
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
    """Return how far friction has yielded, in m, after a displacement ``dx``, in m."""
    return min(max(bristle + dx, -presliding), presliding)


def count_steps(duration: float, substep: float) -> int:
    """Return in how many equal steps of at most ``substep`` a ``duration`` is integrated."""
    return max(1, math.ceil(duration / substep - 1e-9))


def quantise(x: float, resolution: float) -> float:
    """Return the encoder's reading of ``x``, in m; with resolution 0 it is ``x`` itself."""
    if resolution <= 0.0:
        return x
    return math.floor(x / resolution + 0.5) * resolution
