"""Measures of a run in groups, and why a run does not have one.

Each group takes the samples of a run with an engaged force and returns some keys of a summary; see
``docs/results.md``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from forcebound.analysis.bounder import saturated
from forcebound.analysis.contact import (
    count_bounces,
    displayed_stiffness,
    extended_rate_hardness,
    limit_cycle_amplitude,
    rate_hardness,
    settling,
    steady_window,
)
from forcebound.analysis.energy import largest_fall, observe, since_contact
from forcebound.analysis.spectrum import (
    Vibration,
    displayed_impedance,
    transparency_bandwidth,
    vibration,
)
from forcebound.analysis.surface import Floats, Mask, scale_of
from forcebound.analysis.touch import Touch, touch_of_run
from forcebound.messages.packets import Event
from forcebound.telemetry import TelemetryColumns

GAP = 1.5  # periods; samples further apart do not belong to one stretch


@dataclass(frozen=True)
class Samples:
    """Samples of a run with an engaged force, in contact or not."""

    columns: TelemetryColumns
    touch: Touch | None
    depth: Floats  # m, shape (n,); without a surface NaN
    contact: Mask  # (n,); without a surface: a force is commanded
    saturated: Floats  # N, shape (n, axes), commanded force after saturation
    mass: float | None  # kg, apparent mass of the device
    rate: float  # Hz, nominal; NaN where neither the launch file nor the samples tell
    has_scale: bool = True  # see surface.scale_of

    @classmethod
    def of(
        cls, columns: TelemetryColumns, config: Mapping[str, Any], events: Sequence[Event] = ()
    ) -> "Samples":
        """Return the samples of a run; its events say when the surface was moved or changed.

        Raises:
            ConfigError: If the launch file describes a surface that does not fit the run.
        """
        engaged = columns.slice(columns.engagement > 0.0)
        touch = touch_of_run(engaged, events, config)
        if touch is None:
            depth = np.full(engaged.time.size, np.nan)
            contact = np.linalg.norm(engaged.commanded_force, axis=1) > 0.0
        else:
            depth = touch.depth
            contact = depth > 0.0
        device = config.get("device") or {}
        rate = device.get("rate") or _rate(engaged.time)
        mass, has_scale = device.get("mass"), scale_of(config) is not None
        wanted = saturated(engaged, device)
        return cls(engaged, touch, depth, contact, wanted, mass, rate, has_scale)

    @property
    def has_truth(self) -> bool:
        """Whether a simulated device gave the true position."""
        return bool(np.isfinite(self.columns.true_position).all())

    @property
    def path(self) -> Floats:
        """Depth behind the surface, in m, shape ``(n,)``: true where it is known."""
        if self.touch is None:
            return self.depth
        return self.touch.true_depth if self.has_truth else self.depth

    @property
    def normal_force(self) -> Floats:
        """Applied force against the surface's normal, in N, shape ``(n,)``; NaN without one."""
        return self.depth if self.touch is None else self.touch.along(self.columns.applied_force)


def contact_measures(run: Samples) -> dict[str, Any]:
    """Return what the hand feels of a surface; all None without one."""
    time, depth, force = run.columns.time, run.depth, run.normal_force
    touched = depth[int(np.argmax(run.contact)) :] if run.contact.any() else depth[:0]
    settled = settling(time, depth)
    has_surface = run.touch is not None and depth.size > 0
    return {
        "displayed_stiffness_n_per_m": displayed_stiffness(time, force, depth),
        "rate_hardness_n_per_m": rate_hardness(time, force, depth),
        "extended_rate_hardness_n_per_m": extended_rate_hardness(time, force, depth),
        "peak_penetration_m": max(float(depth.max()), 0.0) if has_surface else None,
        "contact_bounces": count_bounces(touched) if has_surface else None,
        "settling_time_s": None if settled is None else settled.time,
        "overshoot_share": None if settled is None else settled.overshoot,
        "limit_cycle_amplitude_m": limit_cycle_amplitude(time, run.path) if has_surface else None,
        **_across_measures(run),
    }


def _across_measures(run: Samples) -> dict[str, Any]:
    """Return what is felt across the normal, where the environment says what it touches."""
    force = share = distance = None
    if run.touch is not None and run.columns.position.shape[1] > 1 and run.contact.any():
        across = run.touch.across(run.columns.applied_force)
        force = float(across[run.contact].max())
        steady = run.contact & steady_window(run.columns.time) & (run.normal_force > 0.0)
        if steady.any():
            share = float(across[steady].sum() / run.normal_force[steady].sum())
    if run.touch is not None and run.touch.proxy is not None and run.contact.any():
        between = run.touch.proxy - run.columns.position
        distance = float(np.linalg.norm(between[run.contact], axis=1).max())
    return {
        "peak_tangential_force_n": force,
        "tangential_share": share,
        "peak_proxy_distance_m": distance,
    }


