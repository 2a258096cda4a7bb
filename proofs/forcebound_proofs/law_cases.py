"""Cases of the audit of laws: devices, hands, adversaries and clocks, on one axis."""

import random
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from forcebound.haptics.laws import Dissipation
from forcebound.lab import one_axis
from forcebound_proofs.cases import NOISES, Range, decode, seed_of

PERIOD = 1e-3  # s, nominal sampling period T

#: Adversaries: their environment in :mod:`forcebound.lab.one_axis`, and what it takes of a case.
ADVERSARIES: dict[str, tuple[int, Callable[["Scenario"], Sequence[float]]]] = {
    "late_wall": (one_axis.WALL, lambda case: (case.stiffness, case.surface)),
    "active_wall": (
        one_axis.ACTIVE_WALL,
        lambda case: (case.stiffness, -case.environment_damping, case.surface),
    ),
    "negative_damper": (one_axis.DAMPER, lambda case: (-case.environment_damping,)),
    "random_force": (one_axis.RANDOM_FORCE, lambda case: (case.magnitude,)),
    "velocity_pusher": (one_axis.PUSHER, lambda case: (case.magnitude,)),
    "late_spring": (one_axis.SPRING, lambda case: (case.stiffness, case.surface)),
}

#: Kinds of reading errors, each of at most half the resolution.
SENSORS = ("quantised", "noisy", "chattering", "leading")

#: Clock and reading: the assumptions of the paper's laws, and two steps beyond.
CLOCKS = ("steady, exact", "steady, quantised", "unsteady clock")


class Scenario(NamedTuple):
    """Definition of a run, without the law."""

    name: str  # a seed, or a code of forcebound_proofs.cases
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
    adversary: int  # place in ADVERSARIES
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


#: The continuous parameters of a case, in the order of its fields.
RANGES: dict[str, Range] = {
    "mass": Range(0.02, 0.5, is_logarithmic=True),
    "damping": Range(0.01, 3.0, is_logarithmic=True),
    "friction": Range(0.003, 1.0, is_logarithmic=True),
    "resolution": Range(1e-6, 2e-4, is_logarithmic=True, zero_share=0.1),
    "saturation": Range(3.0, 30.0),
    "hold_limit": Range(0.0, 1.5, zero_share=0.2),  # in periods above one
    "hand_mass": Range(0.01, 1.0, is_logarithmic=True),
    "hand_stiffness": Range(10.0, 2000.0, is_logarithmic=True),
    "hand_damping": Range(0.1, 10.0, is_logarithmic=True, zeros=1, zero_share=0.3),
    "amplitude": Range(1e-5, 0.05, is_logarithmic=True),
    "slow": Range(0.2, 3.0, is_logarithmic=True),
    "fast": Range(3.0, 30.0, is_logarithmic=True),
    "stiffness": Range(100.0, 30_000.0, is_logarithmic=True),
    "environment_damping": Range(1.0, 100.0, is_logarithmic=True),
    "magnitude": Range(0.5, 30.0),
    "surface": Range(-0.01, 0.02),
    "delay": Range(0.0, 60.0, zero_share=0.3),
    "loss": Range(0.0, 0.5, zeros=1, zero_share=0.4),
    "corruption": Range(0.0, 0.1, zeros=2, zero_share=0.5),
    "jitter": Range(0.0, 1.0, zeros=1, zero_share=0.4),
    "overruns": Range(0.0, 0.2, zeros=2, zero_share=0.5),
}
CHOICES = (len(ADVERSARIES), len(SENSORS), NOISES)  # of a code


def _draw_resolution(draw: random.Random) -> float:
    return draw.choice((0.0, 1e-6, RANGES["resolution"].value(draw), 3e-5, 2e-4))


def _draw_hold_limit(draw: random.Random) -> float:
    excess = RANGES["hold_limit"]
    longest = draw.uniform(1.0 + excess.low, 1.0 + excess.high)
    return _nanoseconds(PERIOD * draw.choice((1.0, 1.25, longest)))


def _draw_delay(draw: random.Random) -> int:
    samples = round(RANGES["delay"].high) + 1
    return draw.choice((0, 0, 1, draw.randrange(samples), draw.randrange(samples)))


#: Parameters that a random case draws differently: some values are likelier, or discrete.
DRAWN: dict[str, Callable[[random.Random], float]] = {
    "resolution": _draw_resolution,
    "sensor": lambda draw: draw.choice((0, 0, 1, 2, 3)),
    "hold_limit": _draw_hold_limit,
    "adversary": lambda draw: draw.randrange(len(ADVERSARIES)),
    "delay": _draw_delay,
}


def case_of(name: str, seconds: float) -> Scenario:
    """Return the case of a name: a seed, or a code of :func:`forcebound_proofs.cases.encode`.

    The same name with other ``seconds`` is the same run, cut.

    Raises:
        ConfigError: If it is neither.
    """
    samples, seed = max(2, round(seconds / PERIOD)), seed_of(name)
    if seed is not None:
        draw = random.Random(seed)
        drawn: dict[str, Any] = {
            one: DRAWN[one](draw) if one in DRAWN else RANGES[one].draw(draw)
            for one in Scenario._fields[3:]
        }
        return Scenario(name, seed, samples, **drawn)
    (adversary, sensor, noise), numbers = decode(name, CHOICES, RANGES)
    numbers["hold_limit"] = _nanoseconds(PERIOD * (1.0 + numbers["hold_limit"]))
    decoded: dict[str, Any] = numbers | {"delay": round(numbers["delay"])}
    return Scenario(name, noise, samples, sensor=sensor, adversary=adversary, **decoded)


def dissipation_of(case: Scenario) -> Dissipation:
    """Return the dissipation stated to the law: exactly that of the device."""
    return Dissipation(
        damping=case.damping,
        friction=case.friction,
        resolution=case.resolution,
        period=PERIOD,
        hold_limit=case.hold_limit,
        saturation=case.saturation,
    )


def clock_of(case: Scenario) -> str:
    """Return how far clock and reading of a case are as the paper's laws assume, of CLOCKS."""
    if case.jitter > 0.0 or case.overruns > 0.0:
        return CLOCKS[2]
    return CLOCKS[case.resolution > 0.0]


def _nanoseconds(duration: float) -> float:
    return round(duration * 1e9) / 1e9
