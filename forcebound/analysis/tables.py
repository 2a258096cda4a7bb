"""Tables of a summary in everyday units (N/mm, mm, mJ, ms)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

UNDEFINED = "–"
NOT_FELT = -20  # dB; see forcebound.analysis.perception.vibration_threshold


def summary_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return a summary as rows of label and value.

    A value that is None shows as a dash. The labels do not depend on the run, except for those of
    the bounder and of several axes, so the rows of several runs go side by side into one table.
    """

    def show(key: str, unit: str, factor: float = 1.0, digits: int = 2) -> str:
        return _quantity(summary[key], unit, factor, digits)

    delay, age = (
        UNDEFINED if values["p50"] is None else f"{_percentiles(values, 2)} ms"
        for values in (summary["loop_delay_ms"], summary["reply_age_ms"])
    )
    counted = summary["rejected_packets"]
    rejected = [f"{count} {why}" for why, count in (counted or {}).items() if count]
    faults = [f"{count} {kind}" for kind, count in summary.get("faults", {}).items()]
    links = summary.get("links", {})
    fates = [(t, Counter[str](counts)) for t, counts in (links or {}).items()]
    lost = [
        f"{counts['lost'] + counts['corrupted']} of {counts['sent']} {topic}"
        for topic, counts in fates
        if counts["lost"] + counts["corrupted"]
    ]
    return [
        ("law", summary["law"] or UNDEFINED),
        ("duration", show("duration_s", "s")),
        ("samples", show("samples", "", digits=0)),
        ("displayed stiffness", show("displayed_stiffness_n_per_m", "N/mm", 1e-3)),
        ("rate-hardness", show("rate_hardness_n_per_m", "N/mm", 1e-3)),
        ("extended rate-hardness", show("extended_rate_hardness_n_per_m", "N/mm", 1e-3)),
        ("transparency bandwidth", show("transparency_bandwidth_hz", "Hz", digits=0)),
        ("peak force", show("peak_force_n", "N")),
        ("peak penetration", show("peak_penetration_m", "mm", 1e3)),
        *_rows_of_axes(summary),
        ("force error, RMS", show("force_error_rms_n", "N")),
        ("error to the ideal wall, RMS", show("wall_error_rms_n", "N")),
        ("vibration above threshold", _vibration(summary)),
        ("settling time", show("settling_time_s", "ms", 1e3, 0)),
        ("overshoot", show("overshoot_share", "%", 1e2, 0)),
        ("limit-cycle amplitude", show("limit_cycle_amplitude_m", "mm", 1e3)),
        ("contact bounces", show("contact_bounces", "", digits=0)),
        ("speed at the end", show("final_speed_m_per_s", "mm/s", 1e3)),
        ("penetration at rest", show("penetration_at_rest_m", "mm", 1e3)),
        ("minimum energy (ground truth)", show("true_energy_min_j", "mJ", 1e3)),
        ("largest fall of energy", show("largest_energy_fall_j", "mJ", 1e3)),
        ("time to regain it", show("energy_regain_time_s", "ms", 1e3, 0)),
        ("minimum energy since contact", show("energy_since_contact_min_j", "mJ", 1e3)),
        ("minimum energy (observed)", show("observed_energy_min_j", "mJ", 1e3)),
        ("minimum power (observed)", show("observed_power_min_w", "W")),
        ("time in deficit (observed)", show("observed_deficit_share", "%", 1e2, 1)),
        ("minimum energy (estimated)", show("estimated_energy_min_j", "mJ", 1e3)),
        ("time in deficit (ledger)", show("ledger_deficit_share", "%", 1e2, 1)),
        ("bounder active", show("bounder_active_share", "%", 1e2, 1)),
        ("ticks answered", show("answered_share", "%", 1e2, 1)),
        ("answered in the same tick", show("same_tick_share", "%", 1e2, 1)),
        ("loop delay p50/p99/max", delay),
        ("age of the reply p50/p99/max", age),
        ("deadline misses", show("deadline_misses", "", digits=0)),
        ("hold-limit overruns", show("hold_limit_overruns", "", digits=0)),
        *_bounder_rows(summary),
        ("rejected packets", UNDEFINED if counted is None else ", ".join(rejected) or "0"),
        ("lost or damaged", UNDEFINED if links is None else ", ".join(lost) or "0"),
        ("faults", ", ".join(faults) or "0"),
    ]


