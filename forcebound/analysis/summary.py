"""Summary of a run: its key figures as one JSON document.

For stiffness, force and delay only samples with an engaged force count; *since engagement* are all
samples from the first of these on. A figure that the run or the launch file does not define is
``None``, never NaN, so that a summary is always valid JSON. ``docs/results.md`` lists the keys.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forcebound.analysis.bounder import UNBOUNDED
from forcebound.analysis.contact import REST_SPEED, at_end, final_speed
from forcebound.analysis.measures import (
    Samples,
    contact_measures,
    energy_measures,
    force_measures,
    impedance_measures,
    undefined,
)
from forcebound.analysis.surface import Floats, Mask
from forcebound.messages.packets import Event
from forcebound.nodes.events import LINK_COUNTED, PHASE_BEGINS
from forcebound.nodes.hold_limit import FLOOR
from forcebound.telemetry import TelemetryColumns

MOST_PHASES = 200  # of a run, as in launch files


def law(config: Mapping[str, Any]) -> str | None:
    """Return the name of the bounding law in a resolved launch file, if it has one."""
    name = (config.get("device") or {}).get("law")
    return None if name is None else str(name)


def summarize(
    columns: TelemetryColumns, config: Mapping[str, Any], events: Sequence[Event] = ()
) -> dict[str, Any]:
    """Return the key figures of a run, ready for JSON.

    Args:
        columns: Telemetry of the run.
        config: The launch file as resolved for the run, in SI numbers; of its keys
            ``device.law``, ``.rate``, ``.hold_limit``, ``.mass`` and ``environment.position``,
            ``.axis``, ``.stiffness`` are read, and figures that need a missing one are None.
        events: Of the run; they say when its surface was moved or changed.

    Returns:
        By key, SI units as the key says, what ``docs/results.md`` lists:

        * ``law``; ``samples``, ``duration_s``: since the force engaged for the first time
        * of :func:`.measures.contact_measures`, :func:`.measures.force_measures`,
          :func:`.measures.impedance_measures` and :func:`.measures.energy_measures`
        * ``peak_force_n``: largest applied force
        * ``true_energy_min_j``, ``estimated_energy_min_j``: minimum since engagement, of the
          simulated device's ground truth and of the law's own ledger
        * ``bounder_active_share``: share of samples in contact in which the applied force is
          smaller than the commanded force after saturation; in an environment without a surface,
          of the samples with a commanded force
        * ``answered_share``: :func:`answered_share`
        * ``same_tick_share``: share of samples answered in the same tick
        * ``loop_delay_ms``, ``reply_age_ms``: ``p50``, ``p99``, ``max``
        * ``deadline_misses``: ticks skipped; ``hold_limit_overruns``: :func:`hold_limit_overruns`
        * ``rejected_packets`` by reason: at the end of the run
        * ``final_speed_m_per_s``, ``at_rest``, ``penetration_at_rest_m``: over the last 0.5 s; the
          last is the mean depth there, None if the hand is not known to be at rest
        * ``undefined``: for figures that are None, by key, the reason

    Raises:
        ConfigError: If the launch file describes a surface that does not fit the run.
    """
    engaged = columns.engagement > 0.0
    since_engagement = columns.time >= 0.0 if engaged.any() else engaged
    run = Samples.of(columns, config, events)
    figures = {
        "law": law(config),
        **_length(columns.time[since_engagement]),
        **contact_measures(run),
        **_rest(run),
        **_forces(run),
        **force_measures(run),
        **impedance_measures(run),
        "true_energy_min_j": _or_none(np.min, columns.true_energy[since_engagement]),
        **energy_measures(run),
        "estimated_energy_min_j": _or_none(np.min, columns.estimated_energy[since_engagement]),
        "answered_share": answered_share(columns) if engaged.any() else None,
        "same_tick_share": _or_none(np.mean, (columns.device_seq == columns.seq)[engaged]),
        "loop_delay_ms": _delays(columns.loop_delay[engaged]),
        "reply_age_ms": _delays(columns.reply_age[engaged]),
        "deadline_misses": _misses(columns, since_engagement),
        "hold_limit_overruns": hold_limit_overruns(columns, config),
        "rejected_packets": dict(sorted(columns.rejected.items())),
    }
    return {**figures, "undefined": undefined(figures, run)}


def _length(time: Floats) -> dict[str, Any]:
    return {"samples": time.size, "duration_s": float(np.ptp(time)) if time.size else None}


def _forces(run: Samples) -> dict[str, Any]:
    wanted, applied = (
        np.linalg.norm(force, axis=1) for force in (run.saturated, run.columns.applied_force)
    )
    bounded = (applied < UNBOUNDED * wanted)[run.contact]
    return {
        "peak_force_n": _or_none(np.max, applied),
        "bounder_active_share": _or_none(np.mean, bounded),
    }


def _rest(run: Samples) -> dict[str, Any]:
    time = run.columns.time
    speed = final_speed(time, run.columns.true_position)
    at_rest = None if speed is None else speed < REST_SPEED
    resting = run.depth[at_end(time) & run.contact]
    return {
        "final_speed_m_per_s": speed,
        "at_rest": at_rest,
        "penetration_at_rest_m": _or_none(np.mean, resting) if at_rest else None,
    }


def _or_none(statistic: Callable[[Any], Any], values: NDArray[Any]) -> float | None:
    known = values[np.isfinite(values)]
    return float(statistic(known)) if known.size else None


def _delays(delays: Floats) -> dict[str, float | None]:
    milliseconds = delays * 1e3
    return {
        "p50": _or_none(lambda known: np.percentile(known, 50), milliseconds),
        "p99": _or_none(lambda known: np.percentile(known, 99), milliseconds),
        "max": _or_none(np.max, milliseconds),
    }


def _misses(columns: TelemetryColumns, since_engagement: Mask) -> int | None:
    """Return the ticks skipped since engagement; before, while processes start, no force acts."""
    counts = columns.deadline_misses
    if not counts.size:
        return None
    before = counts[~since_engagement]
    return int(counts[-1] - (before[-1] if before.size else 0))


def hold_limit_overruns(columns: TelemetryColumns, config: Mapping[str, Any]) -> int | None:
    """Return the number of hold-limit overruns since the force engaged.

    A write later than the hold limit after the one before: the motor's watchdog has dropped the
    force to zero, and the certified laws pay for what they do not know of that time. Ticks skipped
    in a row make one overrun; a tick that was only late may make one, too, and is no deadline miss.

    Args:
        columns: Telemetry of the run.
        config: The launch file as resolved for the run; reads ``device.rate``, ``.hold_limit``.

    Returns:
        Their number; None if the launch file does not state the limit, or the force never engaged,
        or the limit was learned and not every hold was shorter than the shortest one.
    """
    device = config.get("device") or {}
    if "rate" not in device or "hold_limit" not in device or not (columns.engagement > 0.0).any():
        return None
    is_learned = device["hold_limit"] == "auto"
    limit_ns = round((FLOOR if is_learned else device["hold_limit"]) * 1e9 / device["rate"])
    longer = int(np.count_nonzero(np.diff(columns.time_ns[columns.time >= 0.0]) > limit_ns))
    return None if is_learned and longer else longer


def answered_share(columns: TelemetryColumns) -> float | None:
    """Return the share of ticks whose state was answered by a force, sooner or later, 0 to 1.

    The others were lost, or overtaken by a newer answer. The last ticks of a run are still waiting
    for their answer, so a run with a long delay has a little less than 1.
    """
    since_engagement = columns.elapsed > 0.0
    ticks = columns.seq[since_engagement]
    if not ticks.size:
        return None
    answered = np.unique(columns.device_seq[since_engagement])
    return float(np.count_nonzero(answered >= ticks[0])) / ticks.size


def summarize_phases(
    columns: TelemetryColumns, events: Sequence[Event], config: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Return the key figures of each phase of a scripted run, ready for JSON.

    Args:
        columns: Telemetry of the run.
        events: Events of the run; they hold the start of each phase.
        config: The launch file as resolved for the run.

    Returns:
        By phase: ``name``, ``start_s`` (since the force engaged), ``duration_s`` (measured),
        ``answered_share``, ``force_share`` (of samples with an engaged force), and, as in
        :func:`summarize`, ``loop_delay_ms``, ``reply_age_ms``, ``peak_force_n``,
        ``true_energy_min_j``, ``deadline_misses``.
    """
    begins = [event for event in events if event.event == PHASE_BEGINS][:MOST_PHASES]
    phases = []
    for event, following in zip_longest(begins, begins[1:]):
        end_ns = 2**63 - 1 if following is None else following.time_ns
        inside = (columns.time_ns >= event.time_ns) & (columns.time_ns < end_ns)
        if inside.any():
            name = event.data.get("name", "")
            phases.append({"name": name} | _phase(columns.slice(inside), config))
    return phases


