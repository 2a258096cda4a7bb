"""Operators: the hand that holds the device, and where it wants to go.

A hand is a mass that is fixed to the device's handle and pulled by a spring and a damper towards a
target that moves along a path. Such a hand is passive around its target, which is what the
passivity argument asks of a human (``docs/theory.md``, section 1).

An operator is a frozen dataclass of its parameters that inherits :class:`Operator`. To add one:
write its class and one line in ``OPERATORS``; ``tests/test_operators.py`` tests it with all the
others. Or name a file of your own (docs/write-your-own-device.md).
"""

from abc import ABC, abstractmethod

from forcebound.messages.packets import Vector
from forcebound.parts import Form, Table


class Operator(ABC):
    """The hand on a simulated device; ``target`` alone has no default.

    Attributes:
        mass: Mass that moves with the handle, in kg.
        stiffness: Stiffness of the spring from handle to target, in N/m.
        damping: Damping between handle and target, in N s/m.
    """

    mass: float
    stiffness: float
    damping: float

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
        "chirp": "forcebound.operators.hands:ChirpHand",
        "following": "forcebound.operators.paths:FollowingHand",
        "palpating": "forcebound.operators.hands:PalpatingHand",
        "pointer": "forcebound.operators.pointer:PointerHand",
        "pressing": "forcebound.operators.hands:PressingHand",
        "sinusoidal": "forcebound.operators.hands:SinusoidalHand",
        "stroking": "forcebound.operators.hands:StrokingHand",
        "trajectory": "forcebound.operators.paths:TrajectoryHand",
        "trembling": "forcebound.operators.hands:TremblingHand",
    },
    Form("forcebound.operators:Operator"),
)
