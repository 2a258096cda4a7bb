"""The table of bounding laws; to add one, see :mod:`forcebound.bounding`."""

from forcebound.bounding.aol import AOL
from forcebound.bounding.certified import CERTIFIED, CERTIFIED_MEMORYLESS
from forcebound.bounding.law import BoundingLaw
from forcebound.bounding.less_conservative import LESS_CONSERVATIVE, LESS_CONSERVATIVE_VISCOUS
from forcebound.bounding.more_conservative import MORE_CONSERVATIVE, MORE_CONSERVATIVE_VISCOUS
from forcebound.bounding.none import NONE
from forcebound.bounding.tdpa import TDPA

LAWS: dict[str, BoundingLaw] = {
    "none": NONE,
    "less_conservative": LESS_CONSERVATIVE,
    "less_conservative_viscous": LESS_CONSERVATIVE_VISCOUS,
    "more_conservative": MORE_CONSERVATIVE,
    "more_conservative_viscous": MORE_CONSERVATIVE_VISCOUS,
    "aol": AOL,
    "tdpa": TDPA,
    "certified": CERTIFIED,
    "certified_memoryless": CERTIFIED_MEMORYLESS,
}