def force_measures(run: Samples) -> dict[str, Any]:
    """Return the errors of the force in contact, and its vibration in steady contact."""
    error = run.saturated - run.columns.applied_force
    ideal = _ideal_error(run)
    felt = None
    if run.touch is not None:
        felt = _vibration(run, run.touch.along(error) if ideal is None else ideal)
    return {
        "force_error_rms_n": _rms(np.linalg.norm(error, axis=1)[run.contact]),
        "wall_error_rms_n": None if ideal is None else _rms(ideal[run.contact]),
        **_vibration_measures(felt, run.mass is not None),
    }


def _vibration(run: Samples, error: Floats) -> Vibration | None:
    """Return the vibration of a force error, in N, in steady contact."""
    window = steady_window(run.columns.time)
    if not (window & run.contact).any():
        return None
    steady = _longest_stretch(run.columns.time, window, run.rate)
    return vibration(error[steady], run.rate, run.mass)


def _vibration_measures(felt: Vibration | None, has_mass: bool) -> dict[str, Any]:
    names = ("vibration_above_threshold_db", "vibration_frequency_hz", "vibration")
    if felt is None:
        return dict.fromkeys(names)
    spectrum = {"frequency_hz": felt.frequency.tolist(), "force_rms_n": felt.force.tolist()}
    if not has_mass:
        return dict.fromkeys(names) | {"vibration": spectrum | {"above_threshold_db": None}}
    levels, strongest = felt.above_threshold, int(np.argmax(felt.above_threshold))
    spectrum["above_threshold_db"] = levels.tolist()
    values = (float(levels[strongest]), float(felt.frequency[strongest]), spectrum)
    return dict(zip(names, values, strict=True))


def impedance_measures(run: Samples) -> dict[str, Any]:
    """Return the displayed impedance and its bandwidth."""
    time = run.columns.time
    stretch = _longest_stretch(time, run.contact, run.rate)
    shown = None
    if run.touch is not None:
        shown = displayed_impedance(run.normal_force[stretch], run.path[stretch], run.rate)
    stiffness = None if run.touch is None else run.touch.constant_stiffness
    return {
        "transparency_bandwidth_hz": transparency_bandwidth(shown, stiffness)
        if shown is not None and stiffness
        else None,
        "displayed_impedance": None
        if shown is None
        else {
            "frequency_hz": shown.frequency.tolist(),
            "stiffness_n_per_m": shown.stiffness.tolist(),
            "damping_n_s_per_m": shown.damping.tolist(),
        },
    }


def energy_measures(run: Samples) -> dict[str, Any]:
    """Return what energy does besides its minimum: falls, contact, observer, deficit."""
    columns = run.columns
    fall = largest_fall(columns.time, columns.true_energy)
    seen = observe(columns.time, columns.applied_force, columns.position)
    first = int(np.argmax(run.contact)) if run.contact.any() else None
    contact = None
    if run.touch is not None and first is not None and run.mass is not None:
        contact = since_contact(
            columns.time, columns.true_energy, columns.true_position, first, run.mass
        )
    known = columns.estimated_energy[np.isfinite(columns.estimated_energy)]
    return {
        "largest_energy_fall_j": None if fall is None else fall.energy,
        "energy_regain_time_s": None if fall is None else fall.time_to_regain,
        "energy_since_contact_min_j": contact,
        "observed_energy_min_j": None if seen is None else seen.energy_min,
        "observed_power_min_w": None if seen is None else seen.power_min,
        "observed_deficit_share": None if seen is None else seen.deficit_share,
        "ledger_deficit_share": float(np.mean(known < 0.0)) if known.size else None,
    }


#: What a figure needs of a run; all are figures of one law.
NEEDS: dict[str, tuple[str, ...]] = {
    "displayed_stiffness_n_per_m": ("force", "surface", "contact"),
    "rate_hardness_n_per_m": ("force", "surface", "contact"),
    "extended_rate_hardness_n_per_m": ("force", "surface", "contact"),
    "peak_penetration_m": ("force", "surface"),
    "contact_bounces": ("force", "surface"),
    "settling_time_s": ("force", "surface", "contact"),
    "overshoot_share": ("force", "surface", "contact"),
    "limit_cycle_amplitude_m": ("force", "surface"),
    "peak_tangential_force_n": ("force", "axes", "surface", "contact"),
    "tangential_share": ("force", "axes", "surface", "contact"),
    "peak_proxy_distance_m": ("force", "surface", "proxy", "contact"),
    "penetration_at_rest_m": ("force", "surface", "truth", "contact"),
    "final_speed_m_per_s": ("force", "truth"),
    "at_rest": ("force", "truth"),
    "force_error_rms_n": ("force", "contact"),
    "bounder_active_share": ("force", "contact"),
    "wall_error_rms_n": ("force", "surface", "truth", "stiffness", "contact"),
    "vibration_above_threshold_db": ("force", "surface", "contact", "mass"),
    "vibration_frequency_hz": ("force", "surface", "contact", "mass"),
    "vibration": ("force", "surface", "contact"),
    "transparency_bandwidth_hz": ("force", "surface", "contact", "constant"),
    "displayed_impedance": ("force", "surface", "contact"),
    "true_energy_min_j": ("force", "truth"),
    "largest_energy_fall_j": ("force", "truth"),
    "energy_regain_time_s": ("force", "truth"),
    "energy_since_contact_min_j": ("force", "truth", "surface", "contact", "mass"),
    "estimated_energy_min_j": ("force",),
    "ledger_deficit_share": ("force",),
    "observed_energy_min_j": ("force",),
    "observed_power_min_w": ("force",),
    "observed_deficit_share": ("force",),
}

