"""What a wrong number costs: the lowest energy that a search finds when a device breaks a promise.

A certified law relies on the numbers of its device. Here one of them is wrong, and the attack of
:mod:`forcebound_proofs.paths` looks for the lowest energy, with a hand that is no faster than
:data:`FASTEST_HAND`. Runs are named ``sensitivity:DEVICE/MISTAKE:s3.17``.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.devices import DEVICES, DeviceModel
from forcebound.haptics.laws import ENERGY_TOLERANCE, LAWS, Dissipation
from forcebound.lab.engine import Row
from forcebound_proofs.attack import MARGIN, RANDOM, SEARCH, Budget, Names, Series
from forcebound_proofs.paths.certificates import finished
from forcebound_proofs.paths.draft import Draft, Random
from forcebound_proofs.paths.restarts import RestartAttack
from forcebound_proofs.paths.run import AttackedDevice
from forcebound_proofs.paths.search import Restart

FASTEST_HAND = 0.5  # m/s
LONGEST = 1000  # samples of a run
GUARD_PERIOD = 50e-6  # s
ANY_HAND = "guarding, any hand: "


class Mistake(NamedTuple):
    """What is wrong with a device, of which the law is not informed.

    ``damping``, ``friction`` and ``error`` are multiples of what it states, ``presliding`` of its
    resolution; numbers are in SI units. ``largest_speed`` and ``stated_delay`` are what the device
    states; other numbers than those of the truth are fields of
    :class:`forcebound_proofs.paths.run.AttackedDevice`.
    """

    summary: str
    numbers: Mapping[str, float] = {}
    is_kept: bool = False  # the promise


MISTAKES: dict[str, Mistake] = {
    "nothing": Mistake("nothing is wrong", is_kept=True),
    "damping": Mistake("damping b stated 10 % too high", {"damping": 1.0 / 1.1}),
    "friction": Mistake("friction f_c stated 10 % too high", {"friction": 1.0 / 1.1}),
    "gain_2": Mistake("motor 2 % stronger than written", {"gain": 1.02}),
    "gain_5": Mistake("motor 5 % stronger than written", {"gain": 1.05}),
    "weak_motor": Mistake("motor 5 % weaker than written", {"gain": 0.95}),
    "readings_2r": Mistake("readings wrong by 2r", {"error": 2.0}),
    "readings_4r": Mistake("readings wrong by 4r", {"error": 4.0}),
    "watchdog": Mistake("watchdog 15 % early or late", {"tolerance": 0.15}),
    "any_hand": Mistake(ANY_HAND + "nothing is wrong", is_kept=True),
    "look_20us": Mistake(ANY_HAND + "first look 20 us late", {"tolerance": 20 / 1020}),
    "look_50us": Mistake(ANY_HAND + "first look 50 us late", {"tolerance": 50 / 1020}),
    "drop_50us": Mistake(ANY_HAND + "drops a force 50 us after the look", {"drop": 50e-6}),
    "late_stamps": Mistake("stamps up to 2 ms late in 2 % of ticks", {"late_stamps": 0.02}),
    "lost_writes": Mistake("1 % of the writes lost unnoticed", {"lost_writes": 0.01}),
    "delay_50us": Mistake("reading to writing 50 us", {"write_delay": 50e-6}),
    "delay_100us": Mistake("reading to writing 100 us", {"write_delay": 100e-6}),
    "delay_400us": Mistake("reading to writing 400 us", {"write_delay": 400e-6}),
    "delay": Mistake("reading to writing 1.5 ms", {"write_delay": 1.5e-3}),
    "delay_1ms_stated": Mistake(
        "the same, 1 ms stated", {"write_delay": 1.5e-3, "stated_delay": 1e-3}
    ),
    "delay_stated": Mistake(
        "the same, 1.5 ms stated: nothing is wrong",
        {"write_delay": 1.5e-3, "stated_delay": 1.5e-3},
        is_kept=True,
    ),
    "lag_50us": Mistake("amplifier with a lag of 50 us", {"lag": 50e-6}),
    "lag_400us": Mistake("amplifier with a lag of 400 us", {"lag": 400e-6}),
    "presliding_half": Mistake("friction yields over half a resolution", {"presliding": 0.5}),
    "presliding_4": Mistake("friction yields over 4 resolutions", {"presliding": 4.0}),
    "wrong_readings": Mistake("1 reading of 100 wrong by 10 mm", {"wrong_readings": 0.01}),
    "wrong_readings_any_speed": Mistake(
        "the same, no largest speed stated", {"wrong_readings": 0.01, "largest_speed": math.inf}
    ),
}


def device_of(kind: str, mistake: str, random: Random, law: str) -> AttackedDevice:
    """Return a device of one axis with one of :data:`MISTAKES`, and a manner of attack."""
    summary, numbers, _ = MISTAKES[mistake]
    fields, wrong = stated_by(kind), dict(numbers)
    fields["largest_speed"] = wrong.pop("largest_speed", fields["largest_speed"])
    fields["write_delay"] = wrong.pop("stated_delay", 0.0)
    draft = Draft(random, 1, fields)
    device, is_any_hand = draft.device, summary.startswith(ANY_HAND)
    device.fastest = FASTEST_HAND
    if is_any_hand:
        guarding = {"watchdog": "guarding", "guard_period": GUARD_PERIOD}
        draft.fields |= guarding | {"largest_speed": math.inf}
        draft.case["watchdog"] = "guarding"
        device.guard, device.fastest = GUARD_PERIOD, math.inf
    for name in ("damping", "friction", "error", "gain"):
        device[name] *= wrong.pop(name, 1.0)
    device.presliding[0] = fields["resolution"] * wrong.pop("presliding", 0.0)
    device.lag, device.drop = wrong.pop("lag", 0.0), wrong.pop("drop", 0.0)
    draft.case |= wrong
    # Most promises cost most with a hand at its largest speed.
    return finished(law, draft, None if is_any_hand else FASTEST_HAND)


def stated_by(kind: str) -> Row:
    """Return what a device states, for one axis: of each number the worst of all its axes.

    Raises:
        ConfigError: If there is no such device.
    """
    if kind not in DEVICES:
        raise ConfigError(f"no device {kind!r}; known are {', '.join(sorted(DEVICES))}")
    make: Callable[..., DeviceModel] = DEVICES[kind]
    model = make()  # pyright: ignore[reportCallIssue]
    names = ("damping", "friction", "resolution", "saturation")
    fields = {name: getattr(model, name) for name in names}
    fields |= {"period": 1e-3, "hold_limit": 1.02e-3}
    worst = Dissipation(**fields)
    return fields | {
        "damping": worst.least_damping,
        "friction": worst.least_friction,
        "resolution": worst.coarsest_resolution,
        "largest_speed": model.largest_speed or math.inf,
    }


class MistakeAttack(RestartAttack):
    """A certified law on devices with a mistake; every other restart is random."""

    name = "sensitivity"
    sizes: ClassVar = {RANDOM: 100, SEARCH: 100}
    columns: ClassVar = {
        "what is wrong": lambda row: MISTAKES[row["target"].partition("/")[2]].summary,
        "lowest energy": None,
        "case": None,
    }
    introduction = f"""\
