"""The certificates under attack: for each, how devices are drawn, and what is left out to break it.

A device is drawn first as it *is*; then it is stated to the bounder, truthfully or, to show that
the attack would see the leak, with the certificate's own numbers stated as if the device did not
have the effect.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from forcebound.haptics.laws import Dissipation
from forcebound.lab.paths import truth as at
from forcebound.lab.paths.path import COMMANDS, READINGS, Manner
from forcebound.lab.paths.run import Case
from forcebound.lab.paths.truth import AXES

Random = np.random.Generator
Effect: TypeAlias = Callable[["Draft"], None]


@dataclass(frozen=True)
class Certificate:
    """What is attacked.

    Attributes:
        summary: One line for the report.
        effects: Functions that give a device its imperfections, in this order.
        left_out: Fields stated as here in the run that must break the law.
        axes: Numbers of axes to draw from.
    """

    summary: str
    effects: tuple[Effect, ...]
    left_out: dict[str, Any] = field(default_factory=dict)
    axes: tuple[int, ...] = (1, 1, 2, 3)


def _log(random: Random, low: float, high: float) -> float:
    return float(low * (high / low) ** random.random())


@dataclass
class Draft:
    """A device while it is drawn: the truth in arrays, and the fields that state it."""

    random: Random
    axes: int
    device: Any
    numbers: Any
    fields: dict[str, Any]
    case: dict[str, Any]

    def per_axis(self, name: str) -> tuple[float, ...]:
        """Return a number for each axis, also where one was stated for all."""
        value = self.fields[name]
        return value if isinstance(value, tuple) else (value,) * self.axes


def _plain(random: Random, axes: int) -> Draft:
    period = float(random.choice([1e-3, 1e-3, 2.5e-4]))
    ratio = float(random.choice([1.0, 1.02, 1.25, 2.5]))
    fields: dict[str, Any] = {
        "damping": _log(random, 0.02, 2.0),
        "friction": _log(random, 0.003, 1.0),
        "resolution": 0.0 if random.random() < 0.1 else _log(random, 1e-6, 2e-4),
        "period": period,
        "hold_limit": round(period * ratio * 1e9) / 1e9,
        "saturation": _log(random, 1.0, 30.0),
    }
    draft = draft_of(random, axes, fields)
    if axes > 1 and random.random() < 0.3:  # the isotropic law allows this, too
        draft.numbers[at.ALONG_PATH] = 0.0
    return draft


def draft_of(random: Random, axes: int, fields: dict[str, Any]) -> Draft:
    """Return a device that has what its ``fields`` state, alike on each axis, and nothing else."""
    device, numbers = np.zeros((at.DEVICE_ROWS, AXES)), np.zeros(at.NUMBERS)
    device[at.GAIN], numbers[at.FASTEST] = 1.0, math.inf
    numbers[at.USED_AXES], numbers[at.ALONG_PATH] = axes, float(axes > 1)
    device[at.DAMPING, :axes], device[at.FRICTION, :axes] = fields["damping"], fields["friction"]
    device[at.ERROR, :axes] = fields["resolution"] / 2.0
    return Draft(random, axes, device, numbers, fields, {})


def write_delay(draft: Draft) -> None:
    """Writes take effect up to 0.4 T after the reading."""
    draft.fields["write_delay"] = draft.fields["period"] * _log(draft.random, 0.01, 0.4)
    draft.case["write_delay"] = draft.fields["write_delay"]


def presliding(draft: Draft) -> None:
    """Friction yields elastically."""
    axes = draft.axes
    ways = tuple(_log(draft.random, 1e-6, 3e-4) for _ in range(axes))
    draft.fields["presliding"] = ways if axes > 1 else ways[0]
    if axes > 1:
        draft.fields["friction"] = draft.per_axis("friction")
        draft.numbers[at.ALONG_PATH] = 0.0
    draft.device[at.PRESLIDING, :axes] = draft.per_axis("presliding")


def gain(draft: Draft) -> None:
    """Every motor gives a constant factor of its force, alike on each axis."""
    error = _log(draft.random, 0.005, 0.2)
    draft.fields["gain_error"] = error
    draft.device[at.GAIN] = 1.0 + error * draft.random.choice(
        [-1.0, 1.0, draft.random.uniform(-1, 1)]
    )


def gain_of_axes(draft: Draft) -> None:
    """Every motor has a factor of its own."""
    error = _log(draft.random, 0.005, 0.2)
    draft.fields["gain_error"] = error
    draft.device[at.GAIN] = 1.0 + error * draft.random.choice([-1.0, 1.0], AXES)


def lag(draft: Draft) -> None:
    """The amplifier is of first order."""
    draft.fields["lag"] = draft.fields["period"] * _log(draft.random, 0.02, 1.0)
    draft.numbers[at.LAG] = draft.fields["lag"]


def _of_axes(draft: Draft, name: str, row: int, values: tuple[float, ...]) -> None:
    """Give each axis a number of its own."""
    draft.fields[name] = values
    draft.device[row, : draft.axes] = np.array(values) * (0.5 if name == "resolution" else 1.0)
    draft.numbers[at.ALONG_PATH] = 0.0


def pooled(draft: Draft) -> None:
    """Every axis has its own damping, friction and resolution."""
    for name, row in (("damping", at.DAMPING), ("friction", at.FRICTION), ("resolution", at.ERROR)):
        mean = draft.fields[name]
        values = tuple(float(mean * _log(draft.random, 0.2, 5.0)) for _ in range(draft.axes))
        _of_axes(draft, name, row, values)


def joints(draft: Draft) -> None:
    """Coordinates are the two joints of an arm; rad and N m."""
    for name, row, low, high in (
        ("damping", at.DAMPING, 5e-4, 0.02),
        ("friction", at.FRICTION, 1e-3, 0.05),
        ("resolution", at.ERROR, 1e-5, 2e-3),
    ):
        values = tuple(_log(draft.random, low, high) for _ in range(draft.axes))
        _of_axes(draft, name, row, values)
    draft.fields["saturation"] = _log(draft.random, 0.1, 2.0)
    draft.numbers[at.AT_TIP] = 1.0


def tolerance(draft: Draft) -> None:
    """A silent watchdog that is early or late."""
    draft.fields["watchdog"] = "silent"
    draft.fields["watchdog_tolerance"] = _log(draft.random, 0.01, 0.3)
    draft.case["tolerance"] = draft.fields["watchdog_tolerance"]


def reporting(draft: Draft) -> None:
    """The watchdog reports when and where it dropped the force."""
    draft.fields["watchdog"] = draft.case["watchdog"] = "reporting"


def guarding(draft: Draft) -> None:
    """The watchdog guards a late force."""
    draft.fields["watchdog"] = draft.case["watchdog"] = "guarding"
    draft.fields["guard_period"] = draft.fields["period"] * _log(draft.random, 0.01, 0.99)
    draft.numbers[at.GUARD] = draft.fields["guard_period"]


def phantom(draft: Draft) -> None:
    """The numbers of the simulated PHANToM Premium 1.5, whose first look is up to 5 us late."""
    stated = {"damping": 0.27, "friction": 0.12, "resolution": 3e-5, "saturation": 8.5}
    draft.fields |= stated | {"period": 1e-3, "hold_limit": 1.02e-3}
    draft.device[at.DAMPING, 0], draft.device[at.FRICTION, 0], draft.device[at.ERROR, 0] = (
        0.27,
        0.12,
        1.5e-5,
    )
    draft.case["tolerance"] = draft.fields["watchdog_tolerance"] = 5 / 1020


def drops_late(draft: Draft) -> None:
    """A guarding watchdog needs some time to drop a force: a look at the limit comes too late."""
    drop = round(draft.fields["guard_period"] * draft.random.uniform(0.05, 0.9), 9)
    draft.numbers[at.GUARD], draft.numbers[at.DROP] = draft.fields["guard_period"] - drop, drop
    draft.fields["watchdog_tolerance"] = drop / draft.fields["hold_limit"]


def none(draft: Draft) -> None:
    """No watchdog; late holds up to the hardware's limit may leak the allowance."""
    hold = draft.fields["hold_limit"]
    draft.fields["watchdog"] = draft.case["watchdog"] = "none"
    draft.fields["watchdog_limit"] = round(hold * _log(draft.random, 1.5, 100.0) * 1e9) / 1e9
    strict = draft.random.random() < 0.2
    draft.fields["allowance"] = 0.0 if strict else _log(draft.random, 1e-6, 0.1)
    draft.case["late"] = draft.fields["watchdog_limit"]
    draft.case["allowance"] = draft.fields["allowance"]


