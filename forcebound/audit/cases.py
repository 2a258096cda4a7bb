"""Cases of an audit: devices, hands, adversaries and clocks, and their names.

A case can be made again from its name: for a random case its seed, for a case of a search a code of
its parameters (``c`` and base-32 digits).
"""

import math
import random
from collections.abc import Sequence
from typing import NamedTuple

from forcebound.bounding import Dissipation
from forcebound.errors import ConfigError

PERIOD = 1e-3  # s, nominal sampling period T

ADVERSARIES = (
    "late_wall",
    "active_wall",
    "negative_damper",
    "random_force",
    "velocity_pusher",
    "late_spring",
)

#: How a reading may differ from the position: by half the resolution, in any way.
SENSORS = ("quantised", "noisy", "chattering", "leading")

DIMENSIONS = 21  # of the continuous parameters of a case
LEVELS = 1024  # of each of them in a code: two base-32 digits
DIGITS = "0123456789abcdefghijklmnopqrstuv"
NOISES = 32  # sequences of random numbers that a code can name


class Case(NamedTuple):
    """Definition of a run, without the law."""

    name: str  # see the top of this page
    seed: int  # of noise, faults and clock
    samples: int
    # device
    mass: float  # kg
    damping: float  # N s/m
    friction: float  # N
    resolution: float  # m
    sensor: int  # index in SENSORS
    saturation: float  # N
    hold_limit: float  # s, after which the device drops the force
    # hand
    hand_mass: float  # kg
    hand_stiffness: float  # N/m
    hand_damping: float  # N s/m
    amplitude: float  # m, of the target's motion
    slow: float  # Hz, of its slow part
    fast: float  # Hz, of its fast part
    # environment
    adversary: int  # index in ADVERSARIES
    stiffness: float  # N/m
    environment_damping: float  # N s/m, magnitude of what the adversary gives
    magnitude: float  # N, of its forces that do not depend on position
    surface: float  # m
    delay: int  # samples from reading to force
    loss: float  # share of forces that do not arrive
    corruption: float  # share of forces that are replaced by a random one
    # clock
    jitter: float  # of the period, in periods: 0 to 1 gives T(1 - 0.7 j) to T(1 + j)
    overruns: float  # share of periods that are up to 6 times as long


def draw_case(seed: int, seconds: float) -> Case:
    """Return the random case of ``seed``, of about ``seconds`` s."""
    draw = random.Random(seed)

    def logarithmic(low: float, high: float) -> float:
        return math.exp(draw.uniform(math.log(low), math.log(high)))

    return Case(
        name=str(seed),
        seed=seed,
        samples=_samples(seconds),
        mass=logarithmic(0.02, 0.5),
        damping=logarithmic(0.01, 3.0),
        friction=logarithmic(0.003, 1.0),
        resolution=draw.choice((0.0, 1e-6, logarithmic(1e-6, 2e-4), 3e-5, 2e-4)),
        sensor=draw.choice((0, 0, 1, 2, 3)),
        saturation=draw.uniform(3.0, 30.0),
        hold_limit=_nanoseconds(PERIOD * draw.choice((1.0, 1.25, draw.uniform(1.0, 2.5)))),
        hand_mass=logarithmic(0.01, 1.0),
        hand_stiffness=logarithmic(10.0, 2000.0),
        hand_damping=draw.choice((0.0, logarithmic(0.1, 10.0))),
        amplitude=logarithmic(1e-5, 0.05),
        slow=logarithmic(0.2, 3.0),
        fast=logarithmic(3.0, 30.0),
        adversary=draw.randrange(len(ADVERSARIES)),
        stiffness=logarithmic(100.0, 30_000.0),
        environment_damping=logarithmic(1.0, 100.0),
        magnitude=draw.uniform(0.5, 30.0),
        surface=draw.uniform(-0.01, 0.02),
        delay=draw.choice((0, 0, 1, draw.randrange(61), draw.randrange(61))),
        loss=draw.choice((0.0, draw.uniform(0.0, 0.5))),
        corruption=draw.choice((0.0, 0.0, draw.uniform(0.0, 0.1))),
        jitter=draw.choice((0.0, draw.uniform(0.0, 1.0))),
        overruns=draw.choice((0.0, 0.0, draw.uniform(0.0, 0.2))),
    )


def encode(adversary: int, sensor: int, noise: int, point: Sequence[float]) -> str:
    """Return the name of the case at ``point``, :data:`DIMENSIONS` numbers in [0, 1]."""
    levels = [min(LEVELS - 1, max(0, round(u * (LEVELS - 1)))) for u in point]
    digits = [adversary, sensor, noise]
    for level in levels:
        digits += divmod(level, len(DIGITS))
    return "c" + "".join(DIGITS[digit] for digit in digits)


