"""From the numbers of a case to a device, to what its law is informed of, and to a path."""

import math
from typing import Any

import numpy as np

from forcebound.audit.cases import PERIOD
from forcebound.audit.paths import PHASE, SAMPLES, PathCase
from forcebound.audit.truth import Floats, Integers, Plan, TrueDevice
from forcebound.bounding import Dissipation

FASTEST = 1.0  # m/s, of the drift
LONGEST = 50.0  # periods, of a sample interval
THEFT = 6  # samples at the end of a run, in which the tip takes what it can
SHORTEST_NS = 1000  # of a sample interval, where a case does not say

#: Numbers that the law is informed of as they are.
STATED = (
    "write_delay",
    "gain_error",
    "lag",
    "watchdog_tolerance",
    "allowance",
    "energy_cap",
    "largest_speed",
)

_COLUMN = {name: column for column, name in enumerate(PHASE)}


def device_of(case: PathCase) -> TrueDevice:
    """Return the device as it really is."""
    numbers, axes = case.numbers, axes_of(case)

    def each(name: str, like: str | None = None) -> Floats:
        ratio = numbers.get(f"{like or name}_ratio", 1.0)
        return np.array([numbers.get(name, 0.0) * ratio**axis for axis in range(axes)])

    return TrueDevice(
        damping=each("damping"),
        friction=each("friction"),
        presliding=each("presliding", like="resolution"),
        half_resolution=each("resolution") / 2.0,
        weight=np.zeros(axes),
        acts_on_each_axis="damping_ratio" in numbers,
        gain=1.0 + numbers.get("gain_error", 0.0) * numbers.get("gain_side", 0.0),
        lag=numbers.get("lag", 0.0),
        largest_speed=numbers.get("largest_speed", math.inf),
    )


def axes_of(case: PathCase) -> int:
    """Return the number of axes."""
    return int(case.numbers.get("axes", 1.0))


def hold_limit_of(case: PathCase) -> float:
    """Return the hold limit, in s."""
    return round(1e9 * PERIOD * (1.0 + case.numbers["hold_limit"])) / 1e9


def watchdog_limit_of(case: PathCase) -> float:
    """Return after which time a force is dropped at last where there is no watchdog, in s."""
    return round(1e9 * hold_limit_of(case) * case.numbers["watchdog_limit"]) / 1e9


def dissipation_of(case: PathCase) -> Dissipation:
    """Return what the law is informed of."""
    device = device_of(case)

    def alike_or_each(values: Floats) -> Any:
        return tuple(values.tolist()) if device.acts_on_each_axis else float(values[0])

    stated: dict[str, Any] = {
        "damping": alike_or_each(device.damping),
        "friction": alike_or_each(device.friction),
        "resolution": alike_or_each(2.0 * device.half_resolution),
        "period": PERIOD,
        "hold_limit": hold_limit_of(case),
        "saturation": case.numbers["saturation"],
    }
    if "presliding" in case.numbers:
        stated["presliding"] = alike_or_each(device.presliding)
    for name in STATED:
        if name in case.numbers:
            stated[name] = case.numbers[name]
    if case.certificate.watchdog != "silent":
        stated["watchdog"] = case.certificate.watchdog
    if case.certificate.watchdog == "none":
        stated["watchdog_limit"] = watchdog_limit_of(case)
    if not case.is_stated:
        for name, value in case.certificate.unstated.items():
            stated[name] = stated[name][0] if value is None else value
    return Dissipation(**stated)


