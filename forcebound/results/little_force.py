"""Why a run's hand felt less than the environment's stiffness, and what would give more.

Each cause is removed in the twin of the run (:mod:`forcebound.results.twin`): what it takes is what
the hand would have felt more. So is what each remedy would give.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.laws import LAWS
from forcebound.haptics.laws.all_axes import LARGEST_READING
from forcebound.haptics.laws.hold_limit import FLOOR
from forcebound.results.bounder import Cause
from forcebound.results.contact import steady_window
from forcebound.results.ticks import deadline_misses
from forcebound.results.twin import Change, Twin
from forcebound.units import N

if TYPE_CHECKING:
    from forcebound.results.samples import Samples

WHOLE = 0.95  # of the asked stiffness; who feels it has lost nothing
WORTH = 0.1  # of the felt stiffness; less is not worth a word, if it is not most of the loss
LEAST = 0.005  # of the asked stiffness, worth a word where nothing is felt
LATE = 1.3  # periods
SHORT_LIMIT = 0.03  # s, of the launch files that ship
ALLOWANCES = (1e-3, 2e-3, 5e-3, 0.01, 0.015, 0.02)  # J
FASTEST = 5000.0  # Hz, of a live run
#: Causes beside what a law lacks.
NOT_THE_LAWS = ("saturation", "engage_ramp", "soft_controller", "dissipation")
NEEDED = {"law", "rate", "damping", "friction", "resolution", "saturation", "watchdog"}
#: Numbers of a device, and what makes them smaller.
COSTLY = {
    "lag": "an amplifier of larger bandwidth",
    "presliding": "a drive whose friction yields less",
    "gain_error": "a gain that is measured better",
    "weight_error": "a weight that is measured better",
    "resolution": "a finer encoder",
}
#: Controllers that are softer than the wall, whatever the law, and why.
SOFT = {
    "virtual_coupling": (
        "the coupling's spring is in series with the wall: a larger controller.stiffness, or"
        " controller direct with a certified law"
    ),
    "wave_variables": (
        "the wave impedance b is a spring b/T in series with the wall, T the delay each way: a"
        " larger controller.impedance, or less delay"
    ),
}
OPPOSITE = (
    "the environment's force pulls the hand deeper: if it is the force on the hand, return its"
    " opposite (positive resists motion in the positive direction)"
)
PUNCTUAL = "punctual ticks (a quieter machine, realtime.policy: fifo)"
PROMPT = "answers at once (less delay of links and environment, or controller local_model)"


class _Suspect(NamedTuple):
    """What may take stiffness."""

    code: str
    why: str
    without: Change
    remedy: str
    given: Change  # by the remedy
    command: str = ""


def causes_of_little_force(run: "Samples") -> list[Cause]:
    """Return what took stiffness from a run's hand, what took most first.

    Empty if nothing is lost, or the stiffness is not known. What no other cause took is the
    device's little dissipation. Data: what each ``takes`` and its remedy ``gives``, in N/m.
    """
    law, is_known = str(run.device.law), run.config.get("device", {}).keys() >= NEEDED
    if not is_known or not LAWS.is_shipped(law) or run.device.energy_partner:
        return []
    if not {"force", "surface", "stiffness", "contact"}.isdisjoint(run.lacks()):
        return []
    columns = (run.run.position, run.run.commanded_force)
    if not all(np.abs(column).max() < LARGEST_READING for column in columns):
        return []  # of a damaged recording
    try:
        twin = Twin(run)
    except ConfigError:
        return []
    lost, found = twin.asked - twin.felt, list[Cause]()
    if lost <= (1.0 - WHOLE) * twin.asked:
        return []
    assert run.surface is not None
    commanded = run.surface.along(run.columns.commanded_force)
    if float((commanded * run.depth)[run.contact].sum()) < 0.0:
        return [Cause("opposite_sign", OPPOSITE, data={"takes": lost})]
    least = max(min(WORTH * twin.felt, 0.5 * lost), LEAST * twin.asked)
    for suspect in _suspects(twin, run, law):
        with suppress(ConfigError):  # numbers that do not go together
            found += _judged(twin, suspect, least)
    if (kind := run.launched.controller.get("kind")) in SOFT:
        depth = np.where(run.contact & steady_window(run.time), run.depth, 0.0)
        softer = twin.asked - float(depth @ commanded / (depth @ depth))
        if softer >= least:
            found.append(Cause("soft_controller", SOFT[kind], data={"takes": softer}))
    found.sort(key=takes, reverse=True)
    rest = lost - sum(map(takes, found))
    if law != "none" and (rest > 0.5 * lost or not found):
        found.append(_dissipation(twin, rest, LAWS[law].is_certified and not found))
    return found


def takes(cause: Cause) -> float:
    """Return what a cause takes, in N/m."""
    return float(cause.data["takes"])


def split_by_causes(
    shares: Mapping[str, float], causes: Sequence[Cause], lost: float
) -> dict[str, float]:
    """Return the shares of a loss, in N/m, with that of the law by what the law lacked."""
    split = dict(shares)
    left = split.pop("law", 0.0)
    for cause in causes:
        name = cause.code.replace("_", " ")
        part = min(takes(cause) / lost - split.get(name, 0.0), left)
        if part > 0.0 and cause.code not in NOT_THE_LAWS:
            split[name] = split.get(name, 0.0) + part
            left -= part
    split["little dissipation"] = left
    return dict(sorted(split.items(), key=lambda item: -item[1]))


def _judged(twin: Twin, suspect: _Suspect, least: float) -> Iterator[Cause]:
    without = min(twin.would_feel(suspect.without), twin.asked)
    if without - twin.felt < least:
        return
    gives = without if suspect.given is suspect.without else twin.would_feel(suspect.given)
    gives = min(gives, twin.asked)
    if gives - twin.felt >= least:
        advice = f"{suspect.why}: {_given(twin, suspect.remedy, gives)}"
        data = {"takes": without - twin.felt, "gives": gives}
        yield Cause(suspect.code, advice, suspect.command, data)


def _given(twin: Twin, remedy: str, gives: float) -> str:
    return f"{remedy} would give some {twin.text(gives)} in place of {twin.text(twin.felt)}"


def _suspects(twin: Twin, run: "Samples", law: str) -> Iterator[_Suspect]:
    columns, saturation = run.columns, twin.stated.saturation
    if (run.saturated != columns.commanded_force).any():
        why = f"the motors saturate at {saturation:.2g} "
        unit = "N m" if np.isfinite(columns.torques).any() else run.launched.shown(N).unit
        why += f"{unit} (device.saturation)"
        none, twice = (Change({"saturation": k * saturation}) for k in (100.0, 2.0))
        yield _Suspect("saturation", why, none, "motors of twice that", twice)
    if (columns.engagement < 1.0)[run.contact & steady_window(run.time)].any():
        change = Change(is_engaged=True)
        why = "the force was still on its engage ramp (device.engage_time)"
        yield _Suspect("engage_ramp", why, change, "a longer run", change)
    if law == "none":
        return
    if law != "certified":
        change, code = Change(law="certified"), "law_not_certified"
        why = "limits the force as its authors define it"
        if law == "certified_fading":
            code, why = "fading", "forgets within 20 ms what the hand has put in"
        yield _Suspect(code, f"law {law} {why}", change, "law certified", change)
    yield from _of_the_clock(twin, run)
    yield from _of_the_device(twin)
    answered = np.isfinite(columns.reply_age)
    age = float(np.median(columns.reply_age[answered])) if answered.any() else 0.0
    is_soft = run.launched.controller.get("kind") in SOFT  # a prompt answer is as soft
    if not is_soft and (age > twin.stated.period or not answered.all()):
        why = f"half of the answers are {1e3 * age:.2g} ms old or older"
        why += "" if answered.all() else f", and {np.mean(~answered):.1%} of the ticks have none"
        change = Change(is_prompt=True)
        yield _Suspect("late_answers", why, change, PROMPT, change)


def _of_the_clock(twin: Twin, run: "Samples") -> Iterator[_Suspect]:
    period, stated = twin.stated.period, run.device.hold_limit
    if isinstance(stated, float) and stated > FLOOR:
        change = Change({"hold_limit": FLOOR * period})
        why = f"device.hold_limit plans every force for {stated:.3g} periods"
        yield _Suspect("hold_limit", why, change, "device.hold_limit: auto", change)
    share = float(np.mean(np.diff(twin.time) > LATE * period))
    if not share and twin.stated.hold_limit <= LATE * period:
        return
    change = Change(is_punctual=True)
    why = f"{share:.1%} of the ticks come late or after missed ones"
    busy = twin.busy / period
    of_device = 0 if run.report is None else run.report.device_misses
    if 2 * of_device > (deadline_misses(run) or 0) and busy <= 1.0:
        why += ", most of them since a read or write of the device took far more than its usual"
        why += f" {1e3 * twin.busy:.2g} ms"
        command = "forcebound check device"
        remedy = "a device that answers in time"
        yield _Suspect("missed_ticks", why, change, remedy, change, command)
        return
    if busy <= 1.0:
        command = "forcebound doctor --measure"
        yield _Suspect("missed_ticks", why, change, PUNCTUAL, change, command)
        return
    why += f", since the device's own reads and writes take {1e3 * twin.busy:.2g} ms of a period of"
    slower = Change(rate=0.8 / busy, is_punctual=True)
    remedy = f"device.rate: {0.8 / twin.busy:.0f} Hz"
    yield _Suspect("missed_ticks", f"{why} {1e3 * period:.2g} ms", change, remedy, slower)


def _of_the_device(twin: Twin) -> Iterator[_Suspect]:
    stated = twin.stated
    if stated.watchdog == "none":
        # Punctual, since with a shorter limit late holds cost next to nothing.
        least = max(SHORT_LIMIT, stated.hold_limit)
        least = least if twin.model is None else twin.model.possible_limit(least)
        limit = min(stated.watchdog_limit, least)
        why = f"without a watchdog each force is planned for {1e3 * stated.watchdog_limit:.3g} ms"
        why += f" (device.watchdog_limit) less an allowance of {1e3 * stated.allowance:.3g} mJ"
        given = {
            one: Change({"watchdog_limit": limit, "allowance": one}, is_punctual=True)
            for one in (stated.allowance, *ALLOWANCES)
            if one >= stated.allowance
        }
        felt = {one: min(twin.would_feel(change), twin.asked) for one, change in given.items()}
        # With late answers more can give less: a harder first contact empties the ledger.
        most = next(one for one in felt if felt[one] >= WHOLE * max(felt.values()))
        remedy = f"watchdog_limit: {1e3 * limit:.3g} ms, allowance: {1e3 * most:.3g} mJ"
        yield _Suspect("watchdog_limit", why, given[most], remedy, given[most])
    if stated.attenuates != "never":
        share = 0.5 * (1.0 + stated.least_share)
        why = f"the motors may give any share of a force from {stated.least_share:g} on"
        why += f" (device.attenuates: {stated.attenuates})"
        remedy = f"device.least_share: {share:g}, if they always give that,"
        none, half = Change({"attenuates": "never"}), Change({"least_share": share})
        yield _Suspect("attenuates", why, none, remedy, half)
    delay = max(stated.write_delay, float(twin.write_delay.max()))
    if delay > 0.0:
        none, half = (Change({"write_delay": k * stated.write_delay}, delays=k) for k in (0.0, 0.5))
        why = f"a force acts {1e3 * delay:.2g} ms after its reading (device.write_delay)"
        yield _Suspect("write_delay", why, none, "half of that", half)
    for name, remedy in COSTLY.items():
        number = np.asarray(getattr(stated, name))
        if number.any():
            parts = (k * number for k in (0.0, 0.5))
            none, half = (Change({name: tuple(k) if k.ndim else float(k)}) for k in parts)
            yield _Suspect(name, f"device.{name} costs force", none, f"half of it ({remedy})", half)
    if stated.energy_cap is not None:
        change = Change({"energy_cap": None})
        why = f"the ledger keeps at most {1e3 * stated.energy_cap:.2g} mJ (device.energy_cap)"
        yield _Suspect("energy_cap", why, change, "device.energy_cap: auto", change)


def _dissipation(twin: Twin, rest: float, seeks_rate: bool) -> Cause:
    """What is left: damping and friction of the device, and what the hand has put in."""
    advice = f"more damping, or an environment of {twin.text(twin.felt)}, which would feel the same"
    rate, gives = 1.0 / twin.stated.period, twin.felt
    for factor in (2.0, 0.5) if seeks_rate else ():
        if factor * rate <= FASTEST and factor * rate * twin.busy < 1.0:
            with suppress(ConfigError):
                felt = min(twin.would_feel(Change(rate=factor)), twin.asked)
                if felt > max(gives, (1.0 + WORTH) * twin.felt):
                    gives = felt
                    advice = _given(twin, f"device.rate: {factor * rate:.4g} Hz", felt)
    why = "the law gives what the device's dissipation and the hand's motion pay for"
    return Cause("dissipation", f"{why}: {advice}", data={"takes": rest, "gives": gives})
