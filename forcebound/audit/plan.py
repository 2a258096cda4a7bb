"""From the numbers of a case to a device, to what its law is informed of, and to a path."""

import math
from typing import Any, NamedTuple

import numpy as np

from forcebound.audit import truth
from forcebound.audit.cases import PERIOD
from forcebound.audit.paths import PHASE, PathCase
from forcebound.audit.truth import Floats, Integers
from forcebound.bounding import Dissipation

FASTEST = 1.0  # m/s, of the drift
LONGEST = 50.0  # periods, of a sample interval
WORST_STAMP = 2e-3  # s, error of a stamp that is wrong
SHORTEST_NS = 1000  # of a sample interval, where a case does not say

#: Numbers that the law is informed of as they are.
STATED = (
    "write_delay",
    "gain_error",
    "lag",
    "watchdog_tolerance",
    "guard_period",
    "allowance",
    "energy_cap",
    "largest_speed",
)

LONGEST_GLITCH = 5  # samples, of a wild reading

#: What is added to the share of readings that a number of the case names, in m.
GLITCHES = {
    "glitches": (math.nan, math.inf, -math.inf, 1e200),
    "wild_readings": (-1e3, 1e3),
    "wrong_readings": (-0.01, 0.01),
}

_COLUMN = {name: column for column, name in enumerate(PHASE)}


class Plan(NamedTuple):
    """A path, as far as it does not depend on the forces, and what becomes of its readings."""

    times: Integers  # see the truth
    choices: Floats  # see the truth
    stamp_ns: list[int]  # time of each reading as the law gets it
    write_stamp_ns: list[int]  # time of each write as the law gets it
    hold_limit: list[float]  # s, of each force
    commanded: list[tuple[float, ...]]  # N
    glitch: dict[int, tuple[float, ...]]  # m, by sample: what is added to a reading
    applied: list[float]  # share of the bounded force that the device applies


def device_of(case: PathCase) -> Floats:
    """Return the device as it really is; :mod:`forcebound.audit.truth` names the rows."""
    numbers, axes = case.numbers, axes_of(case)
    device = np.zeros((truth.SHARED + 1, 6))
    for row, name, ratio in (
        (truth.DAMPING, "damping", "damping_ratio"),
        (truth.FRICTION, "friction", "friction_ratio"),
        (truth.PRESLIDING, "presliding", "resolution_ratio"),
        (truth.HALF_RESOLUTION, "resolution", "resolution_ratio"),
    ):
        device[row, :axes] = numbers.get(name, 0.0) * numbers.get(ratio, 1.0) ** np.arange(axes)
    device[truth.HALF_RESOLUTION] /= 2.0
    device[truth.WEIGHT] = weight_error_of(case) * numbers.get("weight_side", 0.0)
    sides = [numbers.get("gain_side", 0.0), numbers.get("other_gain_side", 0.0)]
    gains = 1.0 + numbers.get("gain_error", 0.0) * np.resize(sides, axes)
    device[truth.GAIN, :axes] = gains
    device[truth.SHARED] = (
        float(has_own_axes(case)),
        numbers.get("lag", 0.0),
        min(numbers.get("largest_speed", math.inf), numbers.get("fastest_hand", math.inf)),
        float(case.sensor),
        numbers.get("guard_period", 0.0),
        numbers.get("drop_delay", 0.0),
    )
    return device


def weight_error_of(case: PathCase) -> float:
    """Return the largest error of the compensated weight of each axis, in N.

    All axes together stay below the friction: else the weight alone would move the device.
    """
    axes = axes_of(case)
    ratio = min(case.numbers.get("friction_ratio", 1.0) ** (axes - 1), 1.0)
    share = case.numbers.get("weight_share", 0.0) / math.sqrt(axes)
    return share * case.numbers["friction"] * ratio


def has_own_axes(case: PathCase) -> bool:
    """Return whether each axis has numbers and friction of its own."""
    return "damping_ratio" in case.numbers


def axes_of(case: PathCase) -> int:
    """Return the number of axes."""
    return int(case.numbers.get("axes", 1.0))


def with_units(case: PathCase) -> dict[str, float]:
    """Return the numbers that a case states in other terms: whole axes, hold limits in s."""
    found: dict[str, float] = {"hold_limit": hold_limit_of(case)}
    if "axes" in case.numbers:
        found["axes"] = axes_of(case)
    if "watchdog_limit" in case.numbers:
        found["watchdog_limit"] = watchdog_limit_of(case)
    return found