def _rows_of_axes(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Rows about what lies across the normal, only those that the run has."""
    rows = {
        "peak tangential force": ("peak_tangential_force_n", "N", 1.0, 2),
        "tangential over normal force": ("tangential_share", "%", 1e2, 0),
        "peak proxy distance": ("peak_proxy_distance_m", "mm", 1e3, 2),
    }
    return [
        (label, _quantity(summary[key], unit, factor, digits))
        for label, (key, unit, factor, digits) in rows.items()
        if summary.get(key) is not None
    ]


def difference_text(difference: Mapping[str, Any]) -> str:
    """Return a difference of two runs in words; see :func:`.perception.differences`."""
    name = difference["figure"].rpartition("_n")[0].replace("_", " ")
    least = f"{difference['weber_fraction']:.0%}, {difference['source']}"
    felt = "a hand feels it" if difference["is_perceptible"] else "a hand does not feel it"
    return f"{name} {difference['difference']:+.0%}; {felt} (from {least})"


def _bounder_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Rows about the bounder, only those that say something about this run."""
    limits = summary.get("hold_limit_ms", {}).get("mean")
    refused, used = summary.get("refused_readings"), summary.get("largest_allowance_j")
    cap = summary.get("energy_cap_j")
    sources = summary.get("number_sources", {}).items()
    causes = [cause["cause"].replace("_", " ") for cause in summary.get("little_force", ())]
    rows = []
    if limits is not None:
        longest = summary["hold_limit_ms"]["longest"]
        rows.append(("hold limit mean/longest", f"{limits:.2f}/{longest:.2f} ms"))
    if refused:
        rows.append(("refused readings", str(refused)))
    if late := summary.get("late_writes"):
        delay = f"up to {summary['longest_write_delay_ms']:.3g} ms after the reading"
        rows.append(("writes later than stated", f"{late}, {delay}: device.write_delay"))
    if used:
        repaid = "repaid" if summary["allowance_repaid"] else "not repaid"
        rows.append(("largest allowance used", f"{_quantity(used, 'mJ', 1e3, 3)}, {repaid}"))
    if cap is not None or limits is not None:
        words = "of the saturation" if cap is None else _quantity(cap, "mJ", 1e3, 2)
        rows.append(("energy cap", words))
    if sources:
        words = ", ".join(f"{count} {source}" for source, count in sources)
        rows.append(("numbers of the device", words))
    if causes:
        rows.append(("little force because of", ", ".join(causes)))
    return rows


def phase_rows(phases: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Return a table of phases, its head first; delays are p50/p99/max."""
    head = (
        "phase",
        "delay, ms",
        "age of reply, ms",
        "answered",
        "force on",
        "peak force",
        "minimum energy",
    )
    return [head, *map(_phase_row, phases)]


def _phase_row(phase: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        phase["name"],
        _percentiles(phase["loop_delay_ms"], 1),
        _percentiles(phase["reply_age_ms"], 1),
        _quantity(phase["answered_share"], "%", 1e2, 1),
        _quantity(phase["force_share"], "%", 1e2, 1),
        _quantity(phase["peak_force_n"], "N", 1.0, 2),
        _quantity(phase["true_energy_min_j"], "mJ", 1e3, 2),
    )


def _vibration(summary: Mapping[str, Any]) -> str:
    strongest = summary["vibration_above_threshold_db"]
    if strongest is None or strongest > NOT_FELT:
        at = summary["vibration_frequency_hz"]
        return _quantity(strongest, "dB", 1.0, 0) + ("" if at is None else f" at {at:.0f} Hz")
    return f"under {NOT_FELT} dB"


def _percentiles(delays: Mapping[str, float | None], digits: int) -> str:
    return "/".join(_quantity(delays[key], "", 1.0, digits) for key in ("p50", "p99", "max"))


def _quantity(value: float | None, unit: str, factor: float, digits: int) -> str:
    if value is None:
        return UNDEFINED
    # Adding zero turns a rounded -0.0 into 0.0: "-0.00 mJ" would read as a leak.
    return f"{round(value * factor, digits) + 0.0:.{digits}f} {unit}".rstrip()