## What a wrong number costs

The lowest energy that a search finds within {LONGEST} samples if one promise of a device is broken
and all others are kept. The hand moves at {FASTEST_HAND:g} m/s at most, but for *any hand*.
"""

    def series(self, laws: Names, targets: Names, budget: Budget) -> list[Series]:
        """Return what is to be run; ``targets``: devices, each with all mistakes."""
        _, searched, seed = budget
        found = []
        for kind in targets or ["phantom_premium_1_5"]:
            stated_by(kind)
            for law in laws or ["certified"]:
                for mistake in MISTAKES:
                    every = self.restarts(law, f"{kind}/{mistake}", SEARCH, searched, seed)
                    found += [
                        one._replace(kind=SEARCH if one.seed % 2 else RANDOM) for one in every
                    ]
        return found

    def check(self, target: str) -> None:
        """Check that there is such a device, and such a mistake."""
        kind, _, mistake = target.partition("/")
        stated_by(kind)
        if mistake not in MISTAKES:
            raise ConfigError(f"no mistake {mistake!r}; known are {', '.join(MISTAKES)}")

    def begin(self, law: str, target: str, kind: str, seed: int) -> tuple[Restart, Random]:
        """Return a restart that has not begun, and its chance."""
        device, _, mistake = target.partition("/")
        random = np.random.default_rng([seed, *map(ord, MISTAKES[mistake].summary)])
        return Restart(device_of(device, mistake, random, law), LONGEST, energy_alone=True), random

    def further(self, rows: Sequence[Row]) -> Row:
        """Return whether the law holds: where a promise is broken it cannot."""
        _, _, mistake = rows[0]["target"].partition("/")
        holds = min(row[MARGIN] for row in rows) >= -ENERGY_TOLERANCE
        certified = LAWS[rows[0]["law"]].is_certified
        return {"holds": holds or not certified or not MISTAKES[mistake].is_kept}