def none_punctual(draft: Draft) -> None:
    """No watchdog, and no late tick: nothing at all may leak."""
    none(draft)
    draft.case["late"] = draft.case["allowance"] = 0.0
    draft.case["punctual_only"] = True


def changing(draft: Draft) -> None:
    """The hold limit changes from hold to hold."""
    hold = draft.fields["hold_limit"]
    draft.case["hold_limits"] = tuple(
        round(hold * _log(draft.random, 1.0, 4.0) * 1e9) / 1e9 for _ in range(4)
    )


def refused(draft: Draft) -> None:
    """Readings that are not numbers, or out of this world, or too soon."""
    draft.case["refused"] = _log(draft.random, 0.02, 0.5)
    draft.case["glitch"] = 0.0


def glitches(draft: Draft) -> None:
    """Readings that imply more than the largest speed; the hand never exceeds it."""
    draft.case["refused"] = _log(draft.random, 0.02, 0.5)
    draft.fields["largest_speed"] = draft.case["glitch"] = _log(draft.random, 0.05, 5.0)
    draft.numbers[at.FASTEST] = 0.999 * draft.fields["largest_speed"]  # no true reading is refused


def too_fast(draft: Draft) -> None:
    """A hand that exceeds the stated largest speed: readings that are true are refused."""
    draft.fields["largest_speed"] = _log(draft.random, 0.001, 0.5)


