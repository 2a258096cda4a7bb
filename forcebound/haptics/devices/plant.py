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

The energy that the paper's Eq. 1 asks about flows from the hand into the *device*. The hand's own
mass moves with the handle, so the force at the interface is the muscle's (spring and damper) less
what accelerates that mass, and its work is the muscle's less the hand's kinetic energy.

:mod:`forcebound.haptics.devices.extended` has the step, with presliding, a lagging motor and weight
as well. What is left out: the arm's kinematics (axes are independent), cable compliance, cogging.
Friction acts on each axis by itself, which loses at least as much as friction along the path of
several axes.
"""

import math


def count_steps(duration: float, substep: float) -> int:
    """Return in how many equal steps of at most ``substep`` a ``duration`` is integrated."""
    return max(1, math.ceil(duration / substep - 1e-9))


def step_impedance(
    inertia: float, damping: float, hand_damping: float, h: float, hand_stiffness: float
) -> float:
    """Return the force per mean velocity of a step, in N s/m; ``inertia`` is 2 M/h."""
    return inertia + damping + hand_damping + 0.5 * h * hand_stiffness


def quantise(x: float, resolution: float) -> float:
    """Return the encoder's reading of ``x``, in m; with resolution 0 it is ``x`` itself."""
    if resolution <= 0.0:
        return x
    return math.floor(x / resolution + 0.5) * resolution
