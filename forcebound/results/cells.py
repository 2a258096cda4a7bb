"""How the figures of a summary are shown in a table: in everyday units, or in words."""

from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from forcebound.axes import shown_on
from forcebound.units import DB, MJ, UNDEFINED, Everyday, N

#: Figures of a run, or of a part of it, by their keys, ready for JSON; docs/results.md lists them.
Summary: TypeAlias = dict[str, Any]
Cell: TypeAlias = Callable[[Summary], str]  # empty: no row

NOT_FELT = -20  # dB; see forcebound.results.perception.vibration_threshold


def percentiles(delays: Mapping[str, float | None], digits: int) -> str:
    """Return p50, p99 and maximum of a delay, without unit."""
    return "/".join(Everyday("", "", digits).show(delays[key]) for key in ("p50", "p99", "max"))


def _delays(key: str) -> Cell:
    return lambda s: UNDEFINED if s[key]["p50"] is None else f"{percentiles(s[key], 2)} ms"


loop_delay, reply_age = map(_delays, ("loop_delay_ms", "reply_age_ms"))


def counts(key: str, none: str = "0") -> Cell:
    """Return the cell of counts by kind; ``none`` without any, a dash if they are None."""

    def cell(s: Summary) -> str:
        if s[key] is None:
            return UNDEFINED
        return ", ".join(f"{count} {kind}" for kind, count in s[key].items() if count) or none

    return cell


def peaks(s: Summary) -> str:
    """Return the largest force of each named axis, in its unit."""
    by_axis = (s["peak_force_by_axis"] or {}).items()
    return ", ".join(f"{name} {shown_on(s['axes'][name], N).show(one)}" for name, one in by_axis)


def vibration(s: Summary) -> str:
    """Return the strongest band that is felt."""
    strongest, at = s["vibration_above_threshold_db"], s["vibration_frequency_hz"]
    if strongest is None or strongest > NOT_FELT:
        return DB.show(strongest) + ("" if at is None else f" at {at:.0f} Hz")
    return f"under {NOT_FELT} dB"


def hold_limit(s: Summary) -> str:
    """Return mean and longest hold limit."""
    limit = s["hold_limit_ms"]
    return "" if limit["mean"] is None else f"{limit['mean']:.2f}/{limit['longest']:.2f} ms"


def refused(s: Summary) -> str:
    """Return how many readings were refused, if any."""
    return str(s["refused_readings"] or "")


def late_writes(s: Summary) -> str:
    """Return how many writes were late, and by how much."""
    if not s["late_writes"]:
        return ""
    longest = f"up to {s['longest_write_delay_ms']:.3g} ms after the reading"
    return f"{s['late_writes']}, {longest}: device.write_delay"


def allowance(s: Summary) -> str:
    """Return the largest allowance that was used, and whether it is repaid."""
    if not s["largest_allowance_j"]:
        return ""
    repaid = "repaid" if s["allowance_repaid"] else "not repaid"
    return f"{MJ._replace(digits=3).show(s['largest_allowance_j'])}, {repaid}"


def fast_holds(s: Summary) -> str:
    """Return how often the hand was faster than stated, and what it can have got."""
    if not s["fast_holds"]:
        return ""
    most = MJ._replace(digits=3).show(s["speed_leak_j"])
    return f"{s['fast_holds']} holds, at most {most}: device.hand_speed"


def energy_cap(s: Summary) -> str:
    """Return the energy cap of a law that keeps a ledger."""
    if s["energy_cap_j"] is not None:
        return MJ.show(s["energy_cap_j"])
    return "" if s["hold_limit_ms"]["mean"] is None else "of the saturation"


def lost(s: Summary) -> str:
    """Return the lost or damaged packets by topic; a dash if they are None."""
    if s["links"] is None:
        return UNDEFINED
    fates = {topic: Counter[str](counts) for topic, counts in s["links"].items()}
    bad = {topic: counts["lost"] + counts["corrupted"] for topic, counts in fates.items()}
    return ", ".join(f"{n} of {fates[t]['sent']} {t}" for t, n in bad.items() if n) or "0"


def saved(s: Summary) -> str:
    """Return the packets that deadbands saved, by topic."""
    of = {topic: n + s["links"][topic]["sent"] for topic, n in s["packets_saved"].items()}
    words = (f"{n} of {of[t]} {t} ({n / of[t]:.0%})" for t, n in s["packets_saved"].items())
    return ", ".join(words) or "0"


def little_force(s: Summary) -> str:
    """Return the causes of little force."""
    return ", ".join(cause["cause"].replace("_", " ") for cause in s["little_force"])