def cap(draft: Draft) -> None:
    """A cap on what the ledger keeps."""
    draft.fields["energy_cap"] = _log(draft.random, 1e-5, 1e-2)


def weight(draft: Draft) -> None:
    """A weight on each axis that the device compensates, with an error; no hold is cut."""
    axes, random = draft.axes, draft.random
    heavy = random.normal(size=axes)
    # More than friction holds by itself would let the hand have gravity's energy.
    error = min(draft.per_axis("friction")) * _log(random, 0.01, 0.95) / math.sqrt(axes)
    uncertain = draft.fields.get("gain_error", 0.0)  # the motors carry the weight, too
    if uncertain > 0.0:
        heavy = np.clip(heavy, -0.5 * error / uncertain, 0.5 * error / uncertain)
        error *= 0.5
    draft.fields["weight"], draft.fields["weight_error"] = tuple(heavy.tolist()), error
    draft.device[at.WEIGHT, :axes] = heavy + error * random.choice([-1.0, 1.0], axes)
    draft.device[at.COMPENSATION, :axes] = heavy
    draft.case["punctual_only"] = True


def weight_cut(draft: Draft) -> None:
    """A compensated weight that acts whenever the force is cut."""
    weight(draft)
    draft.case["punctual_only"], draft.case["ledger_only"] = False, True


CERTIFICATES = {
    "plain": Certificate("quantised readings, any clock", (), {"resolution": 0.0}),
    "write_delay": Certificate(
        "writes up to 0.4 T after the reading", (write_delay,), {"write_delay": 0.0}
    ),
    "presliding": Certificate("elastic friction", (presliding,), {"presliding": 0.0}),
    "gain": Certificate("gain error to 20 %", (gain,), {"gain_error": 0.0}),
    "gain_of_axes": Certificate(
        "gain error to 20 %, another in each motor", (gain_of_axes,), axes=(2, 3)
    ),
    "lag": Certificate("first-order amplifier, to T", (lag,), {"lag": 0.0}),
    "pooled": Certificate(
        "numbers of each axis", (pooled,), {"resolution": 0.0}, axes=(1, 2, 2, 3)
    ),
    "joints": Certificate("an arm, energy at the tip", (joints,), {"resolution": 0.0}, axes=(2,)),
    "tolerance": Certificate(
        "silent watchdog in a range", (tolerance,), {"watchdog_tolerance": 0.0}
    ),
    "reporting": Certificate("reporting watchdog", (reporting,)),
    "guarding": Certificate("guarding watchdog", (guarding,)),
    "guarding_late": Certificate(
        "guarding watchdog, first look early or late within a tolerance",
        (tolerance, guarding),
        {"watchdog_tolerance": 0.0},
    ),
    "guarding_phantom": Certificate(
        "guarding watchdog, the simulated PHANToM, first look 5 us early or late",
        (phantom, guarding),
        {"watchdog_tolerance": 0.0},
        axes=(1,),
    ),
    "guarding_drop": Certificate(
        "guarding watchdog, drop some time after the look, within a tolerance",
        (guarding, drops_late),
        {"watchdog_tolerance": 0.0},
    ),
    "guarding_all": Certificate(
        "guarding watchdog, elastic friction, gain error, other hold limits",
        (presliding, gain_of_axes, changing, guarding),
        {"presliding": 0.0},
        axes=(1, 2, 3),
    ),
    "guarding_weight": Certificate(
        "guarding watchdog and compensated weight: the ledger alone", (weight_cut, guarding)
    ),
    "none": Certificate(
        "no watchdog, late holds leak the allowance", (none,), {"watchdog": "silent"}
    ),
    "none_punctual": Certificate("no watchdog, punctual", (none_punctual,)),
    "changing": Certificate("changing hold limits", (changing,)),
    "changing_reporting": Certificate(
        "changing hold limits, reporting watchdog", (reporting, changing)
    ),
    "refused": Certificate("refused readings", (refused,)),
    "glitches": Certificate(
        "glitches beyond the largest speed", (glitches,), {"largest_speed": math.inf}
    ),
    "too_fast": Certificate("a hand faster than stated", (too_fast,)),
    "cap": Certificate("capped ledger", (cap,)),
    "delay_and_speed": Certificate(
        "writes late, with a largest speed", (write_delay, glitches), {"write_delay": 0.0}
    ),
    "late_writes": Certificate(
        "writes late and a silent watchdog in a range", (write_delay, tolerance)
    ),
    "none_and_lag": Certificate("no watchdog, a lag", (lag, none), {"lag": 0.0}),
    "none_and_delay": Certificate(
        "no watchdog, writes late", (write_delay, none), {"write_delay": 0.0}
    ),
    "lag_and_presliding": Certificate(
        "a lag and elastic friction", (lag, presliding), {"lag": 0.0}
    ),
    "weight": Certificate("compensated weight", (weight,), {"weight_error": 0.0}),
    "weight_cut": Certificate("compensated weight, cuts: the ledger alone", (weight_cut,)),
    "gain_and_weight": Certificate(
        "gain error and compensated weight", (gain, weight), {"gain_error": 0.0}
    ),
    "all": Certificate("a random choice of all of these", ()),
}


