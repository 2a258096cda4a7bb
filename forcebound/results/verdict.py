"""The verdict on a run: at most five lines in words, from its summary.

Passive or not, and by how much; at rest or not; the stiffness felt of that asked, and what took the
rest; what failed, if something did.
"""

from collections.abc import Iterator

from msgspec.structs import replace

from forcebound.messages.topology import Document
from forcebound.recordings.launched import Launched, launched
from forcebound.results.cells import Summary, lost
from forcebound.results.promises import is_uncovered
from forcebound.results.state import Passivity, counted, state, times
from forcebound.units import N_MM, in_unit

MOST_LAWS = 4  # lines, of a run that changed its law: the last ones
ALL = 0.995  # of the stiffness
MISSED_SHARE = 1e-3  # of the ticks; fewer are not worth a word

BODIES = ("bodies", "mass_spring")  # environments whose stiffness is not that of what is touched
BETWEEN = "Spring between hand and body"  # which has it


def verdict(summary: Summary, document: Document) -> list[str]:
    """Return the lines.

    Args:
        summary: Of the run.
        document: The launch file as resolved for the run.
    """
    failed, run = summary.get("failed", ""), launched(document)
    lines = [_failed(failed, summary.get("hand", ""))] if failed else []
    if "laws" in summary:
        for one in summary["laws"][len(lines) - MOST_LAWS :]:
            own = replace(run, device=replace(run.device, law=one["law"]))
            start = f"{one['law']}, from {one['start_s']:.3g} s"
            lines.append(f"{start}: {state(one, own).passivity} {_felt(one, own)}.")
    elif summary["samples"]:
        now = state(summary, run)
        lines += [
            now.passivity,
            now.rest,
            _stiffness(summary, run),
            "" if failed else _reason(summary, now.kind),
        ]
    elif not failed:
        lines = ["No force: it never engaged."]
    failures = "; ".join(_failures(summary, run))
    return [line for line in (*lines, failures and f"Faults: {failures}.") if line]


def _failed(failed: str, hand: str) -> str:
    """Return why a run failed; of another hand only which: its own lines say the rest."""
    other, slash, _ = failed.split(" ", 1)[0].partition("/")
    if slash and other != hand:
        return f"Ended because {other} failed."
    return f"Failed: {_cause(failed)}."


def _cause(failed: str) -> str:
    """Return on one line why a run failed: of a process that ended, its own last line."""
    first, _, tail = failed.partition("; its last lines:")
    own = tail.rpartition("forcebound: ")[2] if "forcebound: " in tail else ""
    return " ".join(f"{first}: {own}".split()).removesuffix(":")


def _stiffness(s: Summary, run: Launched) -> str:
    stiffness, words = s["stiffness_n_per_m"], _felt(s, run)
    if run.environment.get("kind") == "coupling":
        return ""  # a line for both hands says it
    if stiffness is None or s["displayed_stiffness_share"] is None:
        return f"{words}."
    if abs(stiffness["felt"] / stiffness["asked"] - 1.0) <= 1.0 - ALL:
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
    unit = run.units.get("environment.stiffness", run.shown(N_MM).unit)
    if of is not None:
        felt, asked = (in_unit(of[key], unit, 3) for key in ("felt", "asked"))
        what = BETWEEN if run.environment.get("kind") in BODIES else "Stiffness felt"
        if s["displayed_stiffness_share"] is None:
            return f"{what}: not known, since the hand moves to and fro"
        return f"{what}: {felt} of {asked}"
    if mean is not None:
        return f"Stiffness felt: {in_unit(mean, unit, 3)}; the environment has no constant one"
    return f"Stiffness felt: not known, {s['undefined']['displayed_stiffness_n_per_m']}"


def _reason(s: Summary, kind: Passivity) -> str:
    causes = s["little_force"]
    if kind is Passivity.NOT_PASSIVE:  # stronger motors would only give the hand more energy
        causes = [cause for cause in causes if cause["cause"] != "saturation"]
    if not causes:
        return ""
    cause, more = causes[0], len(causes) - 1
    others = f" ({more} more: --all)" if more else ""
    return f"Why not more: {cause['advice']}.{others}"


def _failures(s: Summary, run: Launched) -> Iterator[str]:
    below = ("ticks_missed", *(["readings_refused"] if s["refused_readings"] else []))
    for kind, count in s["faults"].items():
        if kind not in below:
            yield f"{kind.replace('_', ' ')} {times(count)}"
    rejected = ", ".join(f"{count} {why}" for why, count in s["rejected_packets"].items() if count)
    if rejected:
        yield f"packets rejected: {rejected}"
    missed = s["deadline_misses"] or 0
    share = missed / (missed + s["samples"] or 1)
    if share > MISSED_SHARE:
        yield f"{counted(missed, 'tick')} missed ({share:.1%}){_of_the_device(s, run)}"
    if s["refused_readings"] and all(map(is_uncovered, s["broken_promises"])):
        yield f"{counted(s['refused_readings'], 'reading')} refused"
    lost_packets = lost(s)
    if lost_packets != "0":
        yield f"lost or damaged, as the links are set: {lost_packets}"


def _of_the_device(s: Summary, run: Launched) -> str:
    """Why the device itself misses ticks; empty: it does not."""
    busy, rate = s["reads_and_writes_s"] or 0.0, run.device.rate or 0.0
    if busy * rate <= 1.0:
        of_device = s["device_misses"] or 0
        return f", {of_device} of them while the device read or wrote" if of_device else ""
    taken, period = in_unit(busy, "ms", 2), in_unit(1.0 / rate, "ms", 2)
    return f", since its reads and writes take {taken} of a period of {period}"