def plan_of(case: PathCase) -> Plan:
    """Return the path of a case, its times and its commanded forces."""
    numbers, axes = case.numbers, axes_of(case)
    rng = np.random.default_rng(case.seed)
    phases = np.array(case.phases)
    of_sample = phases[_phase_of_samples(phases)]
    end = np.arange(SAMPLES) >= SAMPLES - THEFT
    of_sample[end] = 0.5
    u = {name: of_sample[:, column] for name, column in _COLUMN.items()}
    u["thief"][end] = 0.8  # the very best
    chance = rng.random((SAMPLES, 4))
    noise = numbers["noise"] * rng.standard_normal((SAMPLES, 3))

    read_ns = _readings(case, u["interval"], chance, noise[:, 0], end)
    intervals = np.diff(read_ns, append=read_ns[-1] + round(PERIOD * 1e9))
    delay_ns = np.rint(1e9 * numbers.get("write_delay", 0.0) * _saturated(u["delay"]))
    delay_ns = np.minimum(delay_ns.astype(np.int64), intervals - 1)

    rest = _cubed(u["rest"])
    intervals_before = np.diff(read_ns, prepend=0)
    resting_ns = np.rint(np.abs(rest) * intervals_before).astype(np.int64)
    drift = FASTEST * (_cubed(u["speed"]) * (1.0 + noise[:, 1]))
    width = numbers["resolution"] / 2.0 + numbers.get("presliding", 0.0)
    sign = 1.0 - 2.0 * (np.arange(SAMPLES) % 2)
    tremor = 6.0 * width * np.maximum(_cubed(u["tremor"]), 0.0) * sign * (1.0 + noise[:, 2])
    strength = numbers["saturation"] * 1.5 * _cubed(u["force"])
    strength[end] = 2.0 * numbers["saturation"]
    direction = _directions(u["direction"], axes)
    return Plan(
        read_ns=read_ns,
        write_ns=read_ns + delay_ns,
        cut_ns=_cuts(case),
        punctual_ns=_hold_limits(case),
        rest_ns=np.where(rest > 0.0, read_ns - intervals_before + resting_ns, read_ns - resting_ns),
        rests_first=(rest > 0.0).astype(np.int64),
        drift=drift[:, None] * direction,
        tremor=tremor[:, None] * direction,
        thief=np.maximum(2.0 * u["thief"] - 0.6, 0.0),
        commanded=strength[:, None] * _directions(u["force_direction"], axes),
        glitch=_glitches(case, axes),
        applied=np.where(chance[:, 2] < numbers["less_applied"], chance[:, 3], 1.0),
        error=2.0 * rng.random((SAMPLES, axes)) - 1.0,
    )


def _phase_of_samples(phases: Floats) -> Integers:
    lengths = np.rint(40.0 ** phases[:, _COLUMN["length"]]).astype(np.int64)
    cycle = np.repeat(np.arange(len(phases)), lengths)
    return np.resize(cycle, SAMPLES)


def _readings(case: PathCase, u: Floats, chance: Floats, noise: Floats, end: Any) -> Integers:
    """Return the times of the readings, in ns."""
    periods = 10.0 ** np.clip(3.0 * _cubed(u), -3.0, math.log10(LONGEST)) * np.exp(0.3 * noise)
    late = chance[:, 0] < case.numbers["overruns"]
    periods[late] *= 1.0 + 5.0 * chance[late, 1]
    periods[end] = _cuts(case)[end] * 1e-9 / PERIOD
    shortest = case.numbers.get("shortest", SHORTEST_NS)
    intervals = np.maximum(np.rint(1e9 * PERIOD * periods), shortest).astype(np.int64)
    return np.asarray(np.cumsum(intervals) - intervals[0])


def _hold_limits(case: PathCase) -> Integers:
    """Return the hold limit of each force, in ns."""
    changes = 1.0 + case.numbers.get("hold_change", 0.0) * np.random.default_rng(
        case.seed + 1
    ).choice((0.0, 0.0, 0.1, 1.0), SAMPLES)
    return np.asarray(np.rint(1e9 * hold_limit_of(case) * changes).astype(np.int64))


def _cuts(case: PathCase) -> Integers:
    """Return after which time the watchdog really drops each force, in ns."""
    numbers = case.numbers
    if case.certificate.watchdog == "none":
        return np.full(SAMPLES, round(1e9 * watchdog_limit_of(case)))
    off = numbers.get("watchdog_tolerance", 0.0) * numbers.get("cut_side", 0.0)
    return np.asarray(np.rint(_hold_limits(case) * (1.0 + off)).astype(np.int64))


def _glitches(case: PathCase, axes: int) -> Floats:
    """Return what is added to each reading, in m: no number, or more than any speed explains."""
    glitch = np.zeros((SAMPLES, axes))
    share = case.numbers.get("glitches", 0.0)
    if share:
        rng = np.random.default_rng(case.seed + 2)
        bad = np.flatnonzero(rng.random(SAMPLES) < share)
        sizes = (math.nan, math.inf, -math.inf, 1e200)
        glitch[bad, rng.integers(axes, size=bad.size)] = rng.choice(sizes, bad.size)
    return glitch


def _directions(u: Floats, axes: int) -> Floats:
    """Return unit vectors; with one axis all point forward."""
    angle = 2.0 * math.pi * (u - 0.5)
    all_axes = np.stack([np.cos(angle), np.sin(angle), np.sin(2.0 * angle + 0.7)], axis=1)
    vectors = all_axes[:, :axes] if axes > 1 else np.ones((u.size, 1))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def _cubed(u: Floats) -> Floats:
    """Return ``u``, 0 to 1, as -1 to 1 with most values near 0."""
    return np.asarray((2.0 * u - 1.0) ** 3)


def _saturated(u: Floats) -> Floats:
    """Return ``u``, 0 to 1, with both ends reached often."""
    return np.clip(1.5 * u - 0.25, 0.0, 1.0)
