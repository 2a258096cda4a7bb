"""Tables of a summary in everyday units (N/mm, mm, mJ, ms)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

UNDEFINED = "–"


def summary_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return a summary as rows of label and value.

    A value that is None shows as a dash. The labels do not depend on the run, so the rows of
    several runs go side by side into one table.
    """

    def show(key: str, unit: str, factor: float = 1.0, digits: int = 2) -> str:
        return _quantity(summary[key], unit, factor, digits)

    delays = summary["loop_delay_ms"]
    delay = UNDEFINED if delays["p50"] is None else f"{_percentiles(delays, 2)} ms"
    rejected = [f"{count} {why}" for why, count in summary["rejected_packets"].items() if count]
    faults = [f"{count} {kind}" for kind, count in summary.get("faults", {}).items()]
    fates = [(t, Counter[str](counts)) for t, counts in summary.get("links", {}).items()]
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
        ("peak force", show("peak_force_n", "N")),
        ("peak penetration", show("peak_penetration_m", "mm", 1e3)),
        ("contact bounces", show("contact_bounces", "", digits=0)),
        ("speed at the end", show("final_speed_m_per_s", "mm/s", 1e3)),
        ("penetration at rest", show("penetration_at_rest_m", "mm", 1e3)),
        ("minimum energy (ground truth)", show("true_energy_min_j", "mJ", 1e3)),
        ("minimum energy (estimated)", show("estimated_energy_min_j", "mJ", 1e3)),
        ("bounder active", show("bounder_active_share", "%", 1e2, 1)),
        ("ticks answered", show("answered_share", "%", 1e2, 1)),
        ("answered in the same tick", show("same_tick_share", "%", 1e2, 1)),
        ("loop delay p50/p99/max", delay),
        ("deadline misses", show("deadline_misses", "", digits=0)),
        ("hold-limit overruns", show("hold_limit_overruns", "", digits=0)),
        ("rejected packets", ", ".join(rejected) or "0"),
        ("lost or damaged", ", ".join(lost) or "0"),
        ("faults", ", ".join(faults) or "0"),
    ]


def phase_rows(phases: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Return a table of phases, its head first; delays are p50/p99/max."""
    head = ("phase", "delay, ms", "answered", "force on", "peak force", "minimum energy")
    return [head, *map(_phase_row, phases)]


def _phase_row(phase: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        phase["name"],
        _percentiles(phase["loop_delay_ms"], 1),
        _quantity(phase["answered_share"], "%", 1e2, 1),
        _quantity(phase["force_share"], "%", 1e2, 1),
        _quantity(phase["peak_force_n"], "N", 1.0, 2),
        _quantity(phase["true_energy_min_j"], "mJ", 1e3, 2),
    )


def _percentiles(delays: Mapping[str, float | None], digits: int) -> str:
    return "/".join(_quantity(delays[key], "", 1.0, digits) for key in ("p50", "p99", "max"))


def _quantity(value: float | None, unit: str, factor: float, digits: int) -> str:
    if value is None:
        return UNDEFINED
    # Adding zero turns a rounded -0.0 into 0.0: "-0.00 mJ" would read as a leak.
    return f"{round(value * factor, digits) + 0.0:.{digits}f} {unit}".rstrip()
