"""The verdict on a run: at most five lines in words, from its summary.

Passive or not, and by how much; at rest or not; the stiffness felt of that asked, and what took the
rest; what failed, if something did.
"""

from collections.abc import Iterator

from msgspec.structs import replace

from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.messages.topology import Document
from forcebound.recordings.launched import DeviceSection, Launched, launched
from forcebound.results.cells import Summary, lost
from forcebound.results.promises import COSTS_FORCE, in_words, is_uncovered
from forcebound.results.samples import is_certified
from forcebound.units import MM, energy_in_words, in_unit

MOST_LAWS = 4  # lines, of a run that changed its law: the last ones
ALL = 0.995  # of the stiffness
MISSED_SHARE = 1e-3  # of the ticks; fewer are not worth a word
STAYS = "pressing"  # the hand that a passive wall brings to rest; others move by themselves

WALL = "wall"  # in place of a hand: nobody holds this device
BODIES = ("bodies", "mass_spring")  # environments whose stiffness is not that of what is touched
BETWEEN = "Spring between hand and body"  # which has it


def verdict(summary: Summary, document: Document) -> list[str]:
    """Return the lines.

    Args:
        summary: Of the run.
        document: The launch file as resolved for the run.
    """
    failed, run = summary.get("failed", ""), launched(document)
    lines = [f"Failed: {_cause(failed)}."] if failed else []
    if "laws" in summary:
        for one in summary["laws"][len(lines) - MOST_LAWS :]:
            own = replace(run, device=replace(run.device, law=one["law"]))
            start = f"{one['law']}, from {one['start_s']:.3g} s"
            lines.append(f"{start}: {_passivity(one, own)} {_felt(one, own)}.")
    elif summary["samples"]:
        lines += [
            _passivity(summary, run),
            _rest(summary, run),
            _stiffness(summary, run),
            "" if failed else _reason(summary),
        ]
    elif not failed:
        lines = ["No force: it never engaged."]
    failures = "; ".join(_failures(summary, run))
    return [line for line in (*lines, failures and f"Faults: {failures}.") if line]


def _cause(failed: str) -> str:
    """Return on one line why a run failed: of a process that ended, what it said itself."""
    first, _, tail = failed.partition("; its last lines:")
    said = tail.rpartition("forcebound: ")[2] if "forcebound: " in tail else ""
    return " ".join(f"{first}: {said}".split()).removesuffix(":")


def _passivity(s: Summary, run: Launched) -> str:
    lowest, device = s["true_energy_min_j"], run.device
    known = _motor(s) if lowest is None else _received(s, run)
    promises = s["broken_promises"]
    costly = "".join(f"{in_words(one)}. " for one in promises if one["promise"] == COSTS_FORCE)
    paid = [one for one in promises if not is_uncovered(one) and one["promise"] != COSTS_FORCE]
    if broken := "; ".join(map(in_words, filter(is_uncovered, promises))):
        first = f"Not covered by the certificate: {broken}. In this run {known}."
    elif paid:
        words = "; ".join(map(in_words, paid))
        first = f"Covered by the certificate all the same: {words}. In this run {known}."
    elif lowest is None:
        first = _passivity_without_truth(s, device, known)
    elif lowest >= -ENERGY_TOLERANCE:
        first = f"Passive: {known}."
    elif device.energy_partner:  # both together are judged by results.coupling
        first = f"{known[0].upper()}{known[1:]}."
    else:
        allowed = device.allowance if _is_certified(s, device) else 0.0
        within = f"Passive but for device.allowance ({energy_in_words(allowed)})"
        first = f"{'Not passive' if lowest < -allowed else within}: {known}."
    return costly + first


def _is_certified(s: Summary, device: DeviceSection) -> bool:
    return is_certified(device.law or s["law"])  # that of a summary may begin with its hand


def _received(s: Summary, run: Launched) -> str:
    """What a hand received, or the simulated thing that a device meets, from ground truth."""
    lowest, left = s["true_energy_min_j"], s["energy_left_j"]
    hand = "what it meets" if run.operator.kind == WALL else "the hand"
    if lowest >= -ENERGY_TOLERANCE:
        words = f"{hand} never received energy that it had not put in"
        if left is None or left <= 0.0:
            return words
        return f"{words}; since contact, {energy_in_words(left)} or more were left"
    received = f"{hand} received up to {energy_in_words(-lowest)}"
    if partner := run.device.energy_partner:
        return f"{received} more than it put in, from the ledger of {partner}"
    return f"{received} that it had not put in"


def _motor(s: Summary) -> str:
    """What the motor gave: of a real device, what its friction takes is not known."""
    given, error = _given(s)
    if given + error <= ENERGY_TOLERANCE:
        return "the motor never gave more energy than it took"
    if given <= error:
        return f"the motor gave at most {energy_in_words(given + error)} more than it took"
    about = f" (± {energy_in_words(error)})" if error > ENERGY_TOLERANCE else ""
    return f"the motor gave up to {energy_in_words(given)}{about} more than it took"


def _given(s: Summary) -> tuple[float, float]:
    """What the motor gave more than it took, and how much more that may be, in J."""
    return -(s["observed_energy_min_j"] or 0.0), s["observed_energy_error_j"] or 0.0


