"""Result of a run, live or in virtual time: samples, configuration, summary."""

import json
import logging
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

from forcebound.config.graph import KINDS, GraphConfig
from forcebound.config.resolved import to_document
from forcebound.files import content_of
from forcebound.messages.packets import TOPIC_OF, EnvironmentReply, Event, Telemetry
from forcebound.nodes.events import BOUNDER_REPORTED, LAW_CHANGED
from forcebound.parts.user_module import source_of
from forcebound.telemetry import TelemetryColumns

_logger = logging.getLogger(__name__)

LEAST_ENGAGEMENT = 0.01  # at the end of a run; with less, its force was never felt
OF_THE_RUN = ("rejected_packets", "links")  # counted over all laws
# What is measured of the contact or of the ledger, and so has a value under one law only.
OF_ONE_LAW = (
    *("displayed_stiffness_n_per_m", "rate_hardness_n_per_m", "extended_rate_hardness_n_per_m"),
    *("tangential_share", "force_error_rms_n", "wall_error_rms_n"),
    *("vibration_above_threshold_db", "vibration_frequency_hz", "vibration"),
    *("transparency_bandwidth_hz", "displayed_impedance", "settling_time_s", "overshoot_share"),
    *("limit_cycle_amplitude_m", "contact_bounces", "largest_energy_fall_j"),
    *("energy_regain_time_s", "energy_since_contact_min_j", "true_energy_min_j"),
    *("estimated_energy_min_j", "ledger_deficit_share", "bounder_active_share"),
    *("observed_energy_min_j", "observed_power_min_w", "observed_deficit_share"),
)
_PACKAGES = ("forcebound", "numpy", "numba", "msgpack", "msgspec", "pyzmq", "mcap")


def run_metadata(config: GraphConfig) -> dict[str, str]:
    """Return the metadata of a recording: configuration, versions, seed."""
    versions = {"python": platform.python_version()}
    versions |= {package: version(package) for package in _PACKAGES}
    document = to_document(config)
    metadata = {
        "launch": json.dumps(document, sort_keys=True),
        "versions": json.dumps(versions),
        "seed": str(config.seed),
    }
    kinds = {section: document[section]["kind"] for section in KINDS if section in document}
    for section, kind in {**kinds, "law": config.device.servo.law}.items():
        source = source_of(kind)
        if source is not None:  # the file may change before the recording is read
            metadata[f"{section}_source"] = source
    return metadata


@dataclass(frozen=True)
class RunResult:
    """The samples of one run and the resolved launch document that made them."""

    columns: TelemetryColumns
    document: Mapping[str, Any]
    events: Sequence[Event] = ()
    is_complete: bool = True  # False: the recording was cut off, at its end or before
    interrupted: bool = False  # the run ended before its planned duration
    energy_before: float = 0.0  # J, of the device, what was taken from the true energy
    times_real_time: float = 1.0  # how fast the loop ran, without start and evaluation

    @classmethod
    def from_recording(cls, path: Path) -> "RunResult":
        """Return the result that a recording holds.

        True energy of one that begins later counts from when the law of then began.

        Raises:
            ConfigError: If there is no such file or it is no recording of a run.
        """
        from forcebound.recording import read  # slow to import; no node process needs it

        recording = read(path, [TOPIC_OF[kind] for kind in (Telemetry, EnvironmentReply, Event)])
        with content_of(path):
            columns, events = recording.run
            document = recording.launch
            before = recording.energy_before
            columns = replace(columns, true_energy=columns.true_energy - before)
        if not recording.complete:
            _logger.warning("recording incomplete: using the readable part of %s", path)
        return cls(columns, document, events, recording.complete, energy_before=before)

    @property
    def label(self) -> str:
        """The run's law, for titles; if it changed, the laws in their order."""
        first = str(self.document.get("device", {}).get("law", "unknown law"))
        return ", then ".join((first, *(event.data["law"] for event in self._changes)))

    @property
    def _changes(self) -> list[Event]:
        return [event for event in self.events if event.event == LAW_CHANGED]

    @property
    def by_law(self) -> "list[RunResult]":
        """The time of each law of a run that changed it, each with its own beginning.

        True energy counts from when the law began. What the device reports at the end of the run is
        of all laws together, and so of none.
        """
        device = self.document.get("device", {})
        begins = [(-1, str(device.get("law")), self.energy_before)] + [
            (event.time_ns, event.data["law"], float(event.data.get("energy_before", "nan")))
            for event in self._changes
        ]
        parts = []
        for (start, law, energy), (end, *_) in zip(
            begins, [*begins[1:], (2**63 - 1, "", 0.0)], strict=True
        ):
            time_ns = self.columns.time_ns
            inside = self.columns.slice((time_ns > start) & (time_ns <= end))
            engaged = inside.time[inside.engagement > 0.0]
            part = replace(
                inside,
                time=inside.time - (engaged[0] if engaged.size else 0.0),
                true_energy=inside.true_energy - (energy - self.energy_before),
            )
            events = [
                event
                for event in self.events
                if event.time_ns <= end and not (event.is_fault and event.time_ns <= start)
                if event.event not in (LAW_CHANGED, BOUNDER_REPORTED)
            ]
            document = {**self.document, "device": {**device, "law": law}}
            parts.append(replace(self, columns=part, document=document, events=events))
        return parts

    @property
    def why_idle(self) -> str:
        """Why nothing came of the run; empty: a force engaged, and the environment answered."""
        reached = float(self.columns.engagement.max(initial=0.0))
        if reached == 0.0:
            return (
                "the force never engaged: no command younger than the age limit reached the device"
            )
        if reached < LEAST_ENGAGEMENT:
            return (
                f"the force never engaged: its ramp (device.engage_time) came to {reached:.1g} of"
                " 1 when the run ended"
            )
        if not (self.columns.reply_age >= 0.0).any():
            return "no tick was answered: no command was made of an answer of the environment"
        return ""

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The key figures; see :func:`forcebound.analysis.summary.summarize`.

        An incomplete recording is a further fault, ``recording_incomplete``.
        """
        import numpy as np  # a launcher starts without it

        from forcebound.analysis.bounder import summarize_bounder
        from forcebound.analysis.summary import summarize, summarize_events, summarize_phases

        events = summarize_events(self.events)
        if not self.is_complete:
            events["faults"]["recording_incomplete"] = 1
        with np.errstate(all="ignore"):  # of what is no motion, such as a position of 1e300 m
            summary = {
                **summarize(self.columns, self.document, self.events),
                **summarize_bounder(self.columns, self.events, self.document),
                **events,
                "law": self.label,
                "phases": summarize_phases(self.columns, self.events, self.document),
                "interrupted": self.interrupted,
            }
        if self._changes:
            no_figure = dict.fromkeys(OF_ONE_LAW)
            reasons = dict.fromkeys(OF_ONE_LAW, "the run had several laws: see `laws`")
            undefined = {**summary["undefined"], **reasons}
            laws = [
                {
                    **part.summary,
                    **dict.fromkeys(OF_THE_RUN),
                    "start_s": float(part.columns.elapsed[0]),
                }
                for part in self.by_law
                if part.columns.time.size
            ]
            summary |= {**no_figure, "little_force": [], "undefined": undefined, "laws": laws}
        return {name: _finite(value) for name, value in summary.items()}


def _finite(value: Any) -> Any:
    """A value of a summary; None for a number that JSON does not have."""
    if isinstance(value, dict):
        return {name: _finite(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