def hold_limit_of(case: PathCase) -> float:
    """Return the hold limit, in s."""
    return round(1e9 * PERIOD * (1.0 + case.numbers["hold_limit"])) / 1e9


def watchdog_limit_of(case: PathCase) -> float:
    """Return after which time a force is dropped at last where there is no watchdog, in s."""
    return round(1e9 * hold_limit_of(case) * case.numbers["watchdog_limit"]) / 1e9


def dissipation_of(case: PathCase) -> Dissipation:
    """Return what the law is informed of."""
    device, axes = device_of(case), axes_of(case)

    def alike_or_each(row: int) -> Any:
        each = tuple(device[row, :axes].tolist())
        return each if has_own_axes(case) else each[0]

    r = alike_or_each(truth.HALF_RESOLUTION)
    stated: dict[str, Any] = {
        "damping": alike_or_each(truth.DAMPING),
        "friction": alike_or_each(truth.FRICTION),
        "resolution": tuple(2.0 * one for one in r) if has_own_axes(case) else 2.0 * r,
        "period": PERIOD,
        "hold_limit": hold_limit_of(case),
        "saturation": case.numbers["saturation"],
    }
    if "presliding" in case.numbers:
        stated["presliding"] = alike_or_each(truth.PRESLIDING)
    if "weight_share" in case.numbers:
        error = weight_error_of(case)
        stated["weight_error"] = (error,) * axes if has_own_axes(case) else error
    for name in STATED:
        if name in case.numbers:
            stated[name] = case.numbers[name]
    if case.certificate.watchdog != "silent":
        stated["watchdog"] = case.certificate.watchdog
    if case.certificate.watchdog == "none":
        stated["watchdog_limit"] = watchdog_limit_of(case)
    if not case.is_stated:
        for name, value in case.certificate.unstated.items():
            first = stated[name][0] if isinstance(stated[name], tuple) else stated[name]
            stated[name] = first if value is None else value
    return Dissipation(**stated)


def plan_of(case: PathCase) -> Plan:
    """Return the path of a case, its times and its commanded forces."""
    numbers, axes = case.numbers, axes_of(case)
    rng = np.random.default_rng(case.seed)
    phases = np.array(case.phases)
    of_sample = phases[_phase_of_samples(phases, case.samples)]
    end = np.arange(case.samples) >= case.samples - case.theft
    of_sample[end] = 0.5
    u = {name: of_sample[:, column] for name, column in _COLUMN.items()}
    u["thief"][end] = 0.8  # the very best
    chance = rng.random((case.samples, 6))
    noise = numbers["noise"] * rng.standard_normal((case.samples, 3))
    read_ns = _readings(case, u["interval"], chance, noise[:, 0], end)
    intervals = np.diff(read_ns, prepend=0)
    rest = 0.95 * _cubed(u["rest"])
    resting_ns = np.rint(np.abs(rest) * intervals).astype(np.int64)

    direction = _directions(u["direction"], axes)
    fastest = 8.0 * numbers["fastest_hand"] if "fastest_hand" in numbers else FASTEST
    drift = fastest * (_cubed(u["speed"]) * (1.0 + noise[:, 1]))
    width = numbers["resolution"] / 2.0 + numbers.get("presliding", 0.0)
    sign = 1.0 - 2.0 * (np.arange(case.samples) % 2)
    tremor = 6.0 * width * np.maximum(_cubed(u["tremor"]), 0.0) * sign * (1.0 + noise[:, 2])
    strength = numbers["saturation"] * 1.5 * _cubed(u["force"])
    strength[end] = 2.0 * numbers["saturation"]
    choices = np.zeros((case.samples, truth.CHOICES))
    choices[:, truth.THIEF] = np.maximum(2.0 * u["thief"] - 0.6, 0.0)
    for first, vectors in (
        (truth.DRIFT, drift[:, None] * direction),
        (truth.TREMOR, tremor[:, None] * direction),
        (truth.COMMANDED, strength[:, None] * _directions(u["force_direction"], axes)),
        (truth.ERROR, 2.0 * rng.random((case.samples, axes)) - 1.0),
    ):
        choices[:, first : first + axes] = vectors
    writes, stamps, write_stamps = _stamps_and_writes(case, read_ns, u["delay"], chance)
    rest_ns = np.where(rest > 0.0, read_ns - intervals + resting_ns, read_ns - resting_ns)
    limits = _hold_limits(case)
    return Plan(
        times=np.stack(
            [read_ns, writes, _cuts(case, limits), limits, rest_ns, rest > 0.0], axis=1
        ).astype(np.int64),
        choices=choices,
        stamp_ns=stamps.tolist(),
        write_stamp_ns=write_stamps.tolist(),
        hold_limit=(limits * 1e-9).tolist(),
        commanded=_tuples(choices[:, truth.COMMANDED : truth.COMMANDED + axes]),
        glitch=_glitches(case, axes),
        applied=np.where(chance[:, 2] < numbers["less_applied"], chance[:, 3], 1.0).tolist(),
    )