def decode(code: str, seconds: float) -> Case:
    """Return the case of a code of :func:`encode`; its ranges are those of :func:`draw_case`.

    Raises:
        ConfigError: If it is not such a code.
    """
    digits = [DIGITS.find(digit) for digit in code[1:]]
    if (
        len(digits) != 3 + 2 * DIMENSIONS
        or code[0] != "c"
        or min(digits) < 0
        or digits[0] >= len(ADVERSARIES)
        or digits[1] >= len(SENSORS)
    ):
        raise ConfigError(f"a case is a seed or a code that an audit has printed, got {code!r}")
    adversary, sensor, noise = digits[:3]
    point = iter(
        (len(DIGITS) * high + low) / (LEVELS - 1)
        for high, low in zip(digits[3::2], digits[4::2], strict=True)
    )

    def uniform(low: float, high: float) -> float:
        return low + (high - low) * next(point)

    def logarithmic(low: float, high: float) -> float:
        return float(low * (high / low) ** next(point))

    def zero_or_uniform(absent: float, low: float, high: float) -> float:
        """Return 0 in the ``absent`` share of the range; else uniform, ``low`` to ``high``."""
        u = next(point)
        return 0.0 if u < absent else low + (high - low) * (u - absent) / (1.0 - absent)

    def zero_or_logarithmic(absent: float, low: float, high: float) -> float:
        u = next(point)
        return 0.0 if u < absent else low * (high / low) ** ((u - absent) / (1.0 - absent))

    return Case(
        name=code,
        seed=noise,
        samples=_samples(seconds),
        mass=logarithmic(0.02, 0.5),
        damping=logarithmic(0.01, 3.0),
        friction=logarithmic(0.003, 1.0),
        resolution=zero_or_logarithmic(0.1, 1e-6, 2e-4),
        sensor=sensor,
        saturation=uniform(3.0, 30.0),
        hold_limit=_nanoseconds(PERIOD * (1.0 + zero_or_uniform(0.2, 0.0, 1.5))),
        hand_mass=logarithmic(0.01, 1.0),
        hand_stiffness=logarithmic(10.0, 2000.0),
        hand_damping=zero_or_logarithmic(0.3, 0.1, 10.0),
        amplitude=logarithmic(1e-5, 0.05),
        slow=logarithmic(0.2, 3.0),
        fast=logarithmic(3.0, 30.0),
        adversary=adversary,
        stiffness=logarithmic(100.0, 30_000.0),
        environment_damping=logarithmic(1.0, 100.0),
        magnitude=uniform(0.5, 30.0),
        surface=uniform(-0.01, 0.02),
        delay=round(zero_or_uniform(0.3, 0.0, 60.0)),
        loss=zero_or_uniform(0.4, 0.0, 0.5),
        corruption=zero_or_uniform(0.5, 0.0, 0.1),
        jitter=zero_or_uniform(0.4, 0.0, 1.0),
        overruns=zero_or_uniform(0.5, 0.0, 0.2),
    )


LARGEST_SEED = 2**63 - 1  # a compiled run carries it as a 64-bit integer


def case_of(name: str | int, seconds: float) -> Case:
    """Return the case of a name: a seed, or a code of :func:`encode`.

    Raises:
        ConfigError: If it is neither.
    """
    text = str(name)
    if not text.isdecimal():
        return decode(text, seconds)
    if int(text) > LARGEST_SEED:
        raise ConfigError(f"a seed must be at most {LARGEST_SEED}, got {text}")
    return draw_case(int(text), seconds)


def dissipation_of(case: Case) -> Dissipation:
    """Return the dissipation stated to the law: exactly that of the device."""
    return Dissipation(
        damping=case.damping,
        friction=case.friction,
        resolution=case.resolution,
        period=PERIOD,
        hold_limit=case.hold_limit,
        saturation=case.saturation,
    )


def difficulties(case: Case) -> dict[str, str]:
    """Return the difficulty of a case on each axis, in words for a table."""
    faulty = case.loss > 0.0 or case.corruption > 0.0
    if case.jitter > 0.0 or case.overruns > 0.0:
        clock = "unsteady clock"
    else:
        clock = "steady, quantised" if case.resolution > 0.0 else "steady, exact"
    return {
        "clock and reading": clock,
        "environment": ADVERSARIES[case.adversary].replace("_", " "),
        "delay": _range(case.delay, ((0, "none"), (10, "1 to 10 T"), (60, "11 to 60 T"))),
        "loss": "lost or corrupted" if faulty else "none",
        "quantisation": _range(
            case.resolution, ((0.0, "none"), (3e-5, "to 0.03 mm"), (1.0, "to 0.2 mm"))
        ),
        "reading": SENSORS[case.sensor] if case.resolution > 0.0 else "exact",
        "jitter": "-70 to +100 %" if case.jitter > 0.0 else "none",
        "overrun": "up to 6 T" if case.overruns > 0.0 else "none",
        "hand": _range(
            case.hand_stiffness,
            ((100.0, "to 0.1 N/mm"), (500.0, "to 0.5 N/mm"), (1e9, "to 2 N/mm")),
        ),
    }


def _range(value: float, names: Sequence[tuple[float, str]]) -> str:
    return next(name for limit, name in names if value <= limit)


def _samples(seconds: float) -> int:
    return max(2, round(seconds / PERIOD))


def _nanoseconds(duration: float) -> float:
    return round(duration * 1e9) / 1e9
