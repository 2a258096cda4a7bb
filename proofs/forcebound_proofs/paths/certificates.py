"""The certificates under attack: for each, how devices are drawn, and what is left out to break it.

A device is drawn first as it *is*; then it is stated to the bounder, truthfully or, to show that
the attack would see the leak, with the certificate's own number stated as if the device did not
have the effect.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from forcebound.haptics.laws import Dissipation
from forcebound.haptics.laws.dissipation import ATTENUATES
from forcebound_proofs.paths.draft import Draft, Random, log_between, plain
from forcebound_proofs.paths.path import Command, Manner, Reading
from forcebound_proofs.paths.run import AttackedDevice

Effect: TypeAlias = Callable[["Draft"], None]


class Certificate(NamedTuple):
    """What is attacked."""

    summary: str  # one line for the report
    effects: tuple[Effect, ...]  # that give a device its imperfections, in this order
    left_out: str = ""  # what is left out in the run that must break the law: a field, mostly
    axes: tuple[int, ...] = (1, 1, 2, 3)  # numbers of axes to draw from


#: A field that is left out is stated as this, others as 0.
LEFT_OUT = {
    "watchdog": "silent",
    "attenuates": "never",
    "largest_speed": math.inf,
    "hand_speed": 1e-3,
}


def write_delay(draft: Draft) -> None:
    """Writes take effect up to 2.5 T after the reading, also after the next ones."""
    longest = 0.4 if draft.random.random() < 0.4 else 2.5
    draft.fields["write_delay"] = draft.fields["period"] * log_between(draft.random, 0.01, longest)
    draft.case["write_delay"] = draft.fields["write_delay"]


def later_than_stated(draft: Draft) -> None:
    """Writes take effect up to 2.5 T after the reading, and a shorter time is stated."""
    write_delay(draft)
    draft.fields["write_delay"] *= draft.random.choice([0.0, 0.3, 0.8])
    draft.case["owes"] = True


def presliding(draft: Draft) -> None:
    """Friction yields elastically."""
    axes = draft.axes
    ways = tuple(log_between(draft.random, 1e-6, 3e-4) for _ in range(axes))
    draft.fields["presliding"] = ways if axes > 1 else ways[0]
    if axes > 1:
        draft.fields["friction"] = draft.per_axis("friction")
        draft.device.is_along_path = False
    draft.device.presliding[:axes] = draft.per_axis("presliding")


def gain(draft: Draft) -> None:
    """Every motor gives a constant factor of its force, alike on each axis."""
    error = log_between(draft.random, 0.005, 0.2)
    draft.fields["gain_error"] = error
    draft.device.gain[:] = 1.0 + error * draft.random.choice(
        [-1.0, 1.0, draft.random.uniform(-1, 1)]
    )


def gain_of_axes(draft: Draft) -> None:
    """Every motor has a factor of its own."""
    error = log_between(draft.random, 0.005, 0.2)
    draft.fields["gain_error"] = error
    draft.device.gain[:] = 1.0 + error * draft.random.choice([-1.0, 1.0], 3)


def in_turn(draft: Draft) -> None:
    """Late writes and motors with gains of their own, one of which stores work, another holds."""
    stated = {"damping": 0.27, "friction": 0.12, "resolution": 0.0, "saturation": 8.5}
    error, period = draft.random.uniform(0.05, 0.2), 1e-3
    draft.fields |= stated | {"period": period, "hold_limit": period, "gain_error": error}
    device, axes = draft.device, draft.axes
    device.damping[:axes], device.friction[:axes], device.error[:] = 0.27, 0.12, 0.0
    device.gain[:2] = 1.0 - error, 1.0 + error
    draft.case["command"] = Command.SLOWLY
    draft.fields["write_delay"] = draft.case["write_delay"] = 0.4 * period


def lag(draft: Draft) -> None:
    """The amplifier is of first order."""
    draft.fields["lag"] = draft.fields["period"] * log_between(draft.random, 0.02, 1.0)
    draft.device.lag = draft.fields["lag"]


def _of_axes(draft: Draft, draws: Callable[[str], float]) -> None:
    """Give each axis damping, friction and resolution of its own."""
    device, axes = draft.device, draft.axes
    for name in ("damping", "friction", "resolution"):
        draft.fields[name] = tuple(draws(name) for _ in range(axes))
    device.damping[:axes], device.friction[:axes] = (
        draft.fields["damping"],
        draft.fields["friction"],
    )
    device.error[:axes] = np.array(draft.fields["resolution"]) * 0.5
    device.is_along_path = False


def pooled(draft: Draft) -> None:
    """Every axis has its own damping, friction and resolution."""
    means = dict(draft.fields)
    _of_axes(draft, lambda name: float(means[name] * log_between(draft.random, 0.2, 5.0)))


def joints(draft: Draft) -> None:
    """Coordinates are the two joints of an arm; rad and N m."""
    ranges = {"damping": (5e-4, 0.02), "friction": (1e-3, 0.05), "resolution": (1e-5, 2e-3)}
    _of_axes(draft, lambda name: log_between(draft.random, *ranges[name]))
    draft.fields["saturation"] = log_between(draft.random, 0.1, 2.0)
    draft.device.is_at_tip = True


def tolerance(draft: Draft) -> None:
    """A silent watchdog that is early or late."""
    draft.fields["watchdog"] = "silent"
    draft.fields["watchdog_tolerance"] = log_between(draft.random, 0.01, 0.3)
    draft.case["tolerance"] = draft.fields["watchdog_tolerance"]


def reporting(draft: Draft) -> None:
    """The watchdog reports when and where it dropped the force."""
    draft.fields["watchdog"] = draft.case["watchdog"] = "reporting"


def guarding(draft: Draft) -> None:
    """The watchdog guards a late force."""
    draft.fields["watchdog"] = draft.case["watchdog"] = "guarding"
    draft.fields["guard_period"] = draft.fields["period"] * log_between(draft.random, 0.01, 0.99)
    draft.device.guard = draft.fields["guard_period"]


def phantom(draft: Draft) -> None:
    """The numbers of the simulated PHANToM Premium 1.5, whose first look is up to 5 us late."""
    stated = {"damping": 0.27, "friction": 0.12, "resolution": 3e-5, "saturation": 8.5}
    draft.fields |= stated | {"period": 1e-3, "hold_limit": 1.02e-3}
    device = draft.device
    device.damping[0], device.friction[0], device.error[0] = 0.27, 0.12, 1.5e-5
    draft.case["tolerance"] = draft.fields["watchdog_tolerance"] = 5 / 1020


def drops_late(draft: Draft) -> None:
    """A guarding watchdog needs some time to drop a force: a look at the limit comes too late."""
    drop = round(draft.fields["guard_period"] * draft.random.uniform(0.05, 0.9), 9)
    draft.device.guard, draft.device.drop = draft.fields["guard_period"] - drop, drop
    draft.fields["watchdog_tolerance"] = drop / draft.fields["hold_limit"]


def none(draft: Draft) -> None:
    """No watchdog; late holds up to the hardware's limit may leak the allowance."""
    hold = draft.fields["hold_limit"]
    draft.fields["watchdog"] = draft.case["watchdog"] = "none"
    draft.fields["watchdog_limit"] = round(hold * log_between(draft.random, 1.5, 100.0) * 1e9) / 1e9
    strict = draft.random.random() < 0.2
    draft.fields["allowance"] = 0.0 if strict else log_between(draft.random, 1e-6, 0.1)
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
        round(hold * log_between(draft.random, 1.0, 4.0) * 1e9) / 1e9 for _ in range(4)
    )


