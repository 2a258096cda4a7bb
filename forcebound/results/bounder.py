"""The bounder in a run: what it met, and why it gave little force.

A certified law gives at most ``f_c + 2 sqrt(b G / T_max)`` for a ledger of G joules. Each cause is
judged by its share in that: what lengthens T_max, what empties the ledger, what fills it slowly.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from forcebound.haptics.laws import LAWS
from forcebound.messages.control import BounderReport
from forcebound.messages.events import BOUNDER_REPORTED
from forcebound.messages.packets import Event
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.surface import Floats, Mask

LIMITED_SHARE = 0.5  # of the ticks with a force in which the law makes it smaller
LITTLE_SHARE = 0.25  # of the saturated force; less is little, also where all is well
UNBOUNDED = 1.0 - 1e-9  # of the saturated force; below, it was made smaller, not merely rounded
MISSED_SHARE = 0.01  # of all ticks
LONG_HOLD = 1.3  # periods
FREQUENT_OVERRUNS = 0.2  # 1/s; a silent watchdog takes a third of the ledger each time
FREQUENT_REPORTED = 5.0  # 1/s; a reporting one takes a hundredth
LATE_ANSWER = 1.0  # periods
DEAR_SHARE = 0.25  # of the energy that the commanded force needs
FULL_SHARE = 0.95  # of the energy cap
PUNCTUAL = "a quieter machine, realtime.policy: fifo"
COSTLY = ("presliding", "gain_error", "lag", "write_delay", "weight_error")  # of a device


class Cause(NamedTuple):
    """A likely cause of something, and what to do about it."""

    code: str
    advice: str
    command: str = ""  # of a shell, which helps
    data: Mapping[str, float | str] = {}  # SI units

    @property
    def remedy(self) -> str:
        """What to do, with the command."""
        return f"{self.advice}: {self.command}" if self.command else self.advice


def bounder_report(events: Sequence[Event]) -> BounderReport | None:
    """Return the last report of the bounder among the events; None: there is none."""
    for event in reversed(events):
        if event.event == BOUNDER_REPORTED:
            return BounderReport.from_texts(event.data)
    return None


def saturated(columns: TelemetryColumns, device: Mapping[str, Any]) -> Floats:
    """Return the commanded force after saturation, which the law gets, in N, shape (n, axes).

    Args:
        columns: Telemetry of a run.
        device: Section ``device`` of its launch file; without ``saturation`` nothing is saturated.

    An arm saturates its torques. They have the direction of those of the commanded force, so the
    force at the tip is saturated in the ratio in which torques and saturation are.
    """
    commanded = columns.commanded_force
    if "saturation" not in device:
        return commanded
    size = np.linalg.norm(commanded, axis=1)
    largest = device["saturation"] * columns.engagement
    torque = np.linalg.norm(columns.torques, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        if np.isfinite(torque).any():
            given = np.linalg.norm(columns.applied_force, axis=1)
            largest = np.where(torque > 0.0, largest / torque * given, np.inf)
        share = np.where(size > largest, largest / size, 1.0)
    return np.asarray(share[:, np.newaxis] * commanded)


class Limited:
    """Where a law made the force of a run smaller.

    Attributes:
        wanted: Size of the commanded force after saturation, in N, shape ``(n,)``.
        applied: Size of the applied force, in N, likewise.
        pushing: Which ticks have a force.
        limited: In which of them the law reduced it.
    """

    def __init__(self, columns: TelemetryColumns, device: Mapping[str, Any]) -> None:
        """Compare the forces of a run with section ``device`` of its launch file."""
        self.wanted: Floats = np.linalg.norm(saturated(columns, device), axis=1)
        self.applied: Floats = np.linalg.norm(columns.applied_force, axis=1)
        self.pushing: Mask = self.wanted > 0.0
        self.limited: Mask = (self.applied < UNBOUNDED * self.wanted) & self.pushing

    def __bool__(self) -> bool:
        """Whether the law makes the force smaller in most ticks that have one."""
        return bool(self.limited.sum() > LIMITED_SHARE * self.pushing.sum())


def causes_of_little_force(
    columns: TelemetryColumns,
    device: Mapping[str, Any],
    report: BounderReport | None,
    little: float = LITTLE_SHARE,
) -> list[Cause]:
    """Return why the law gives little force, the avoidable causes first; empty if it gives enough.

    Args:
        columns: Telemetry, since the force engaged.
        device: Section ``device`` of the resolved launch file, in SI numbers.
        report: What the device node reports of its bounder; None: not known.
        little: Share of the saturated force that is little where nothing can be avoided.
    """
    law, force = device.get("law", "none"), Limited(columns, device)
    if law == "none" or not force:
        return []
    causes = [*_of_the_loop(columns, device)]
    if LAWS.is_shipped(law) and LAWS[law].is_certified:
        causes += [*_of_holds(columns, device, report), *_of_the_ledger(columns, device, force)]
    else:
        why = f"law {law} limits it and does not say why; law certified would name the causes"
        causes.append(Cause("law_not_certified", why, data={"law": law}))
    wanted, applied = (one[force.limited].mean() for one in (force.wanted, force.applied))
    if not causes and applied < little * wanted:
        advice = (
            "it is what the device's dissipation allows at this rate: more damping, a higher "
            "device.rate, or a softer environment"
        )
        if columns.hand and not device.get("energy_partner"):
            advice += "; or, if another hand does the work, energy_partner"
        causes.append(Cause("dissipation", advice))
    return causes


def _of_the_loop(columns: TelemetryColumns, device: Mapping[str, Any]) -> Iterator[Cause]:
    missed = int(columns.deadline_misses[-1] - columns.deadline_misses[0])
    share = missed / (missed + columns.seq.size)
    if share > MISSED_SHARE:
        advice = f"{share:.1%} of the ticks are missed: {PUNCTUAL}, or a lower device.rate"
        yield Cause("missed_ticks", advice, "forcebound doctor --measure", {"share": share})
    delays = columns.loop_delay[np.isfinite(columns.loop_delay)]
    p50 = float(np.median(delays)) if delays.size else 0.0
    if p50 > LATE_ANSWER / device["rate"]:
        advice = (
            f"half of the answers are {1e3 * p50:.2g} ms old or older: less delay on the links, an "
            "environment that answers faster, or a controller of kind local_model"
        )
        yield Cause("delay", advice, data={"p50": p50})


def _of_holds(
    columns: TelemetryColumns, device: Mapping[str, Any], report: BounderReport | None
) -> Iterator[Cause]:
    if report is None:
        return
    seconds = float(columns.time[-1] - columns.time[0])
    watchdog = device.get("watchdog", "silent")
    frequent = {"silent": FREQUENT_OVERRUNS, "reporting": FREQUENT_REPORTED}.get(watchdog)
    is_learned = device.get("hold_limit") == "auto"
    if frequent is not None and seconds > 0.0 and report.overruns > frequent * seconds:
        rate = report.overruns / seconds
        code, advice = "overruns", f"device.hold_limit: auto, or a longer one; {PUNCTUAL}"
        if is_learned:
            code = "overruns_at_auto"
            advice = (
                f"{PUNCTUAL}; if the device has neither, set_hold_limit or a reporting watchdog"
            )
        cost = f"{rate:.2g} hold-limit overruns/s cost energy of the ledger"
        yield Cause(code, f"{cost}: {advice}", data={"rate": rate})
    periods = report.hold_limit * device["rate"]
    if periods > LONG_HOLD:
        code, why, advice = "long_hold_limit", "device.hold_limit is", "device.hold_limit: auto"
        if is_learned:
            code, why, advice = "late_ticks", "ticks are late: a force is planned for", PUNCTUAL
        why = f"{why} {periods:.2g} periods, and the longer the less force"
        yield Cause(code, f"{why}: {advice}", data={"periods": periods})


def _of_the_ledger(
    columns: TelemetryColumns, device: Mapping[str, Any], force: Limited
) -> Iterator[Cause]:
    cap = device.get("energy_cap", "auto")
    if cap != "auto":
        full = columns.estimated_energy[force.limited] > FULL_SHARE * cap
        if full.mean() > DEAR_SHARE:
            advice = f"the ledger is full at device.energy_cap, {1e3 * cap:.2g} mJ: a larger one,"
            yield Cause("energy_cap", f"{advice} or auto", data={"cap": cap})
    costly = [f"device.{name}" for name in COSTLY if np.any(device.get(name) or 0.0)]
    if costly:
        names = ", ".join(costly)
        advice = f"{names} cost force: docs/prices.md has the price of each"
        yield Cause("imperfections", advice, data={"names": names})
    if "inertia" in device:
        return  # of joints: telemetry has no torques to judge their encoders by
    changes = float(np.abs(np.diff(columns.applied_force, axis=0)).sum())
    price = float(0.5 * np.max(device["resolution"]) * changes)
    # Energy that the commanded force needs where it was limited.
    excess = np.maximum(force.wanted[force.limited] - np.min(device["friction"]), 0.0)
    needed = np.mean(excess**2) / (4.0 * np.min(device["damping"]) * device["rate"])
    if price > DEAR_SHARE * needed:
        advice = (
            f"changes of the force cost {1e3 * price:.2g} mJ with these encoder steps "
            "(device.resolution): a finer encoder, or an environment that commands calmly"
        )
        yield Cause("resolution", advice, data={"price": price})
