"""Kinematics of arms: the position of the tip, and torques for a force there.

The geometry of a kind of arm is one function, which the simulated arm calls compiled at each step,
and a driver of a real one through :class:`ArmKinematics`.
"""

import math
from collections.abc import Callable
from functools import partial
from operator import mul
from struct import Struct
from typing import TYPE_CHECKING, Any, TypeAlias

from forcebound.compiled import jit
from forcebound.messages.packets import Vector

if TYPE_CHECKING:  # a launcher starts without numpy
    import numpy as np
    from numpy.typing import NDArray

    from forcebound.haptics.devices import Kinematics

ROUNDING = 1e-9  # of a torque; what is less is none

Floats: TypeAlias = "NDArray[np.float64]"

#: ``(angles, geometry, tip, jacobian) -> None``: fills in the position of the tip, in m, and its
#: derivatives, ``jacobian[k, j]`` that of coordinate k by joint j, in m/rad. A pose in which a
#: torque could move no tip, or any force, has a Jacobian of zeros.
Pose: TypeAlias = Callable[["Floats", "Floats", "Floats", "Floats"], None]


class ArmKinematics:
    """Kinematics of an arm with as many joints as coordinates of its tip.

    ``geometry`` is what the function ``pose`` of this kind of arm takes, in m.
    """

    def __init__(self, pose: Pose, geometry: Vector, joints: int) -> None:
        import numpy as np

        self.pose, self.geometry = pose, geometry
        self._compiled_pose: Any = jit(pose)
        self._taken: Vector = ()
        self._angles = np.zeros(joints)
        # numpy takes longer to set numbers
        self._set_angles = partial(Struct(f"{joints}d").pack_into, self._angles.data, 0)
        self._numbers = np.array(geometry)
        self._tip = np.zeros(joints)
        self._jacobian = np.zeros((joints, joints))
        self.position((0.5,) * joints)  # compile before time matters

    def position(self, angles: Vector) -> Vector:
        self._take(angles)
        return tuple(self._tip.tolist())

    def jacobian(self, angles: Vector) -> tuple[Vector, ...]:
        """Return the derivatives of the position by the angles, in m/rad: a row per coordinate."""
        self._take(angles)
        return tuple(map(tuple, self._jacobian.tolist()))

    def torque(self, angles: Vector, force: Vector) -> Vector:
        """Return the torques of a force; see :class:`forcebound.haptics.devices.Kinematics`.

        They are zero in a pose in which the tip cannot be held.
        """
        self._take(angles)
        if len(force) != len(self._jacobian):
            raise ValueError(f"expected a force of {len(self._jacobian)} entries, got {len(force)}")
        columns = self._jacobian.T.tolist()
        return tuple([math.fsum(map(mul, column, force)) for column in columns])

    def _take(self, angles: Vector) -> None:
        if angles == self._taken:  # position and torque are asked of the same reading
            return
        self._taken = angles
        self._set_angles(*angles)
        self._compiled_pose(self._angles, self._numbers, self._tip, self._jacobian)


def tip_force(
    kinematics: "Kinematics", angles: Vector, applied: Vector, commanded: Vector, asked: Vector
) -> Vector:
    """Return the force, in N, that torques ``applied`` (N m) give at the tip: J^T force = applied.

    It is the same part of the force ``commanded`` (N) as they are of its torques ``asked`` (N m),
    and the force of what that leaves over; in a singular pose there is no such force.
    """
    square = math.fsum(map(mul, asked, asked))
    share = math.fsum(map(mul, applied, asked)) / (square or math.inf)
    tip = tuple([share * f for f in commanded])
    rest = [a - share * w for a, w in zip(applied, asked, strict=True)]
    if math.hypot(*rest) <= ROUNDING * math.hypot(*applied):
        return tip
    size = len(rest)
    units = [tuple([float(i == k) for i in range(size)]) for k in range(size)]
    columns = [kinematics.torque(angles, unit) for unit in units]
    rows = [list(row) for row in zip(*columns, rest, strict=True)]
    for k in range(size):  # Gauss and Jordan: the same bits on every machine, for verification
        pivot = max(range(k, size), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        if rows[k][k] == 0.0:
            return tip
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(size):
            if i != k:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return tuple([f + row[-1] for f, row in zip(tip, rows, strict=True)])


def link_angle(near: float, far: float, reach: float) -> float | None:
    """Return the angle between a link and the straight line from its joint to the tip, in rad.

    ``near`` and ``far`` are the lengths of the link and of that which leads on to the tip,
    ``reach`` is from the joint to the tip, in m. None if the links do not reach.
    """
    if not abs(near - far) <= reach <= near + far or reach == 0.0:
        return None
    cosine = (near**2 + reach**2 - far**2) / (2.0 * near * reach)
    return math.acos(min(max(cosine, -1.0), 1.0))


def two_links(upper: float, lower: float, out: float, up: float) -> tuple[float, Vector] | None:
    """Return how two links reach a tip, the elbow above the line from shoulder to tip.

    The tip is ``out`` from the shoulder and ``up``, in m, as are the lengths of the links. Returns
    the angle of the upper link above the level, in rad, and how far the tip is out and up from the
    elbow, in m; None if the links do not reach.
    """
    corner = link_angle(upper, lower, math.hypot(out, up))
    if corner is None:
        return None
    shoulder = math.atan2(up, out) + corner
    return shoulder, (out - upper * math.cos(shoulder), up - upper * math.sin(shoulder))