def refused(draft: Draft) -> None:
    """Readings that are not numbers, or out of this world, or too soon."""
    draft.case["refused"] = log_between(draft.random, 0.02, 0.5)
    draft.case["glitch"] = 0.0


def glitches(draft: Draft) -> None:
    """Readings that imply more than the largest speed; the hand may exceed it."""
    draft.case["refused"] = log_between(draft.random, 0.02, 0.5)
    draft.fields["largest_speed"] = draft.case["glitch"] = log_between(draft.random, 0.05, 5.0)


def too_fast(draft: Draft) -> None:
    """A hand that exceeds the stated largest speed: readings that are true are refused."""
    draft.fields["largest_speed"] = log_between(draft.random, 0.001, 0.5)


def hand_speed(draft: Draft) -> None:
    """A hand of at most the stated speed, which it may exceed within a period."""
    device, fields = draft.device, draft.fields
    fields["hand_speed"] = device.fastest = log_between(draft.random, 0.01, 3.0)
    device.burst = fields["period"]


def fast_hand(draft: Draft) -> None:
    """A hand that is faster in intervals in which the readings show it."""
    hand_speed(draft)
    draft.device.seen = 4.0 * float(np.linalg.norm(draft.device.error))
    draft.case["owes_speed"] = True


def attenuates(draft: Draft) -> None:
    """Every motor leaves out what it likes, of each written force or at any time."""
    most = 1 if np.any(draft.fields.get("presliding", 0.0)) else 2  # freely: refused
    draft.device.attenuates = min(draft.random.integers(1, 3), most)
    draft.device.least = draft.fields["least_share"] = draft.random.choice([0.0, 0.0, 0.8])
    draft.fields["attenuates"] = ATTENUATES[draft.device.attenuates]
    if draft.axes > 1:
        draft.fields["friction"] = draft.per_axis("friction")
        draft.device.is_along_path = False