def _tuples(vectors: Floats) -> list[tuple[float, ...]]:
    return [tuple(vector) for vector in vectors.tolist()]


def _phase_of_samples(phases: Floats, samples: int) -> Integers:
    lengths = np.rint(40.0 ** phases[:, _COLUMN["length"]]).astype(np.int64)
    cycle = np.repeat(np.arange(len(phases)), lengths)
    return np.resize(cycle, samples)


def _readings(case: PathCase, u: Floats, chance: Floats, noise: Floats, end: Any) -> Integers:
    """Return the times of the readings, in ns."""
    periods = 10.0 ** np.clip(3.0 * _cubed(u), -3.0, math.log10(LONGEST)) * np.exp(0.3 * noise)
    late = chance[:, 0] < case.numbers["overruns"]
    periods[late] *= 1.0 + 5.0 * chance[late, 1]
    periods[end] = _cuts(case, _hold_limits(case))[end] * 1e-9 / PERIOD
    periods[end] += case.numbers.get("drop_delay", 0.0) / PERIOD
    shortest = case.numbers.get("shortest", SHORTEST_NS)
    intervals = np.maximum(np.rint(1e9 * PERIOD * periods), shortest).astype(np.int64)
    return np.asarray(np.cumsum(intervals) - intervals[0])


def _stamps_and_writes(
    case: PathCase, read_ns: Integers, u: Floats, chance: Floats
) -> tuple[Integers, Integers, Integers]:
    """Return when forces are written, and when the law believes that it was read and written."""
    numbers = case.numbers
    intervals = np.diff(read_ns, append=read_ns[-1] + round(PERIOD * 1e9))
    delay_ns = np.rint(1e9 * numbers.get("write_delay", 0.0) * _saturated(u)).astype(np.int64)
    write_ns = read_ns + np.minimum(delay_ns, intervals - 1)
    stamp_ns = read_ns
    if "wrong_stamps" in numbers:
        wrong = chance[:, 5] < numbers["wrong_stamps"]
        late_ns = np.rint(wrong * chance[:, 3] * 1e9 * WORST_STAMP).astype(np.int64)
        stamp_ns = np.maximum.accumulate(read_ns + late_ns) + 1000 * np.arange(case.samples)
    is_lost = chance[:, 4] < numbers.get("lost_writes", 0.0)
    return np.where(is_lost, -1, write_ns), stamp_ns, write_ns if case.is_stated else stamp_ns


def _hold_limits(case: PathCase) -> Integers:
    """Return the hold limit of each force, in ns."""
    changes = 1.0 + case.numbers.get("hold_change", 0.0) * np.random.default_rng(
        case.seed + 1
    ).choice((0.0, 0.0, 0.1, 1.0), case.samples)
    return np.asarray(np.rint(1e9 * hold_limit_of(case) * changes).astype(np.int64))


def _cuts(case: PathCase, limits: Integers) -> Integers:
    """Return after which time the watchdog really drops each force, in ns."""
    numbers = case.numbers
    if case.certificate.watchdog == "none":
        return np.full(case.samples, round(1e9 * watchdog_limit_of(case)))
    off = numbers.get("watchdog_tolerance", 0.0) * numbers.get("cut_side", 0.0)
    return np.asarray(np.rint(limits * (1.0 + off)).astype(np.int64))


def _glitches(case: PathCase, axes: int) -> dict[int, tuple[float, ...]]:
    """Return by sample what is added to its reading, in m: no number, or what is not so."""
    glitch = np.zeros((case.samples, axes))
    rng = np.random.default_rng(case.seed + 2)
    for name, sizes in GLITCHES.items():
        bad = np.flatnonzero(rng.random(case.samples) < case.numbers.get(name, 0.0))
        longest = LONGEST_GLITCH if name == "wild_readings" else 1
        for begin in bad:
            end = begin + rng.integers(1, longest + 1)
            glitch[begin:end, rng.integers(axes)] = rng.choice(sizes)
    return {n: tuple(one) for n, one in enumerate(glitch.tolist()) if any(one)}


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
