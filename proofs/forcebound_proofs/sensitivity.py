"""What a wrong number costs: the lowest energy that a search finds when a device breaks a promise.

A certified law relies on the numbers of its device. Here one of them is wrong, and the attack of
:mod:`forcebound_proofs.paths` looks for the lowest energy, with a hand that is no faster than
:data:`FASTEST_HAND`.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.devices import DEVICES, DeviceModel
from forcebound.haptics.laws import Dissipation
from forcebound.lab.engine import Row
from forcebound.lab.views import groups, least
from forcebound_proofs.audit import Options
from forcebound_proofs.paths.certificates import finished
from forcebound_proofs.paths.draft import Draft
from forcebound_proofs.paths.run import AttackedDevice
from forcebound_proofs.paths.search import Restart

LAW = "certified"
FASTEST_HAND = 0.5  # m/s
LONGEST = 1000  # samples of a run
OF_RESTART = 100  # runs
GUARD_PERIOD = 50e-6  # s
ANY_HAND = "guarding, any hand: "

#: What is wrong with a device, of which the law is not informed. ``damping``, ``friction`` and
#: ``error`` are multiples of what it states, ``presliding`` of its resolution; numbers are in SI
#: units. ``largest_speed`` and ``stated_delay`` are what the device states; other numbers than
#: those of the truth are fields of :class:`forcebound_proofs.paths.run.AttackedDevice`.
MISTAKES: dict[str, dict[str, float]] = {
    "nothing is wrong": {},
    "damping b stated 10 % too high": {"damping": 1.0 / 1.1},
    "friction f_c stated 10 % too high": {"friction": 1.0 / 1.1},
    "motor 2 % stronger than written": {"gain": 1.02},
    "motor 5 % stronger than written": {"gain": 1.05},
    "motor 5 % weaker than written": {"gain": 0.95},
    "readings wrong by 2r": {"error": 2.0},
    "readings wrong by 4r": {"error": 4.0},
    "watchdog 15 % early or late": {"tolerance": 0.15},
    ANY_HAND + "nothing is wrong": {},
    ANY_HAND + "first look 20 us late": {"tolerance": 20 / 1020},
    ANY_HAND + "first look 50 us late": {"tolerance": 50 / 1020},
    ANY_HAND + "drops a force 50 us after the look": {"drop": 50e-6},
    "stamps up to 2 ms late in 2 % of ticks": {"late_stamps": 0.02},
    "1 % of the writes lost unnoticed": {"lost_writes": 0.01},
    "reading to writing 50 us": {"write_delay": 50e-6},
    "reading to writing 100 us": {"write_delay": 100e-6},
    "reading to writing 400 us": {"write_delay": 400e-6},
    "reading to writing 1.5 ms": {"write_delay": 1.5e-3},
    "the same, 1 ms stated": {"write_delay": 1.5e-3, "stated_delay": 1e-3},
    "the same, 1.5 ms stated: nothing is wrong": {"write_delay": 1.5e-3, "stated_delay": 1.5e-3},
    "amplifier with a lag of 50 us": {"lag": 50e-6},
    "amplifier with a lag of 400 us": {"lag": 400e-6},
    "friction yields over half a resolution": {"presliding": 0.5},
    "friction yields over 4 resolutions": {"presliding": 4.0},
    "1 reading of 100 wrong by 10 mm": {"wrong_readings": 0.01},
    "the same, no largest speed stated": {"wrong_readings": 0.01, "largest_speed": math.inf},
}


def device_of(kind: str, summary: str, random: np.random.Generator) -> AttackedDevice:
    """Return a device of one axis with one of :data:`MISTAKES`, and a manner of attack."""
    fields, wrong = stated_by(kind), dict(MISTAKES[summary])
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
    return finished(LAW, draft, None if is_any_hand else FASTEST_HAND)


class MistakeCase(NamedTuple):
    """A restart against a device with a mistake; every other restart is random."""

    kind: str
    summary: str
    seed: int
    runs: int

    def rows(self) -> list[Row]:
        """Run it."""
        random = np.random.default_rng([self.seed, *map(ord, self.summary)])
        found = Restart(device_of(self.kind, self.summary, random), LONGEST)
        (found.search if self.seed % 2 else found.at_random)(random, self.runs)
        return [{"summary": self.summary, "energy_min_j": found.lowest}]


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


def run(kind: str, runs: int, workers: int | None = None) -> Row:
    """Search for the lowest energy with each mistake; return it ready for JSON.

    Args:
        kind: Key of :data:`forcebound.haptics.devices.DEVICES`.
        runs: Of each mistake, in restarts.
        workers: Processes; None: one for each core; 0: this process.

    Returns:
        ``device``, ``runs``, ``samples`` and ``mistakes``: ``summary`` and ``energy_min_j`` each.

    Raises:
        ConfigError: If there is no such device.
    """
    options = Options(runs=0, searched=runs, workers=workers)
    options.check()
    stated_by(kind)
    cases = [
        MistakeCase(kind, summary, 1 + first // OF_RESTART, min(OF_RESTART, runs - first))
        for summary in MISTAKES
        for first in range(0, runs, OF_RESTART)
    ]
    rows = options.run("sensitivity", cases, part=1)
    lowest = [least(own, "energy_min_j") for own in groups(rows, "summary").values()]
    return {"device": kind, "runs": runs, "samples": LONGEST, "mistakes": lowest}