def cap(draft: Draft) -> None:
    """A cap on what the ledger keeps."""
    draft.fields["energy_cap"] = log_between(draft.random, 1e-5, 1e-2)


def weight(draft: Draft) -> None:
    """A weight on each axis that the device compensates, with an error; no hold is cut."""
    axes, random = draft.axes, draft.random
    heavy = random.normal(size=axes)
    # More than friction holds by itself would let the hand have gravity's energy.
    error = min(draft.per_axis("friction")) * log_between(random, 0.01, 0.95) / math.sqrt(axes)
    uncertain = draft.fields.get("gain_error", 0.0)  # the motors carry the weight, too
    if uncertain > 0.0:
        heavy = np.clip(heavy, -0.5 * error / uncertain, 0.5 * error / uncertain)
        error *= 0.5
    draft.fields["weight"], draft.fields["weight_error"] = tuple(heavy.tolist()), error
    draft.device.weight[:axes] = heavy + error * random.choice([-1.0, 1.0], axes)
    draft.device.compensation[:axes] = heavy
    draft.case["punctual_only"] = True


def weight_cut(draft: Draft) -> None:
    """A compensated weight that acts whenever the force is cut."""
    weight(draft)
    draft.case["punctual_only"], draft.case["ledger_only"] = False, True


CERTIFICATES = {
    "plain": Certificate("quantised readings, any clock", (), "resolution"),
    "write_delay": Certificate(
        "writes up to 2.5 T after the reading", (write_delay,), "write_delay"
    ),
    "owed": Certificate(
        "writes later than stated: what the bounder says that they can have given",
        (later_than_stated,),
    ),
    "presliding": Certificate("elastic friction", (presliding,), "presliding"),
    "gain": Certificate("gain error to 20 %", (gain,), "gain_error"),
    "gain_of_axes": Certificate(
        "gain error to 20 %, another in each motor", (gain_of_axes,), axes=(2, 3)
    ),
    "lag": Certificate("first-order amplifier, to T", (lag,), "lag"),
    "pooled": Certificate("numbers of each axis", (pooled,), "resolution", axes=(1, 2, 2, 3)),
    "joints": Certificate("an arm, energy at the tip", (joints,), "resolution", axes=(2,)),
    "tolerance": Certificate("silent watchdog in a range", (tolerance,), "watchdog_tolerance"),
    "reporting": Certificate("reporting watchdog", (reporting,)),
    "guarding": Certificate("guarding watchdog", (guarding,)),
    "guarding_late": Certificate(
        "guarding watchdog, first check early or late within a tolerance",
        (tolerance, guarding),
        "watchdog_tolerance",
    ),
    "guarding_phantom": Certificate(
        "guarding watchdog, the simulated PHANToM, first check 5 us early or late",
        (phantom, guarding),
        "watchdog_tolerance",
        axes=(1,),
    ),
    "guarding_drop": Certificate(
        "guarding watchdog, drop some time after the check, within a tolerance",
        (guarding, drops_late),
        "watchdog_tolerance",
    ),
    "guarding_all": Certificate(
        "guarding watchdog, elastic friction, gain error, other hold limits",
        (presliding, gain_of_axes, changing, guarding),
        "presliding",
        axes=(1, 2, 3),
    ),
    "guarding_weight": Certificate(
        "guarding watchdog and compensated weight: the ledger alone", (weight_cut, guarding)
    ),
    "none": Certificate("no watchdog, late holds leak the allowance", (none,), "watchdog"),
    "none_punctual": Certificate("no watchdog, punctual", (none_punctual,)),
    "changing": Certificate("changing hold limits", (changing,)),
    "changing_reporting": Certificate(
        "changing hold limits, reporting watchdog", (reporting, changing)
    ),
    "refused": Certificate("refused readings", (refused,)),
    "glitches": Certificate("glitches beyond the largest speed", (glitches,), "largest_speed"),
    "too_fast": Certificate("a hand faster than stated", (too_fast,)),
    "hand_speed": Certificate("a largest speed of the hand", (hand_speed,), "hand_speed"),
    "hand_speed_delay": Certificate(
        "a largest speed of the hand, writes late", (write_delay, hand_speed), "hand_speed"
    ),
    "hand_speed_lag": Certificate(
        "a largest speed of the hand, a lag", (lag, hand_speed), "hand_speed"
    ),
    "hand_speed_late": Certificate(
        "a largest speed of the hand, no watchdog", (none, hand_speed), "hand_speed"
    ),
    "hand_speed_guard": Certificate(
        "a largest speed of the hand, a guard", (guarding, hand_speed), "hand_speed"
    ),
    "fast_hand": Certificate(
        "a hand faster than stated: what the bounder says that it can have got",
        (fast_hand,),
        "owes_speed",
    ),
    "fast_hand_delay": Certificate("the same, writes late", (write_delay, fast_hand), "owes_speed"),
    "fast_hand_lag": Certificate("the same, a lag", (lag, fast_hand), "owes_speed"),
    "fast_hand_late": Certificate("the same, no watchdog", (none, fast_hand), "owes_speed"),
    "cap": Certificate("capped ledger", (cap,)),
    "attenuates": Certificate("motors attenuate", (attenuates,), "attenuates"),
    "attenuates_late": Certificate(
        "motors attenuate, writes late", (write_delay, attenuates), "attenuates"
    ),
    "attenuates_joints": Certificate(
        "motors of an arm attenuate, energy at the tip", (joints, attenuates), "attenuates", (2,)
    ),
    "attenuates_all": Certificate(
        "motors attenuate, glitches, no watchdog, other hold limits",
        (glitches, none, changing, attenuates),
        "attenuates",
    ),
    "attenuates_presliding": Certificate(
        "motors attenuate, elastic friction, glitches, other hold limits",
        (presliding, glitches, changing, attenuates),
        "attenuates",
    ),
    "attenuates_cuts": Certificate(
        "motors attenuate, a watchdog in a range", (tolerance, attenuates), "attenuates"
    ),
    "delay_and_speed": Certificate(
        "writes late, with a largest speed", (write_delay, glitches), "write_delay"
    ),
    "delay_and_gains": Certificate(
        "writes late, another gain error in each motor, one after the other",
        (in_turn,),
        axes=(2, 3),
    ),
    "late_writes": Certificate(
        "writes late and a silent watchdog in a range", (write_delay, tolerance)
    ),
    "late_reports": Certificate(
        "writes late and a reporting watchdog", (write_delay, reporting), "write_delay"
    ),
    "none_and_lag": Certificate("no watchdog, a lag", (lag, none), "lag"),
    "none_and_delay": Certificate("no watchdog, writes late", (write_delay, none), "write_delay"),
    "lag_and_delay": Certificate("a lag, and writes late", (write_delay, lag), "lag"),
    "lag_and_presliding": Certificate("a lag and elastic friction", (lag, presliding), "lag"),
    "weight": Certificate("compensated weight", (weight,), "weight_error"),
    "weight_cut": Certificate("compensated weight, cuts: the ledger alone", (weight_cut,)),
    "gain_and_weight": Certificate(
        "gain error and compensated weight", (gain, weight), "gain_error"
    ),
    "energy_transfer": Certificate(
        "two hands that exchange energy over a bad link", (), "the largest total seen"
    ),
    "all": Certificate("a random choice of all of these", ()),
    "all_and_gains": Certificate(
        "the same, another gain error in each motor", (gain_of_axes,), axes=(2, 3)
    ),
    "all_and_speed": Certificate(
        "the same, a largest speed of the hand", (hand_speed,), "hand_speed"
    ),
}


