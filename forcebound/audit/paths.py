"""Cases of an attack on a certificate: a device, and the whole path of its tip, chosen freely.

A path consists of phases that repeat in turn. In each the tip drifts, follows the motor's force (a
*thief* takes the most energy that the force can give), trembles, or all at once; the commanded
force, the sample interval and the write delay are chosen with it. The run ends with a theft: the
largest force is commanded, and the tip follows it. Without inertia any path is possible, so there
is no hand: whatever a hand could do, some path does.

The name of a case is enough to repeat it: ``CERTIFICATE:SEED``, or ``CERTIFICATE:cCODE`` for one of
a search; before it ``without_`` if the law is not informed of what the certificate is about.
"""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from forcebound.audit.cases import LARGEST_SEED, NOISES, Range, decode
from forcebound.audit.certificates import CERTIFICATES, NUMBERS, WITHOUT, Certificate
from forcebound.errors import ConfigError

SAMPLES = 250
THEFT = 6
PHASES = 4

#: What a phase of a path decides, each by a number from 0 to 1 (``plan.py`` says what it means).
PHASE = (
    "length",
    "speed",
    "rest",
    "direction",
    "thief",
    "tremor",
    "force",
    "force_direction",
    "interval",
    "delay",
)

#: Kinds of reading errors, each of at most half the resolution. The last one guesses the change of
#: force that comes and is wrong in the way that costs the law most.
SENSORS = ("quantised", "noisy", "chattering", "leading", "anticipating")

#: Numbers of every case, whatever the certificate.
COMMON: dict[str, Range] = {
    "damping": Range(0.01, 3.0, is_logarithmic=True),  # N s/m
    "friction": Range(0.003, 1.0, is_logarithmic=True),  # N
    "resolution": Range(1e-6, 2e-4, is_logarithmic=True, zeros=0, zero_share=0.2),  # m
    "saturation": Range(3.0, 30.0),  # N
    "hold_limit": Range(0.02, 1.5),  # in periods above one
    "noise": Range(0.0, 1.0, zeros=1, zero_share=0.4),  # of speeds and intervals
    "overruns": Range(0.0, 0.2, zeros=1, zero_share=0.5),  # share of intervals up to 6 times longer
    "less_applied": Range(0.0, 0.3, zeros=2, zero_share=0.6),  # share of forces cut by the device
}


@dataclass(frozen=True)
class PathCase:
    """Definition of a run, without the law.

    Attributes:
        name: See the module's docstring.
        certificate: What it is about.
        is_stated: Whether the law is informed of it.
        seed: Of noise.
        sensor: Index in :data:`SENSORS`.
        numbers: Of :data:`COMMON` and those of the certificate, SI units; others are 0.
        phases: For each phase one number from 0 to 1 for each entry of :data:`PHASE`.
        samples: Length of the path.
        theft: Samples at its end in which the tip takes what it can.
    """

    name: str
    certificate: Certificate
    is_stated: bool
    seed: int
    sensor: int
    numbers: Mapping[str, float]
    phases: Sequence[Sequence[float]]
    samples: int = SAMPLES
    theft: int = THEFT


def ranges_of(certificate: Certificate) -> dict[str, Range]:
    """Return the numbers of a certificate's cases, those of all cases first."""
    return COMMON | {name: NUMBERS[name] for name in certificate.numbers}


def dimensions(certificate: Certificate) -> int:
    """Return how many numbers from 0 to 1 make a case."""
    return len(ranges_of(certificate)) + PHASES * len(PHASE)


def prefix(certificate: str, is_stated: bool) -> str:
    """Return what the names of such cases begin with."""
    return f"{'' if is_stated else WITHOUT}{certificate}:"


def path_case_of(name: str) -> PathCase:
    """Return the case of a name.

    Raises:
        ConfigError: If it is none.
    """
    title, _, rest = name.partition(":")
    is_stated = not title.startswith(WITHOUT)
    title = title.removeprefix(WITHOUT)
    if title not in CERTIFICATES:
        known = ", ".join(CERTIFICATES)
        raise ConfigError(f"no certificate {title!r}; known are {known}")
    certificate = CERTIFICATES[title]
    if rest.isdecimal() and int(rest) <= LARGEST_SEED:
        seed, sensor, numbers, phases = _draw(int(rest), certificate)
    else:
        seed, sensor, numbers, phases = _searched(rest, certificate)
    return PathCase(name, certificate, is_stated, seed, sensor, numbers, phases)


Definition = tuple[int, int, dict[str, float], Sequence[Sequence[float]]]


def _draw(seed: int, certificate: Certificate) -> Definition:
    draw = random.Random(seed)
    numbers = {name: one.draw(draw) for name, one in ranges_of(certificate).items()}
    phases = [[_draw_level(draw) for _ in PHASE] for _ in range(PHASES)]
    return seed, draw.randrange(len(SENSORS)), numbers, phases


def _draw_level(draw: random.Random) -> float:
    return draw.choice((0.0, 0.5, 1.0, draw.random(), draw.random(), draw.random()))


def _searched(code: str, certificate: Certificate) -> Definition:
    (sensor, noise), point = decode(code, (len(SENSORS), NOISES), dimensions(certificate))
    ranges = ranges_of(certificate)
    numbers = {name: one.at(u) for (name, one), u in zip(ranges.items(), point, strict=False)}
    rest = point[len(ranges) :]
    phases = [rest[first : first + len(PHASE)] for first in range(0, len(rest), len(PHASE))]
    return noise, sensor, numbers, phases
