"""What a wrong number costs: the lowest energy that a search finds when a device breaks a promise.

A certified law relies on the numbers of its device. Here one of them is wrong, and the attacks of
:mod:`forcebound.audit.paths` look for the lowest energy within a second, with a hand that is no
faster than :data:`FASTEST_HAND`.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, product
from typing import Any, NamedTuple

import numpy as np

from forcebound.audit.campaign import Progress, in_order
from forcebound.audit.certificates import Certificate
from forcebound.audit.path_run import PathResult, attack_path
from forcebound.audit.paths import PHASE, SENSORS, PathCase
from forcebound.audit.search import descend
from forcebound.bounding import Dissipation
from forcebound.devices import DEVICES, DeviceModel
from forcebound.errors import ConfigError

LAW = "certified"
FASTEST_HAND = 0.5  # m/s
ANY_HAND = 20.0  # m/s; more than the 15.5 m/s that take the most from the largest force
#: What of each of two phases is searched; intervals are steady.
SEARCHED: tuple[str, ...] = ("length", "speed", "rest", "thief", "tremor", "force", "delay")
TRIED_SENSORS = (SENSORS.index("noisy"), SENSORS.index("anticipating"))
SAMPLES = 1000
THEFT = 200  # of them; a slow hand needs some time to take what a ledger holds


@dataclass(frozen=True)
class Mistake:
    """A number of a device that is wrong.

    Attributes:
        summary: A few words for a table.
        factors: The device's numbers, as multiples of those that it states.
        numbers: Further numbers of the device, of which the law is not informed; SI units.
        resolutions: Further numbers, as multiples of the resolution.
        watchdog: Of the device.
    """

    summary: str
    factors: dict[str, float] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    resolutions: dict[str, float] = field(default_factory=dict)
    watchdog: str = "silent"


def _guarding(summary: str, **numbers: float) -> Mistake:
    """Return a mistake of a guarding watchdog in any hand."""
    any_hand = {"fastest_hand": ANY_HAND, "largest_speed": math.inf}
    numbers |= {"guard_period": 50e-6, "cut_side": 1.0, **any_hand}
    return Mistake(f"guarding, any hand: {summary}", numbers=numbers, watchdog="guarding")


MISTAKES = (
    Mistake("nothing is wrong"),
    Mistake("damping b stated 10 % too high", {"damping": 1.0 / 1.1}),
    Mistake("friction f_c stated 10 % too high", {"friction": 1.0 / 1.1}),
    Mistake("motor 2 % stronger than written", numbers={"gain_error": 0.02, "gain_side": 1.0}),
    Mistake("motor 5 % stronger than written", numbers={"gain_error": 0.05, "gain_side": 1.0}),
    Mistake("motor 5 % weaker than written", numbers={"gain_error": 0.05, "gain_side": -1.0}),
    Mistake("readings wrong by 2r", {"resolution": 2.0}),
    Mistake("readings wrong by 4r", {"resolution": 4.0}),
    Mistake("watchdog 15 % early", numbers={"watchdog_tolerance": 0.15, "cut_side": -1.0}),
    Mistake("watchdog 15 % late", numbers={"watchdog_tolerance": 0.15, "cut_side": 1.0}),
    _guarding("nothing is wrong"),
    _guarding("first look 20 us late", watchdog_tolerance=20 / 1020),
    _guarding("first look 50 us late", watchdog_tolerance=50 / 1020),
    _guarding("drops a force 50 us after the look", drop_delay=50e-6),
    Mistake("stamps up to 2 ms late in 2 % of ticks", numbers={"wrong_stamps": 0.02}),
    Mistake("1 % of the writes lost unnoticed", numbers={"lost_writes": 0.01}),
    Mistake("reading to writing 50 us", numbers={"write_delay": 50e-6}),
    Mistake("reading to writing 100 us", numbers={"write_delay": 100e-6}),
    Mistake("reading to writing 400 us", numbers={"write_delay": 400e-6}),
    Mistake("amplifier with a lag of 50 us", numbers={"lag": 50e-6}),
    Mistake("amplifier with a lag of 400 us", numbers={"lag": 400e-6}),
    Mistake("friction yields over half a resolution", resolutions={"presliding": 0.5}),
    Mistake("friction yields over 4 resolutions", resolutions={"presliding": 4.0}),
    Mistake("1 reading of 100 wrong by 10 mm", numbers={"wrong_readings": 0.01}),
    Mistake(
        "1 reading of 100 wrong by 10 mm, no largest speed stated",
        numbers={"wrong_readings": 0.01, "largest_speed": math.inf},
    ),
)


class Search(NamedTuple):
    """A search for the lowest energy that a mistake costs."""

    mistake: Mistake
    device: Dissipation
    sensor: int
    runs: int


def case_of(search: Search, noise: int, point: Sequence[float]) -> PathCase:
    """Return the case of a ``point``, whose numbers from 0 to 1 make the phases of the path."""
    device, mistake = search.device, search.mistake
    stated = {name: getattr(device, name) for name in ("damping", "friction", "resolution")}
    numbers = stated | {
        "saturation": device.saturation,
        "hold_limit": device.hold_limit / device.period - 1.0,
        "noise": 0.2,
        "overruns": 0.01,
        "less_applied": 0.0,
        "fastest_hand": FASTEST_HAND,
        "largest_speed": device.largest_speed,
        **mistake.numbers,
        **{name: factor * stated["resolution"] for name, factor in mistake.resolutions.items()},
        **{name: factor * stated[name] for name, factor in mistake.factors.items()},
    }
    believed = stated | {name: 0.0 for name in UNSTATED if name in numbers}
    certificate = Certificate(mistake.summary, unstated=believed, watchdog=mistake.watchdog)
    phases = [
        [dict(zip(SEARCHED, part, strict=True)).get(name, 0.5) for name in PHASE]
        for part in (point[: len(SEARCHED)], point[len(SEARCHED) :])
    ]
    return PathCase("", certificate, False, noise, search.sensor, numbers, phases, SAMPLES, THEFT)


def trembling() -> Iterator[list[float]]:
    """Yield points whose paths go to and fro, each way with a force of its own.

    A late force gives most on these, and random paths rarely are such.
    """
    longest = math.log(40.0)  # of a phase, in samples: see plan.py
    for samples in (1, 2, 8):
        for forces in product((0.0, 0.5, 1.0), repeat=2):
            for speed in (0.7, 1.0):
                point: list[float] = []
                for force, way in zip(forces, (speed, 1.0 - speed), strict=True):
                    phase = {"length": math.log(samples) / longest, "speed": way, "force": force}
                    phase |= {"thief": 0.0, "delay": 1.0}
                    point += [phase.get(name, 0.5) for name in SEARCHED]
                yield point


#: Numbers of a mistake that a law would be informed of if the device stated them.
UNSTATED = ("gain_error", "watchdog_tolerance", "write_delay", "lag", "presliding")


def lowest_energy(search: Search) -> float:
    """Return the lowest energy that a search finds, in J; from the best of some paths on.

    Half of the runs are random paths and :func:`trembling` ones.
    """
    dimensions = 2 * len(SEARCHED)
    rng = np.random.default_rng((1, search.sensor))

    def attack(noise: int, point: Sequence[float]) -> tuple[PathResult, float]:
        result = attack_path(LAW, case_of(search, noise, point))[0]
        return result, result.objective

    levels = (0.0, 0.5, 1.0)
    points = list(islice(trembling(), search.runs // 3))
    points += [
        rng.choice((*levels, rng.random()), dimensions).tolist()
        for _ in range(search.runs // 2 - len(points))
    ]
    tried = [attack(0, point) for point in points]
    best = min(range(len(tried)), key=lambda one: tried[one][1])
    found = descend(attack, dimensions, search.runs - len(tried), rng, points[best])
    return min(result.margin for result in [*(one for one, _ in tried), *found])


def stated_by(kind: str) -> Dissipation:
    """Return what a device states, for one axis: of each number the worst of all its axes.

    Raises:
        ConfigError: If there is no such device.
    """
    if kind not in DEVICES:
        raise ConfigError(f"no device {kind!r}; known are {', '.join(sorted(DEVICES))}")
    make: Callable[..., DeviceModel] = DEVICES[kind]
    model = make()  # pyright: ignore[reportCallIssue]
    all_axes = Dissipation(
        damping=model.damping,
        friction=model.friction,
        resolution=model.resolution,
        saturation=model.saturation,
        period=1e-3,
        hold_limit=1.02e-3,
    )
    return replace(
        all_axes,
        damping=all_axes.least_damping,
        friction=all_axes.least_friction,
        resolution=all_axes.coarsest_resolution,
        largest_speed=model.largest_speed or math.inf,
    )


def run_sensitivity(
    kind: str,
    runs: int,
    workers: int | None = None,
    progress: Progress = lambda done, total: None,
) -> dict[str, Any]:
    """Search for the lowest energy with each mistake; return it ready for JSON.

    Args:
        kind: Key of :data:`forcebound.devices.DEVICES`.
        runs: Of each search.
        workers: Processes; None: one for each core; 0: this process.
        progress: Called with the progress, in this process.

    Returns:
        ``device``, ``runs``, ``seconds`` and ``mistakes``: ``summary`` and ``energy_min_j`` each.

    Raises:
        ConfigError: If there is no such device.
    """
    device = stated_by(kind)
    share = max(2, math.ceil(runs / len(TRIED_SENSORS)))
    searches = [
        Search(mistake, device, sensor, share) for mistake in MISTAKES for sensor in TRIED_SENSORS
    ]
    lowest = dict.fromkeys((mistake.summary for mistake in MISTAKES), 0.0)
    for search, energy in in_order(lowest_energy, searches, workers, progress):
        summary = search.mistake.summary
        lowest[summary] = min(lowest[summary], energy)
    return {
        "device": kind,
        "runs": share * len(TRIED_SENSORS),
        "seconds": SAMPLES * device.period,
        "mistakes": [
            {"summary": summary, "energy_min_j": energy} for summary, energy in lowest.items()
        ],
    }