def draw(name: str, law: str, random: Random, left_out: bool = False) -> AttackedDevice:
    """Return a random case of a certificate, with ``left_out`` one that must break the law.

    Args:
        name: A key of :data:`CERTIFICATES`.
        law: A law.
        random: Source of chance.
        left_out: State the certificate's own numbers as if the device did not have the effect.
    """
    certificate = CERTIFICATES[name]
    draft = plain(random, int(random.choice(certificate.axes)))
    effects = list(certificate.effects)
    if name.startswith("all"):
        own = gain_of_axes in effects
        effects += [one for one in _some(random, draft.axes) if one is not gain or not own]
    if hand_speed in effects:  # joints have other speeds than the tip; and what is not proved
        effects = [one for one in effects if one is not joints]
        if {presliding, tolerance, reporting} & set(effects):
            effects = [one for one in effects if one is not lag]
    for effect in effects:
        effect(draft)
    if left_out and certificate.left_out:
        # A number that the device states, or a debt that the bounder says.
        where = draft.case if certificate.left_out == "owes_speed" else draft.fields
        where[certificate.left_out] = LEFT_OUT.get(certificate.left_out, 0.0)
    return finished(law, draft)


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


def finished(law: str, draft: Draft, speed: float | None = None) -> AttackedDevice:
    """Return a device as it is, and as its fields state it, with a manner of attack.

    ``speed``: of the hand, m/s; None: it is drawn.
    """
    random, stated = draft.random, Dissipation(**draft.fields)
    clock = 3 if draft.case.get("ledger_only") else int(random.choice([0, 1, 2, 3, 3]))
    longest = 50.0 * stated.period
    if draft.case.get("watchdog") == "none":
        longest = 2.0 * draft.fields["watchdog_limit"]
    punctual = draft.case.pop("punctual_only", False)
    if draft.device.compensation.any() and draft.case.get("tolerance"):
        draft.case["ledger_only"] = True  # an early cut lets the weight fall
    reading = Reading(int(random.integers(len(Reading))))
    command = Command(int(random.integers(Command.SLOWLY)))  # any of those before it
    command = draft.case.pop("command", command)
    drawn = min(log_between(random, 1e-3, 1.0), stated.largest_speed)
    if stated.hand_speed < math.inf and random.random() < 0.5:
        drawn = stated.hand_speed
    manner = Manner(
        reading=reading,
        command=command,
        clock=clock,
        speed=drawn if speed is None else speed,
        longest=max(longest, stated.hold_limit),
        saturation=stated.saturation,
        punctual=punctual,
    )
    return AttackedDevice(law, stated, draft.devices, manner, **draft.case)