def _phase(part: TelemetryColumns, config: Mapping[str, Any]) -> dict[str, Any]:
    figures = summarize(part, config)
    return {
        "start_s": float(part.elapsed[0]),
        "duration_s": float(part.elapsed[-1] - part.elapsed[0]),
        "answered_share": answered_share(part),
        "force_share": float(np.mean(part.engagement > 0.0)),
        "loop_delay_ms": figures["loop_delay_ms"],
        "reply_age_ms": figures["reply_age_ms"],
        "peak_force_n": figures["peak_force_n"],
        "true_energy_min_j": _or_none(np.min, part.true_energy),
        "deadline_misses": int(part.deadline_misses[-1] - part.deadline_misses[0]),
    }


def summarize_events(events: Sequence[Event]) -> dict[str, Any]:
    """Return what a run's events add to its summary, ready for JSON.

    Returns:
        * ``faults``: number of each kind of fault; an event may stand for several
        * ``links``: by topic of an impaired link, the number of packets by fate
    """
    faults: Counter[str] = Counter()
    for event in events:
        if event.is_fault:
            faults[event.event] += 1 + _count(event.data.get("suppressed", "0"))
    links: dict[str, dict[str, int]] = {}
    for event in events:
        if event.event == LINK_COUNTED:  # a restarted process counts from zero: add up
            counts = links.setdefault(event.data.get("link", ""), {})
            for fate, count in event.data.items():
                if fate != "link":
                    counts[fate] = counts.get(fate, 0) + _count(count)
    return {"faults": dict(sorted(faults.items())), "links": links}


def _count(text: str) -> int:
    """The count in an event's data; 0 for what is none, in a recording from elsewhere."""
    return int(text) if text.isdecimal() and len(text) < 19 else 0
