"""Grip of a hand: what ties the handle to the hand's target."""

from dataclasses import dataclass
from typing import Annotated

from forcebound.operators import Operator
from forcebound.quantities import NOT_NEGATIVE, Damping, Mass, Stiffness, check_ranges


@dataclass(frozen=True, kw_only=True)
class SoftGrip(Operator):
    """Part of a hand: a mass at the handle, and spring and damper to the target.

    The defaults are close to the soft grip of the paper's experiments (section 4.1).
    """

    mass: Annotated[Mass, NOT_NEGATIVE] = 0.275
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 950.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 2.8

    def __post_init__(self) -> None:
        check_ranges(self)