def _passivity_without_truth(s: Summary, device: DeviceSection, motor: str) -> str:
    if sum(_given(s)) <= ENERGY_TOLERANCE:
        return f"Passive, as far as readings tell: {motor}."
    if not _is_certified(s, device):
        return f"Unknown if passive: {motor}; the device's own friction may have taken that."
    leaked = s["largest_allowance_j"]
    but = f" but for at most {energy_in_words(leaked)} (device.allowance)" if leaked else ""
    trust = "if the device's numbers are right"
    if device.watchdog == "silent" and s["hold_limit_overruns"]:
        trust += f" and its watchdog dropped {_counted(s['hold_limit_overruns'], 'late force')}"
    covered = "which its friction and damping cover"
    return f"Passive by the certificate{but}, {trust}: {motor}, {covered}."


def _rest(s: Summary, run: Launched) -> str:
    speed, amplitude, turns = (
        s[key] for key in ("final_speed_m_per_s", "limit_cycle_amplitude_m", "contact_bounces")
    )
    if speed is None:
        return "" if amplitude is None else f"The last 0.5 s: within {MM.show(2.0 * amplitude)}."
    if s["at_rest"]:
        depth = s["penetration_at_rest_m"]
        return "At rest at the end" + (f", {MM.show(depth)} deep." if depth else ".")
    words = f"Not at rest: it moves at {float(f'{1e3 * speed:.3g}'):g} mm/s at the end"
    words += f", and turned round {_times(turns)} after first contact." if turns else "."
    hand = run.operator.kind
    if hand in ("", STAYS, WALL):
        return words
    return f"{words} (A hand of kind {hand} may do that by itself.)"


def _stiffness(s: Summary, run: Launched) -> str:
    stiffness, words = s["stiffness_n_per_m"], _felt(s, run)
    if run.environment.get("kind") == "coupling":
        return ""  # a line for both hands says it
    if stiffness is None or abs(stiffness["felt"] / stiffness["asked"] - 1.0) <= 1.0 - ALL:
        return f"{words}."
    words += f" ({stiffness['felt'] / stiffness['asked']:.0%}"
    words += ")" if s["at_rest"] is not False else ", a mean, since the hand moved)"
    if stiffness["felt"] > stiffness["asked"]:
        return f"{words}."
    if stiffness["shares"] is None:
        return (
            f"{words}; what took the rest cannot be separated, since late answers also add force."
        )
    percent = {name: round(100.0 * share) for name, share in stiffness["shares"].items()}
    largest = next(iter(percent))
    percent[largest] += 100 - sum(percent.values())
    taken = ", ".join(f"{name} {share}%" for name, share in percent.items() if share)
    return f"{words}; the rest was taken by: {taken}."


def _felt(s: Summary, run: Launched) -> str:
    mean, of = s["displayed_stiffness_n_per_m"], s["stiffness_n_per_m"]
    unit = run.units.get("environment.stiffness", "N/mm")
    if of is not None:
        felt, asked = (in_unit(of[key], unit, 3) for key in ("felt", "asked"))
        what = BETWEEN if run.environment.get("kind") in BODIES else "Stiffness felt"
        return f"{what}: {felt} of {asked}"
    if mean is not None:
        return f"Stiffness felt: {in_unit(mean, unit, 3)}; the environment has no constant one"
    return f"Stiffness felt: not known, {s['undefined']['displayed_stiffness_n_per_m']}"


def _reason(s: Summary) -> str:
    if not s["little_force"]:
        return ""
    cause, more = s["little_force"][0], len(s["little_force"]) - 1
    others = f" ({more} more: --all)" if more else ""
    return f"Why not more: {cause['advice']}.{others}"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _failures(s: Summary, run: Launched) -> Iterator[str]:
    counted = ("ticks_missed", *(["readings_refused"] if s["refused_readings"] else []))
    for kind, count in s["faults"].items():
        if kind not in counted:  # below
            yield f"{kind.replace('_', ' ')} {_times(count)}"
    rejected = ", ".join(f"{count} {why}" for why, count in s["rejected_packets"].items() if count)
    if rejected:
        yield f"packets rejected: {rejected}"
    missed = s["deadline_misses"] or 0
    share = missed / (missed + s["samples"] or 1)
    if share > MISSED_SHARE:
        yield f"{_counted(missed, 'tick')} missed ({share:.1%}){_of_the_device(s, run)}"
    if s["refused_readings"] and all(map(is_uncovered, s["broken_promises"])):
        yield f"{_counted(s['refused_readings'], 'reading')} refused"
    lost_packets = lost(s)
    if lost_packets != "0":
        yield f"lost or damaged, as the links are set: {lost_packets}"


def _of_the_device(s: Summary, run: Launched) -> str:
    """Why the device itself misses ticks; empty: it does not."""
    busy, rate = s["reads_and_writes_s"] or 0.0, run.device.rate or 0.0
    if busy * rate <= 1.0:
        return ""
    return (
        f", since its reads and writes take {1e3 * busy:.2g} ms of a period of {1e3 / rate:.2g} ms"
    )