def draw(name: str, law: str, random: Random, left_out: bool = False) -> Case:
    """Return a random case of a certificate, with ``left_out`` one that must break the law.

    Args:
        name: A key of :data:`CERTIFICATES`.
        law: A law.
        random: Source of chance.
        left_out: State the certificate's own numbers as if the device did not have the effect.
    """
    certificate = CERTIFICATES[name]
    draft = _plain(random, int(random.choice(certificate.axes)))
    effects = list(certificate.effects) if name != "all" else _some(random, draft.axes)
    for effect in effects:
        effect(draft)
    fields = draft.fields | (certificate.left_out if left_out else {})
    return finished(law, draft, Dissipation(**fields))


def _some(random: Random, axes: int) -> list[Effect]:
    """Return effects that go together, in the order in which they are drawn."""
    own: list[list[Effect]] = [[pooled], [joints], []]
    chosen = list(own[random.choice([0, 1, 2] if axes == 2 else [0, 2])])
    often = (write_delay, presliding, lag, changing, refused, glitches, cap, gain)
    chosen += [effect for effect in often if random.random() < 0.4]
    if random.random() < 0.2:
        chosen.append(weight)
    watchdogs: list[list[Effect]] = [[], [tolerance], [reporting], [none], [none_punctual]]
    if lag not in chosen and write_delay not in chosen:
        watchdogs.append([guarding])
    return chosen + watchdogs[random.integers(len(watchdogs))]


def finished(law: str, draft: Draft, stated: Dissipation) -> Case:
    """Return the case of a device as it is, and as it is ``stated``, with a manner of attack."""
    random, axes = draft.random, draft.axes
    clock = 3 if draft.case.get("ledger_only") else int(random.choice([0, 1, 2, 3, 3]))
    longest = 50.0 * stated.period
    if draft.case.get("watchdog") == "none":
        longest = 2.0 * draft.fields["watchdog_limit"]
    punctual = draft.case.pop("punctual_only", False)
    if draft.device[at.COMPENSATION].any() and draft.case.get("tolerance"):
        draft.case["ledger_only"] = True  # an early cut lets the weight fall
    manner = Manner(
        int(random.integers(len(READINGS))),
        int(random.integers(len(COMMANDS))),
        clock,
        _log(random, 1e-3, 1.0),
        max(longest, stated.hold_limit),
        stated.saturation,
        punctual,
    )
    if math.isfinite(stated.largest_speed):
        manner = replace(manner, speed=min(manner.speed, stated.largest_speed))
    return Case(law, stated, axes, draft.device, draft.numbers, manner, **draft.case)
