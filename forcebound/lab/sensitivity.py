"""What a wrong number costs: the lowest energy that a search finds when a device breaks a promise.

A certified law relies on the numbers of its device. Here one of them is wrong, and the attack of
:mod:`forcebound.lab.paths` looks for the lowest energy, with a hand that is no faster than
:data:`FASTEST_HAND`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from forcebound.bounding import Dissipation
from forcebound.devices import DEVICES, DeviceModel
from forcebound.errors import ConfigError
from forcebound.lab.audit import check_runs
from forcebound.lab.engine import Campaign, Row, run_here, runs_of
from forcebound.lab.paths import truth
from forcebound.lab.paths.path import COMMANDS, READINGS, Manner
from forcebound.lab.paths.run import Case
from forcebound.lab.paths.search import Restart
from forcebound.lab.views import groups, least

LAW = "certified"
FASTEST_HAND = 0.5  # m/s
LONGEST = 250  # samples of a run
OF_RESTART = 100  # runs
ROW_OF = {"damping": truth.DAMPING, "friction": truth.FRICTION, "resolution": truth.ERROR}


@dataclass(frozen=True)
class Mistake:
    """Numbers of a device that are wrong.

    Attributes:
        summary: A few words for a table.
        factors: The device's numbers, as multiples of those that it states.
        gain: Of the motor.
        presliding: In resolutions.
        numbers: Other numbers of the device, by their place in ``truth.NUMBERS``; SI units.
        case: Fields of :class:`.Case`.
        guards: Whether its watchdog guards, and the hand is any hand.
    """

    summary: str
    factors: dict[str, float] = field(default_factory=dict)
    gain: float = 1.0
    presliding: float = 0.0
    numbers: dict[int, float] = field(default_factory=dict)
    case: dict[str, float] = field(default_factory=dict)
    guards: bool = False
    largest_speed: bool = True  # is stated


_ANY_HAND = "guarding, any hand: "
MISTAKES = (
    Mistake("nothing is wrong"),
    Mistake("damping b stated 10 % too high", {"damping": 1.0 / 1.1}),
    Mistake("friction f_c stated 10 % too high", {"friction": 1.0 / 1.1}),
    Mistake("motor 2 % stronger than written", gain=1.02),
    Mistake("motor 5 % stronger than written", gain=1.05),
    Mistake("motor 5 % weaker than written", gain=0.95),
    Mistake("readings wrong by 2r", {"resolution": 2.0}),
    Mistake("readings wrong by 4r", {"resolution": 4.0}),
    Mistake("watchdog 15 % early or late", case={"tolerance": 0.15}),
    Mistake(_ANY_HAND + "nothing is wrong", guards=True),
    Mistake(_ANY_HAND + "first look 20 us late", guards=True, case={"tolerance": 20 / 1020}),
    Mistake(_ANY_HAND + "first look 50 us late", guards=True, case={"tolerance": 50 / 1020}),
    Mistake(
        _ANY_HAND + "drops a force 50 us after the look", guards=True, numbers={truth.DROP: 50e-6}
    ),
    Mistake("stamps up to 2 ms late in 2 % of ticks", case={"late_stamps": 0.02}),
    Mistake("1 % of the writes lost unnoticed", case={"lost_writes": 0.01}),
    Mistake("reading to writing 50 us", case={"write_delay": 50e-6}),
    Mistake("reading to writing 100 us", case={"write_delay": 100e-6}),
    Mistake("reading to writing 400 us", case={"write_delay": 400e-6}),
    Mistake("amplifier with a lag of 50 us", numbers={truth.LAG: 50e-6}),
    Mistake("amplifier with a lag of 400 us", numbers={truth.LAG: 400e-6}),
    Mistake("friction yields over half a resolution", presliding=0.5),
    Mistake("friction yields over 4 resolutions", presliding=4.0),
    Mistake("1 reading of 100 wrong by 10 mm", case={"wrong_readings": 0.01}),
    Mistake(
        "1 reading of 100 wrong by 10 mm, no largest speed stated",
        case={"wrong_readings": 0.01},
        largest_speed=False,
    ),
)


def device_of(stated: Dissipation, mistake: Mistake, random: np.random.Generator) -> Case:
    """Return a device of one axis with a mistake, and a manner of attack."""
    device, numbers = np.zeros((truth.DEVICE_ROWS, truth.AXES)), np.zeros(truth.NUMBERS)
    for name, row in ROW_OF.items():
        half = 0.5 if name == "resolution" else 1.0
        device[row, 0] = half * getattr(stated, name) * mistake.factors.get(name, 1.0)
    device[truth.GAIN] = mistake.gain
    device[truth.PRESLIDING, 0] = mistake.presliding * float(stated.coarsest_resolution)
    numbers[truth.USED_AXES], numbers[truth.FASTEST] = 1.0, FASTEST_HAND
    if mistake.guards:
        stated = replace(stated, watchdog="guarding", guard_period=50e-6)
        numbers[truth.FASTEST], numbers[truth.GUARD] = math.inf, 50e-6
    if mistake.guards or not mistake.largest_speed:
        stated = replace(stated, largest_speed=math.inf)
    for place, value in mistake.numbers.items():
        numbers[place] = value
    reading, command = random.integers(len(READINGS)), random.integers(len(COMMANDS))
    clock = int(random.choice([0, 1, 2, 3]))
    longest = 6.0 * stated.period
    manner = Manner(int(reading), int(command), clock, FASTEST_HAND, longest, stated.saturation)
    fields: dict[str, Any] = {**mistake.case, "watchdog": stated.watchdog}
    return Case(LAW, stated, 1, device, numbers, manner, **fields)


class MistakeCase(NamedTuple):
    """A restart against a device with a mistake, of :data:`MISTAKES` the one at this place."""

    kind: str
    place: int
    seed: int
    runs: int

    def rows(self) -> list[Row]:
        """Run it; every other restart is random, the others are searches."""
        random = np.random.default_rng([self.seed, self.place])
        found = Restart(device_of(stated_by(self.kind), MISTAKES[self.place], random), LONGEST)
        (found.search if self.seed % 2 else found.at_random)(random, self.runs)
        return [{"summary": MISTAKES[self.place].summary, "energy_min_j": found.lowest}]


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


def run(kind: str, runs: int, workers: int | None = None) -> dict[str, Any]:
    """Search for the lowest energy with each mistake; return it ready for JSON.

    Args:
        kind: Key of :data:`forcebound.devices.DEVICES`.
        runs: Of each mistake, in restarts.
        workers: Processes; None: one for each core; 0: this process.

    Returns:
        ``device``, ``runs``, ``samples`` and ``mistakes``: ``summary`` and ``energy_min_j`` each.

    Raises:
        ConfigError: If there is no such device.
    """
    check_runs(0, runs)
    stated_by(kind)
    cases = [
        MistakeCase(kind, place, 1 + first // OF_RESTART, min(OF_RESTART, runs - first))
        for place in range(len(MISTAKES))
        for first in range(0, runs, OF_RESTART)
    ]
    campaign = Campaign("sensitivity", cases, part=1, runs_of=runs_of)
    rows = run_here(campaign, workers).rows
    lowest = [least(own, "energy_min_j") for own in groups(rows, "summary").values()]
    return {"device": kind, "runs": runs, "samples": LONGEST, "mistakes": lowest}
