"""Bounding laws: how much of the force that was asked for may reach the motor.

At each sample n the bounder knows the reading q(n), the force F_e(n) that is asked for and the
force F(n-1) that was held since the last sample. A law decides the largest magnitude F_max; the
vector is shortened to it, its direction kept. What every law promises (``tests/test_bounding.py``
asks each):

* ``|F| <= min(|F_e|, F_max, F_sat)`` and F never opposes F_e (a law that ``adds_damping`` excepted:
  for it only ``|F| <= F_sat`` holds);
* the result is a function of state and inputs alone: same inputs, same bits;
* without motion and history the paper's laws give no force, the certified laws, and the
  reconstructed AOL, at most f_c;
* several axes that move along one of them give what one axis gives.

A law that ``is_certified`` promises more: the energy that the hand has put in, ``∫ F_h v dt``, is
never negative, whatever is asked for (``forcebound.audit`` tries to break that).

To add a law: copy ``aol.py`` to ``my_law.py``. Its functions take the arguments that
:mod:`forcebound.bounding.law` lists, the same for all laws, and use only floats, ``if`` and
:mod:`math`, because the same function objects are compiled for audits and sweeps. Name the
:class:`BoundingLaw` made of them in ``laws.py``, one line in ``LAWS``; the contract tests, the
audit and launch files (``device: {law: my_law}``) then know it.
"""

from forcebound.bounding.bounder import ForceBounder
from forcebound.bounding.law import (
    ANCHOR_SAMPLES,
    BoundingLaw,
    Dissipation,
    Parameters,
    clear_square,
    least_viscous_path,
    play,
)
from forcebound.bounding.laws import LAWS
from forcebound.bounding.less_conservative import less_conservative_noncausal
from forcebound.bounding.more_conservative import more_conservative_noncausal

__all__ = [
    "ANCHOR_SAMPLES",
    "LAWS",
    "BoundingLaw",
    "Dissipation",
    "ForceBounder",
    "Parameters",
    "clear_square",
    "least_viscous_path",
    "less_conservative_noncausal",
    "more_conservative_noncausal",
    "play",
]
