"""Counts of a run: ticks that were answered, skipped or late; faults; packets of links."""

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from forcebound.haptics.laws.hold_limit import FLOOR
from forcebound.messages.events import LINK_COUNTED
from forcebound.recordings.telemetry import TelemetryColumns

if TYPE_CHECKING:
    from forcebound.results.samples import Samples


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


def answered(run: "Samples") -> float | None:
    """Return the same of a run whose force engaged."""
    return answered_share(run.run) if run.time.size else None


def same_tick_share(run: "Samples") -> float | None:
    """Return the share of samples with a force that answers the state of their own tick."""
    same = run.columns.device_seq == run.columns.seq
    return float(np.mean(same)) if same.size else None


def deadline_misses(run: "Samples") -> int | None:
    """Return the ticks skipped since engagement; before, while processes start, no force acts."""
    counts = run.run.deadline_misses
    if not counts.size:
        return None
    before = counts[~run.since]
    return int(counts[-1] - (before[-1] if before.size else 0))


def hold_limit_overruns(run: "Samples") -> int | None:
    """Return how often a hold was longer than the hold limit, as reported, else as recorded.

    A recording shows none of a limit that was learned, unless every hold was shorter than the
    shortest limit.
    """
    if run.report is not None:
        return run.report.overruns
    rate, limit = run.device.rate, run.device.hold_limit
    if rate is None or limit is None or not run.time.size:
        return None
    is_learned = limit == "auto"
    limit_ns = round((FLOOR if limit == "auto" else limit) * 1e9 / rate)
    longer = int(np.count_nonzero(np.diff(run.run.time_ns[run.run.time >= 0.0]) > limit_ns))
    return None if is_learned and longer else longer


def rejected(run: "Samples") -> dict[str, int]:
    """Return the packets that the device rejected, by reason."""
    return dict(sorted(run.run.rejected.items()))


def faults(run: "Samples") -> dict[str, int]:
    """Return the number of faults by kind; an event may stand for several."""
    found: Counter[str] = Counter()
    for event in run.events:
        if event.is_fault:
            found[event.event] += 1 + _count(event.data.get("suppressed", "0"))
    return dict(sorted(found.items()))


def links(run: "Samples") -> dict[str, dict[str, int]]:
    """Return the packets by topic and fate; a restarted process counts from zero."""
    found: dict[str, Counter[str]] = {}
    for event in run.events:
        if event.event == LINK_COUNTED:
            counts = {fate: _count(text) for fate, text in event.data.items() if fate != "link"}
            found.setdefault(event.data.get("link", ""), Counter()).update(counts)
    return {topic: dict(counts) for topic, counts in found.items()}


def saved(run: "Samples") -> dict[str, int]:
    """Return the packets that deadbands saved, by topic; those of links with a deadband alone."""
    counts = {topic: fates.get("saved", 0) for topic, fates in links(run).items()}
    return {topic: count for topic, count in counts.items() if count}


def _count(text: str) -> int:
    """The count in an event's data; 0 for what is none, in a recording from elsewhere."""
    return int(text) if text.isdecimal() else 0


def hold_limits(run: "Samples") -> dict[str, float | None]:
    """Return the mean and the longest hold limit, in ms, as the bounder reported them."""
    if run.report is None:
        return {"mean": None, "longest": None}
    return {"mean": run.report.hold_limit * 1e3, "longest": run.report.longest_hold_limit * 1e3}


def longest_write_delay(run: "Samples") -> float | None:
    """Return the longest time from a reading to its force, in ms."""
    return None if run.report is None else run.report.longest_write_delay * 1e3


def reads_and_writes(columns: TelemetryColumns) -> float | None:
    """Return what the device's own reads and writes take of a tick, in s; None: not recorded.

    Half of the ticks take more. The state is read, too, as long before as reading and write take.
    Where the bounder has the state's reading, what that took is not known, and not in it.
    """
    if not columns.read_ns.size or (columns.read_ns < 0).any():
        return None
    took = float(np.median(columns.write_ns - columns.read_ns))
    writing = float(np.median(columns.write_ns - columns.time_ns))
    return 1e-9 * (writing if writing < 0.5 * took else 2.0 * took)


def device_time(run: "Samples") -> float | None:
    """Return the same as the device's process has measured it, a mean; else as it is recorded."""
    measured = run.report.device_time if run.report is not None else 0.0
    return measured or reads_and_writes(run.columns)
