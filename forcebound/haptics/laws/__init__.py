"""Bounding laws: how much of the commanded force may reach the motor.

At each sample n the bounder knows the reading q(n), the commanded force F_e(n) and the applied
force F(n-1) that was held since the last sample. A law decides the largest magnitude F_max; the
vector is shortened to it, its direction kept. What every law promises (``tests/test_bounding.py``
checks each):

* ``|F| <= min(|F_e|, F_max, F_sat)`` and F never opposes F_e (a law that ``adds_damping`` excepted:
  for it only ``|F| <= F_sat`` holds);
* the result is a function of state and inputs alone: same inputs, same bits;
* without motion and history the paper's laws give no force, the certified laws, and the
  reconstructed AOL, at most f_c;
* several axes that move along one of them give what one axis gives.

A law that ``is_certified`` promises more: the energy that the hand has put in, ``∫ F_h v dt``, is
never negative, whatever force is commanded (``forcebound.lab`` tries to break that).

To add a law: copy ``aol.py`` to ``my_law.py``. Its functions see a
:class:`~forcebound.haptics.laws.sample.Sample` and the constants of the device; they use only
numbers, ``if`` and :mod:`math`, because the same function objects are compiled. Name the
:class:`BoundingLaw` made of them in ``LAWS`` (``law.py``); the contract tests, the
audit and launch files (``device: {law: my_law}``) then know it.
"""

from forcebound.haptics.laws.bounder import ForceBounder
from forcebound.haptics.laws.dissipation import Dissipation, PerAxis, Watchdog
from forcebound.haptics.laws.law import LAWS, BoundingLaw, check_law
from forcebound.haptics.laws.sample import (
    ANCHOR_SAMPLES,
    ENERGY_TOLERANCE,
    DeviceConstants,
    Sample,
    Write,
    play,
)

__all__ = [
    "ANCHOR_SAMPLES",
    "ENERGY_TOLERANCE",
    "LAWS",
    "BoundingLaw",
    "DeviceConstants",
    "Dissipation",
    "ForceBounder",
    "PerAxis",
    "Sample",
    "Watchdog",
    "Write",
    "check_law",
    "play",
]