_WITHOUT = {
    "force": "the force never engaged",
    "truth": "needs ground truth, which only a simulated device has",
    "axes": "the run has one axis",
    "surface": "nothing was touched, and the launch file describes no surface",
    "proxy": "the environment says no proxy",
    "stiffness": "the environment has no constant stiffness",
    "constant": "the environment has no constant stiffness",
    "contact": "no contact",
    "mass": "the launch file states no mass of the device",
}

_NO_SCALE = "a clutch or a border of the controller `scaled` moves the environment along the hand"
_NO_EXCITATION = (
    "needs 4 s of contact without gaps in which the hand moves by 1 um RMS or more in a third-"
    "octave band, with coherence 0.9; launch file impedance gives it"
)
_NOT_STEADY = "needs 0.5 s without gaps in the steady window, with contact in it"
_NOT_INWARDS = "needs a first contact of three samples in which the hand moves inwards"
_NOT_SETTLED = "the penetration does not stay within 5 % of its final value for the last 0.5 s"

_LAST_REASON = {
    "displayed_stiffness_n_per_m": "no contact in the steady window",
    "rate_hardness_n_per_m": _NOT_INWARDS,
    "extended_rate_hardness_n_per_m": _NOT_INWARDS,
    "tangential_share": "no contact in the steady window",
    "settling_time_s": _NOT_SETTLED,
    "overshoot_share": _NOT_SETTLED,
    "penetration_at_rest_m": "the hand is not at rest in contact",
    "energy_regain_time_s": "not regained by the end of the run",
    "vibration_above_threshold_db": _NOT_STEADY,
    "vibration_frequency_hz": _NOT_STEADY,
    "vibration": _NOT_STEADY,
    "transparency_bandwidth_hz": _NO_EXCITATION,
    "displayed_impedance": _NO_EXCITATION,
    "estimated_energy_min_j": "the law keeps no ledger",
    "ledger_deficit_share": "the law keeps no ledger",
}


def undefined(figures: Mapping[str, Any], run: Samples) -> dict[str, str]:
    """Return for each figure that is None, by its key, why this run does not have it."""
    has = {
        "force": run.columns.time.size > 0,
        "truth": run.has_truth,
        "axes": run.columns.position.shape[1] > 1,
        "surface": run.touch is not None,
        "proxy": run.touch is not None and run.touch.proxy is not None,
        "stiffness": run.touch is not None and run.touch.stiffness is not None,
        "constant": run.touch is not None and run.touch.constant_stiffness is not None,
        "contact": bool(run.contact.any()),
        "mass": run.mass is not None,
    }
    without = _WITHOUT if run.has_scale else _WITHOUT | {"surface": _NO_SCALE}
    reasons = {}
    for key, needs in NEEDS.items():
        if figures[key] is None:
            missing = [without[need] for need in needs if not has[need]]
            reasons[key] = (missing or [_LAST_REASON.get(key, "the run is too short")])[0]
    return reasons


def _ideal_error(run: Samples) -> Floats | None:
    """Return what the ideal wall would push more than the motor, in N; None if it is unknown."""
    if run.touch is None or run.touch.stiffness is None or not run.has_truth:
        return None
    wanted = run.touch.stiffness * np.maximum(run.path, 0.0)
    return np.asarray(wanted - run.normal_force)


def _rms(values: Floats) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _rate(time: Floats) -> float:
    return 1.0 / float(np.median(np.diff(time))) if time.size > 1 else math.nan


def _longest_stretch(time: Floats, mask: Mask, rate: float) -> slice:
    """Return the longest run of samples in the mask that has no gap in time."""
    joined = mask[1:] & mask[:-1] & (np.diff(time) <= GAP / rate)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], joined, [False])).astype(np.int8)))
    if not edges.size:
        return slice(0, 0)
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts))
    return slice(int(starts[longest]), int(ends[longest]) + 1)
