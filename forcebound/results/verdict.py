"""The verdict on a run: at most five lines in words, from its summary.

Passive or not, and by how much; at rest or not; the stiffness felt of that asked, and what took the
rest; what failed, if something did.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from forcebound.haptics.laws import ENERGY_TOLERANCE, LAWS
from forcebound.results.cells import MM, Summary, energy, lost
from forcebound.units import in_unit

MOST_LAWS = 4  # lines, of a run that changed its law: the last ones
ALL = 0.995  # of the stiffness
MISSED_SHARE = 1e-3  # of the ticks; fewer are not worth a word
STAYS = "pressing"  # the hand that a passive wall brings to rest; others move by themselves


def verdict(summary: Summary, document: Mapping[str, Any]) -> list[str]:
    """Return the lines.

    Args:
        summary: Of the run.
        document: The launch file as resolved for the run.
    """
    if "laws" in summary:
        lines = [
            f"{one['law']}, from {one['start_s']:.3g} s: {_passivity(one, document)}"
            f" {_felt(one, document)}."
            for one in summary["laws"][-MOST_LAWS:]
        ]
    elif summary["samples"]:
        lines = [
            _passivity(summary, document),
            _rest(summary, document),
            _stiffness(summary, document),
        ]
        lines += [_reason(summary)]
    else:
        lines = ["No force: it never engaged."]
    failures = "; ".join(_failures(summary, document))
    return [line for line in (*lines, failures and f"Faults: {failures}.") if line]


def _passivity(s: Summary, document: Mapping[str, Any]) -> str:
    lowest, left = s["true_energy_min_j"], s["energy_left_j"]
    if lowest is None:
        return _passivity_without_truth(s)
    partner = (document.get("device") or {}).get("energy_partner")
    if lowest < -ENERGY_TOLERANCE and partner:  # both together are judged by results.coupling
        more = f"up to {energy(-lowest)} more than it put in"
        return f"The hand received {more}, from the ledger of {partner}."
    if lowest < -ENERGY_TOLERANCE:
        return f"Not passive: the hand received up to {energy(-lowest)} that it had not put in."
    least = (
        f"; since contact, {energy(left)} or more were left"
        if left is not None and left > 0.0
        else ""
    )
    return f"Passive: the hand never received energy that it had not put in{least}."


def _passivity_without_truth(s: Summary) -> str:
    """Of a real device: only its motor is known, not what its friction takes."""
    given = -(s["observed_energy_min_j"] or 0.0)
    if given <= ENERGY_TOLERANCE:
        return "Passive, as far as readings tell: the motor never gave more energy than it took."
    motor = f"the motor gave up to {energy(given)} more than it took"
    law = s["law"]
    if not (law is not None and LAWS.is_shipped(law) and LAWS[law].is_certified):
        return f"Unknown if passive: {motor}; the device's own friction may have taken that."
    if s["late_writes"]:
        late = _counted(s["late_writes"], "write")
        return f"Unknown if passive: {late} came later than the certificate has."
    covered = "which its friction and damping cover"
    return f"Passive by the certificate, if the device's numbers are right: {motor}, {covered}."


def _rest(s: Summary, document: Mapping[str, Any]) -> str:
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
    hand = (document.get("operator") or {}).get("kind", STAYS)
    return words if hand == STAYS else f"{words} (A hand of kind {hand} may do that by itself.)"


def _stiffness(s: Summary, document: Mapping[str, Any]) -> str:
    stiffness, words = s["stiffness_n_per_m"], _felt(s, document)
    if (document.get("environment") or {}).get("kind") == "coupling":
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


def _felt(s: Summary, document: Mapping[str, Any]) -> str:
    mean, of = s["displayed_stiffness_n_per_m"], s["stiffness_n_per_m"]
    unit = (document.get("units") or {}).get("environment.stiffness", "N/mm")
    if of is not None:
        felt, asked = (in_unit(of[key], unit, 3) for key in ("felt", "asked"))
        return f"Stiffness felt: {felt} of {asked}"
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


def _failures(s: Summary, document: Mapping[str, Any]) -> Iterator[str]:
    for kind, count in s["faults"].items():
        if kind != "ticks_missed":  # they are counted below
            yield f"{kind.replace('_', ' ')} {_times(count)}"
    rejected = ", ".join(f"{count} {why}" for why, count in s["rejected_packets"].items() if count)
    if rejected:
        yield f"packets rejected: {rejected}"
    missed = s["deadline_misses"] or 0
    share = missed / (missed + s["samples"] or 1)
    if share > MISSED_SHARE:
        yield f"{_counted(missed, 'tick')} missed ({share:.1%}){_of_the_device(s, document)}"
    if s["refused_readings"]:
        yield f"{_counted(s['refused_readings'], 'reading')} refused"
    lost_packets = lost(s)
    if lost_packets != "0":
        yield f"lost or damaged, as the links are set: {lost_packets}"


def _of_the_device(s: Summary, document: Mapping[str, Any]) -> str:
    """Why the device itself misses ticks; empty: it does not."""
    busy, rate = s["reads_and_writes_s"] or 0.0, (document.get("device") or {}).get("rate", 0.0)
    if busy * rate <= 1.0:
        return ""
    return (
        f", since its reads and writes take {1e3 * busy:.2g} ms of a period of {1e3 / rate:.2g} ms"
    )
