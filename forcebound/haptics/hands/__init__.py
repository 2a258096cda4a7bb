"""Operators: the hand that holds the device, and the path of its target.

A hand is a mass that is fixed to the device's handle and pulled by a spring and a damper towards a
target that moves along a path. Such a hand is passive around its target, which is what the
passivity argument asks of a human (``docs/theory.md``, section 1).

An operator is a frozen dataclass of its parameters that inherits :class:`Operator`. To add one,
write its class and one line in ``OPERATORS``; ``tests/test_part_contracts.py`` tests it with all
the others. Or name a custom file (docs/write-your-own-device.md).
"""

from abc import ABC, abstractmethod

from forcebound.haptics.parts import PartShape, Table
from forcebound.messages.packets import Vector


class Operator(ABC):
    """The hand on a simulated device; ``target`` alone has no default.

    Attributes:
        mass: Mass that moves with the handle, in kg.
        stiffness: Stiffness of the spring from handle to target, in N/m.
        damping: Damping between handle and target, in N s/m.
        walls: In place of a hand: way from the target to the wall across each axis, in m, its sign
            the side; NaN: none there. Empty: a hand.
        joint_limits: Lowest and highest angle of each joint of an arm, in rad; empty: none.
        joint_stiffness: Stiffness of these limits, in N m/rad.
        joint_damping: Damping of these limits, in N m s/rad.
    """

    mass: float
    stiffness: float
    damping: float
    walls: Vector = ()
    joint_limits: tuple[tuple[float, float], ...] = ()
    joint_stiffness: float = 0.0
    joint_damping: float = 0.0

    @abstractmethod
    def target(self, elapsed: float) -> Vector:
        """Return the target of the hand, in m, ``elapsed`` s after the force engaged.

        A path of fewer axes than the device leaves the hand at 0 in the remaining ones.
        """

    def buttons(self, elapsed: float) -> int | None:
        """Return which buttons are down, bit i for button i; None: the device has none."""
        return None


OPERATORS: Table[type[Operator]] = Table(
    "operators",
    {
        "chirp": "forcebound.haptics.hands.hands:ChirpHand",
        "following": "forcebound.haptics.hands.paths:FollowingHand",
        "pointer": "forcebound.haptics.hands.pointer:PointerHand",
        "pressing": "forcebound.haptics.hands.hands:PressingHand",
        "sinusoidal": "forcebound.haptics.hands.hands:SinusoidalHand",
        "stroking": "forcebound.haptics.hands.hands:StrokingHand",
        "trajectory": "forcebound.haptics.hands.paths:TrajectoryHand",
        "trembling": "forcebound.haptics.hands.hands:TremblingHand",
        "wall": "forcebound.haptics.hands.hands:WallInPlace",
    },
    PartShape("forcebound.haptics.hands:Operator"),
)
