"""The table of bounding laws; to add one, see :mod:`forcebound.bounding`."""

from forcebound.bounding.law import BoundingLaw
from forcebound.errors import ConfigError
from forcebound.parts import Form, Table

LAWS: Table[BoundingLaw] = Table(
    "laws",
    {
        "none": "forcebound.bounding.none:NONE",
        "less_conservative": "forcebound.bounding.less_conservative:LESS_CONSERVATIVE",
        "less_conservative_viscous": (
            "forcebound.bounding.less_conservative:LESS_CONSERVATIVE_VISCOUS"
        ),
        "more_conservative": "forcebound.bounding.more_conservative:MORE_CONSERVATIVE",
        "more_conservative_viscous": (
            "forcebound.bounding.more_conservative:MORE_CONSERVATIVE_VISCOUS"
        ),
        "aol": "forcebound.bounding.aol:AOL",
        "tdpa": "forcebound.bounding.tdpa:TDPA",
        "certified": "forcebound.bounding.certified:CERTIFIED",
        "certified_memoryless": "forcebound.bounding.certified:CERTIFIED_MEMORYLESS",
    },
    Form("forcebound.bounding.law:BoundingLaw", is_object=True),
)


def check_law(name: str) -> None:
    """Raise ConfigError if there is no such law."""
    if name not in LAWS:
        raise ConfigError(f"no bounding law {name!r}; known are {', '.join(sorted(LAWS))}")
