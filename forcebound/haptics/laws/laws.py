"""The table of bounding laws; to add one, see :mod:`forcebound.haptics.laws`."""

from forcebound.errors import ConfigError
from forcebound.haptics.laws.law import BoundingLaw
from forcebound.haptics.parts import Form, Table

LAWS: Table[BoundingLaw] = Table(
    "laws",
    {
        "none": "forcebound.haptics.laws.none:NONE",
        "less_conservative": "forcebound.haptics.laws.less_conservative:LESS_CONSERVATIVE",
        "less_conservative_viscous": (
            "forcebound.haptics.laws.less_conservative:LESS_CONSERVATIVE_VISCOUS"
        ),
        "more_conservative": "forcebound.haptics.laws.more_conservative:MORE_CONSERVATIVE",
        "more_conservative_viscous": (
            "forcebound.haptics.laws.more_conservative:MORE_CONSERVATIVE_VISCOUS"
        ),
        "aol": "forcebound.haptics.laws.aol:AOL",
        "tdpa": "forcebound.haptics.laws.tdpa:TDPA",
        "certified": "forcebound.haptics.laws.certified:CERTIFIED",
        "certified_memoryless": "forcebound.haptics.laws.certified:CERTIFIED_MEMORYLESS",
    },
    Form("forcebound.haptics.laws.law:BoundingLaw", is_object=True),
)


def check_law(name: str) -> None:
    """Raise ConfigError if there is no such law."""
    if name not in LAWS:
        raise ConfigError(f"no bounding law {name!r}; known are {', '.join(sorted(LAWS))}")
