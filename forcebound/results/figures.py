"""The figures of a run in one table: key, label, unit, function, needs, why a figure is missing.

A summary and its reasons, the tables that commands print, the labels of maps and the page
``docs/results.md`` are made of it. To add a figure, add a line to ``FIGURES``, and its meaning to
``docs/results.py``.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forcebound.axes import shown_on
from forcebound.results import cells, ticks
from forcebound.results import samples as need
from forcebound.results.bounder import Limited
from forcebound.results.cells import Cell, Summary
from forcebound.results.contact import (
    limit_cycle_amplitude,
    rms,
    steady_window,
)
from forcebound.results.energy import since_contact
from forcebound.results.promises import broken_promises
from forcebound.results.samples import Needs, Samples
from forcebound.results.spectrum import transparency_bandwidth
from forcebound.results.stiffness import felt_share, felt_stiffness
from forcebound.units import (
    DB,
    HZ,
    MJ,
    MM,
    MM_S,
    MS,
    N_MM,
    NUMBER,
    PERCENT,
    UNDEFINED,
    WHOLE,
    Everyday,
    N,
    S,
    W,
)

IN_MS = Everyday("ms", "ms")  # of values that a summary has in ms


@dataclass(frozen=True)
class Figure:
    """One figure of a run.

    Attributes:
        name: Its name in Python.
        label: Of its row in a table; empty: it has none.
        unit: Of its value.
        of: Returns the value of a run that has what it needs, ready for JSON, None: missing; or the
            path of an attribute of it, None without it.
        needs: What it needs of a run.
        cell: How a summary's cell is made; None: of the value in its unit.
    """

    name: str
    label: str
    unit: Everyday
    of: Callable[[Samples], Any] | str
    needs: Needs = need.ALWAYS
    cell: Cell | None = None

    @property
    def key(self) -> str:
        """Its key in a summary, with the SI unit of its value: ``peak_force_n``."""
        return self.name + self.unit.suffix

    def value(self, run: Samples) -> Any:
        """Return the value of a run that has what it needs; None: missing."""
        if not isinstance(self.of, str):
            return self.of(run)
        value: Any = run
        for name in self.of.split("."):
            value = getattr(value, name, None)
        return value

    def text(self, summary: Summary) -> str:
        """Return what a table shows of a summary; empty: no row."""
        if self.cell is not None:
            return self.cell(summary)
        value = summary[self.key]
        if value is None and self.needs.is_optional:
            return ""
        return self.shown_in(summary).show(value)

    def shown_in(self, summary: Summary) -> Everyday:
        """Return the unit of its value for people in a summary, which may be of angles."""
        return shown_on("angle", self.unit) if self.key in summary.get("units", ()) else self.unit


def _or_none(statistic: Callable[[Any], Any], values: NDArray[Any]) -> float | None:
    known = values[np.isfinite(values)]
    return float(statistic(known)) if known.size else None


def _delays(delay: str) -> Callable[[Samples], dict[str, float | None]]:
    """Return a function that gives p50, p99 and maximum of a column, in ms."""

    def of(run: Samples) -> dict[str, float | None]:
        values = getattr(run.columns, delay) * 1e3
        known = values[np.isfinite(values)]
        if not known.size:
            return dict.fromkeys(("p50", "p99", "max"))
        p50, p99 = np.percentile(known, (50, 99)).tolist()
        return {"p50": p50, "p99": p99, "max": float(known.max())}

    return of


def _duration(run: Samples) -> float | None:
    time = run.run.time[run.since]
    return float(np.ptp(time)) if time.size else None


def _bandwidth(run: Samples) -> float | None:
    stiffness = run.surface.constant_stiffness
    return transparency_bandwidth(run.impedance, stiffness) if run.impedance and stiffness else None


def _impedance(run: Samples) -> dict[str, list[float]] | None:
    if run.impedance is None:
        return None
    return {
        "frequency_hz": run.impedance.frequency.tolist(),
        "stiffness_n_per_m": run.impedance.stiffness.tolist(),
        "damping_n_s_per_m": run.impedance.damping.tolist(),
    }


def _peak_force(run: Samples) -> float | None:
    return _or_none(np.max, np.linalg.norm(run.columns.applied_force, axis=1))


def _deepest(run: Samples) -> float:
    return max(float(run.depth.max()), 0.0)


def _across(run: Samples) -> float:
    return float(run.surface.across(run.columns.applied_force)[run.contact].max())


def _share_across(run: Samples) -> float | None:
    across = run.surface.across(run.columns.applied_force)
    steady = run.contact & steady_window(run.time) & (run.normal_force > 0.0)
    return float(across[steady].sum() / run.normal_force[steady].sum()) if steady.any() else None


def _proxy_distance(run: Samples) -> float:
    assert run.surface.proxy is not None
    between = run.surface.proxy - run.columns.position
    return float(np.linalg.norm(between[run.contact], axis=1).max())


def _force_error(run: Samples) -> float:
    error = np.linalg.norm(run.saturated - run.columns.applied_force, axis=1)
    return rms(error[run.contact])


def _wall_error(run: Samples) -> float:
    assert run.wall_error is not None
    return rms(run.wall_error[run.contact])


def _strongest(name: str) -> Callable[[Samples], float | None]:
    """Return a function that gives an attribute of the strongest band of the vibration."""

    def of(run: Samples) -> float | None:
        felt = run.vibration
        return None if felt is None else float(getattr(felt, name)[felt.above_threshold.argmax()])

    return of


def _vibration(run: Samples) -> dict[str, list[float] | None] | None:
    if run.vibration is None:
        return None
    return {
        "frequency_hz": run.vibration.frequency.tolist(),
        "force_rms_n": run.vibration.force.tolist(),
        "above_threshold_db": None if run.mass is None else run.vibration.above_threshold.tolist(),
    }


def _since_contact(run: Samples) -> float | None:
    columns, first = run.columns, int(np.argmax(run.contact))
    assert run.mass is not None
    energy = columns.true_energy
    return since_contact(run.time, energy, columns.true_position, first, run.mass)


def _felt(run: Samples) -> dict[str, object] | None:
    felt = felt_stiffness(run)
    return None if felt is None else felt._asdict()


def _energy_left(run: Samples) -> float | None:
    energy = run.columns.true_energy
    return _or_none(np.min, energy[int(np.argmax(run.contact)) :])


def _ledger_deficit(run: Samples) -> float | None:
    return _or_none(lambda known: np.mean(known < 0.0), run.columns.estimated_energy)


def _bounded(run: Samples) -> float:
    return float(np.mean(Limited(run.columns, run.device).limited[run.contact]))


def _minimum(energy: str) -> Callable[[Samples], float | None]:
    """Return a function that gives the minimum since engagement of a column."""
    return lambda run: _or_none(np.min, getattr(run.run, energy)[run.since])


def _sources(run: Samples) -> dict[str, int]:
    return dict(sorted(Counter((run.device.sources or {}).values()).items()))


def _little_force(run: Samples) -> list[dict[str, object]]:
    return [{"cause": c.code, "data": dict(c.data), "advice": c.remedy} for c in run.causes]


#: Figures that rest on the report of the bounder; a sweep has none of them.
_OF_THE_BOUNDER = (
    Figure(
        "hold_limit", "hold limit mean/longest", IN_MS, ticks.hold_limits, cell=cells.hold_limit
    ),
    Figure(
        "refused_readings",
        "refused readings",
        NUMBER,
        "report.refused_readings",
        cell=cells.refused,
    ),
    Figure(
        "late_writes",
        "writes later than stated",
        NUMBER,
        "report.late_writes",
        cell=cells.late_writes,
    ),
    Figure("longest_write_delay", "", IN_MS, ticks.longest_write_delay),
    Figure("reads_and_writes", "", S, ticks.device_time),
    Figure("device_misses", "", NUMBER, "report.device_misses"),
    Figure(
        "largest_allowance",
        "largest allowance used",
        MJ,
        "report.largest_allowance",
        cell=cells.allowance,
    ),
    Figure("allowance_repaid", "", NUMBER, "report.allowance_repaid"),
    Figure("fast_holds", "hand speed exceeded", NUMBER, "report.fast_holds", cell=cells.fast_holds),
    Figure("speed_leak", "", MJ, "report.speed_leak"),
    Figure("energy_cap", "energy cap", MJ, "device.cap", cell=cells.energy_cap),
    Figure(
        "number_sources",
        "numbers of the device",
        NUMBER,
        _sources,
        cell=cells.counts("number_sources", ""),
    ),
    Figure("broken_promises", "", NUMBER, broken_promises),
    Figure(
        "little_force", "little force because of", NUMBER, _little_force, cell=cells.little_force
    ),
)
REPORTED = tuple(figure.key for figure in _OF_THE_BOUNDER)

#: All figures, in the order of the table.
FIGURES: tuple[Figure, ...] = (
    Figure("law", "law", NUMBER, "device.law", cell=lambda s: s["law"] or UNDEFINED),
    Figure("duration", "duration", S, _duration),
    Figure("samples", "samples", NUMBER, lambda run: int(run.since.sum())),
    Figure("displayed_stiffness", "displayed stiffness", N_MM, "displayed_stiffness", need.STEADY),
    Figure("stiffness", "", N_MM, _felt, need.ASKED),
    Figure("displayed_stiffness_share", "share of the stiffness", WHOLE, felt_share, need.SHARED),
    Figure("rate_hardness", "rate-hardness", N_MM, "rate_hardness", need.INWARDS),
    Figure(
        "extended_rate_hardness",
        "extended rate-hardness",
        N_MM,
        "extended_rate_hardness",
        need.INWARDS,
    ),
    Figure("transparency_bandwidth", "transparency bandwidth", HZ, _bandwidth, need.BANDWIDTH),
    Figure("displayed_impedance", "", NUMBER, _impedance, need.IMPEDANCE),
    Figure("peak_force", "peak force", N, _peak_force, need.SIZE),
    Figure("peak_force_by_axis", "peak of each axis", NUMBER, "peaks", need.NAMED, cells.peaks),
    Figure("peak_penetration", "peak penetration", MM, _deepest, need.SURFACE),
    Figure("peak_tangential_force", "peak tangential force", N, _across, need.ACROSS),
    Figure("tangential_share", "tangential over normal force", WHOLE, _share_across, need.ACROSS),
    Figure("peak_proxy_distance", "peak proxy distance", MM, _proxy_distance, need.PROXY),
    Figure("force_error_rms", "force error, RMS", N, _force_error, need.FORCES),
    Figure("wall_error_rms", "error to the ideal wall, RMS", N, _wall_error, need.WALL),
    Figure(
        "vibration_above_threshold",
        "vibration above threshold",
        DB,
        _strongest("above_threshold"),
        need.VIBRATION,
        cells.vibration,
    ),
    Figure("vibration_frequency", "", HZ, _strongest("frequency"), need.VIBRATION),
    Figure("vibration", "", NUMBER, _vibration, need.SPECTRUM),
    Figure("settling_time", "settling time", MS, "settling.time", need.SETTLED),
    Figure("overshoot_share", "overshoot", WHOLE, "settling.overshoot", need.SETTLED),
    Figure(
        "limit_cycle_amplitude",
        "limit-cycle amplitude",
        MM,
        lambda run: limit_cycle_amplitude(run.time, run.path),
        need.SURFACE,
    ),
    Figure("contact_bounces", "contact bounces", NUMBER, "bounces", need.SURFACE),
    Figure("final_speed", "speed at the end", MM_S, "final_speed", need.MOVED),
    Figure("at_rest", "", NUMBER, "is_at_rest", need.MOVED),
    Figure("penetration_at_rest", "penetration at rest", MM, "resting_depth", need.AT_REST),
    Figure(
        "true_energy_min", "minimum energy (ground truth)", MJ, _minimum("true_energy"), need.TRUTH
    ),
    Figure("energy_left", "", MJ, _energy_left, need.TOUCHED),
    Figure("largest_energy_fall", "largest fall of energy", MJ, "fall.energy", need.TRUTH),
    Figure("energy_regain_time", "time to regain it", MS, "fall.time_to_regain", need.REGAINED),
    Figure(
        "energy_since_contact_min", "minimum since contact, net", MJ, _since_contact, need.BROUGHT
    ),
    Figure(
        "observed_energy_min",
        "minimum energy (motor alone)",
        MJ,
        "observed.energy_min",
        need.ENGAGED,
    ),
    Figure("observed_energy_error", "", MJ, "observed.error", need.ENGAGED),
    Figure(
        "observed_power_min", "minimum power (motor alone)", W, "observed.power_min", need.ENGAGED
    ),
    Figure(
        "observed_deficit_share",
        "time in deficit (motor alone)",
        PERCENT,
        "observed.deficit_share",
        need.ENGAGED,
    ),
    Figure(
        "estimated_energy_min",
        "minimum energy (estimated)",
        MJ,
        _minimum("estimated_energy"),
        need.LEDGER,
    ),
    Figure(
        "ledger_deficit_share", "time in deficit (ledger)", PERCENT, _ledger_deficit, need.LEDGER
    ),
    Figure("bounder_active_share", "bounder active", PERCENT, _bounded, need.PUSHED),
    Figure("answered_share", "ticks answered", PERCENT, ticks.answered),
    Figure("same_tick_share", "answered in the same tick", PERCENT, ticks.same_tick_share),
    Figure(
        "loop_delay", "loop delay p50/p99/max", IN_MS, _delays("loop_delay"), cell=cells.loop_delay
    ),
    Figure(
        "reply_age",
        "age of the reply p50/p99/max",
        IN_MS,
        _delays("reply_age"),
        cell=cells.reply_age,
    ),
    Figure("deadline_misses", "deadline misses", NUMBER, ticks.deadline_misses),
    Figure("hold_limit_overruns", "hold-limit overruns", NUMBER, ticks.hold_limit_overruns),
    *_OF_THE_BOUNDER,
    Figure(
        "rejected_packets",
        "rejected packets",
        NUMBER,
        ticks.rejected,
        cell=cells.counts("rejected_packets"),
    ),
    Figure("links", "lost or damaged", NUMBER, ticks.links, cell=cells.lost),
    Figure("packets_saved", "saved by deadbands", NUMBER, ticks.saved, cell=cells.saved),
    Figure("faults", "faults", NUMBER, ticks.faults, cell=cells.counts("faults")),
)

_OF_STATE = (
    *("law", "true_energy_min", "energy_left", "observed_energy_min", "observed_energy_error"),
    *("final_speed", "at_rest", "limit_cycle_amplitude", "contact_bounces", "penetration_at_rest"),
    *("broken_promises", "largest_allowance", "hold_limit_overruns"),
    *("fast_holds", "speed_leak"),
)
#: Those from which the state of a hand is known.
OF_STATE = tuple(figure for figure in FIGURES if figure.name in _OF_STATE)
