"""Result of a run, live or in virtual time: samples, configuration, summary."""

import json
import logging
import math
import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

from forcebound.axes import units_on
from forcebound.files import content_of
from forcebound.graph.graph import KINDS, GraphConfig
from forcebound.graph.resolved import to_document
from forcebound.haptics.parts.user_module import source_of
from forcebound.messages.events import BOUNDER_REPORTED, CODE_FAILED, LAW_CHANGED
from forcebound.messages.packets import TOPIC_OF, EnvironmentReply, Event, Meaning, Telemetry
from forcebound.messages.topology import HAND, HANDS, SIGNAL_TOPICS, Document, node_name
from forcebound.recordings.telemetry import TelemetryColumns

_logger = logging.getLogger(__name__)

LATE_NS = 1_000_000_000  # between the last sample and the end of the device
LEAST_ENGAGEMENT = 0.01  # at the end of a run; with less, its force was never felt
OF_THE_RUN = ("rejected_packets", "links")  # counted over all laws
_PACKAGES = ("forcebound", "numpy", "numba", "msgpack", "msgspec", "pyzmq", "mcap")


def run_metadata(config: GraphConfig) -> dict[str, str]:
    """Return the metadata of a recording: configuration, versions, seed."""
    versions = {"python": platform.python_version()}
    versions |= {package: version(package) for package in _PACKAGES}
    document = to_document(config)
    metadata = {
        "launch": json.dumps(document),
        "versions": json.dumps(versions),
        "seed": str(config.seed),
    }
    signals: dict[str, dict[str, Meaning]] = {}
    for hand, sections in document[HANDS].items():
        parts = {"environment": document["environment"], **sections}
        own, served = config.hands[hand], config.environment.model
        models = {"device": own.device, "controller": own.controller, "environment": served}
        axes, sent = own.named_axes, {"environment": own.controller.port_signals}
        kinds = {section: parts[section]["kind"] for section in KINDS if section in parts}
        device = parts["device"]
        named = {**kinds, "device": device.get("class", kinds["device"]), "law": device["law"]}
        for section, kind in named.items():
            source = source_of(kind)
            if source is not None:  # the file may change before the recording is read
                metadata[node_name(hand, f"{section}_source")] = source
        signals |= {
            node_name(hand, topic): {
                each.name: Meaning(
                    each.label or each.name,
                    # Written as of lengths, unless it is that of an angle wherever it acts.
                    each.unit
                    if section == "device" or "rad" in each.unit
                    else units_on(axes, each.unit),
                )
                for each in declared
            }
            for section, topic in SIGNAL_TOPICS.items()
            if (declared := [*models[section].declared(), *sent.get(section, ())])
        }
    return {**metadata, "signals": json.dumps(signals)} if signals else metadata


def results_of(
    path: Path, hand: str | None = None, is_growing: bool = False
) -> "dict[str, RunResult]":
    """Return the results of the hands in a recording, or of one; see RunResult.from_recording."""
    from forcebound.recordings.recording import read  # slow to import; no node process needs it

    hands = read(path, (), hand).by_hand
    return {one: RunResult.from_recording(path, is_growing, one) for one in hands}


@dataclass(frozen=True)
class RunResult:
    """The samples of one run and the resolved launch document that made them."""

    columns: TelemetryColumns
    document: Document
    events: Sequence[Event] = ()
    is_complete: bool = True  # False: the recording was cut off, at its end or before
    interrupted: bool = False  # the run ended before its planned duration
    failure: str = ""  # why it ended before, or not in order
    energy_before: float = 0.0  # J, of the device, what was taken from the true energy
    times_real_time: float = 1.0  # how fast the loop ran, without start and evaluation
    explains: bool = True  # the summary looks for causes of little force, a second or more

    @classmethod
    def from_recording(
        cls, path: Path, is_growing: bool = False, hand: str | None = None
    ) -> "RunResult":
        """Return the result of a hand that a recording holds; ConfigError if it is none of a run.

        If a recording starts mid-run, its true energy counts from the start of the law in use.
        ``is_growing``: the run has not ended.
        """
        from forcebound.recordings.recording import read  # slow to import; no node process needs it

        topics = [TOPIC_OF[kind] for kind in (Telemetry, EnvironmentReply, Event)]
        recording = read(path, topics, hand)
        with content_of(path):
            columns, events = recording.run
            document = recording.launch
            before = recording.energy_before
            columns = replace(columns, true_energy=columns.true_energy - before)
        if not recording.complete and not is_growing:
            _logger.warning("recording incomplete: using the readable part of %s", path)
        is_complete = recording.complete or is_growing
        return cls(columns, document, events, is_complete, energy_before=before)

    @property
    def label(self) -> str:
        """The hand and the law of the run, for titles; if it changed, the laws in their order."""
        first = str(self.document.get("device", {}).get("law", "unknown law"))
        laws = ", then ".join((first, *(event.data["law"] for event in self._changes)))
        return f"{self.columns.hand}: {laws}" if self.columns.hand != HAND else laws

    @property
    def _changes(self) -> list[Event]:
        return [event for event in self.events if event.event == LAW_CHANGED]

    @property
    def _lacks_its_end(self) -> bool:
        times = {event.event: event.time_ns for event in self.events}
        if "device_lost" in times or BOUNDER_REPORTED not in times or not self.columns.time.size:
            return False
        return times[BOUNDER_REPORTED] - int(self.columns.time_ns[-1]) > LATE_NS

    @property
    def by_law(self) -> "Iterator[RunResult]":
        """The results of each law of a run that changed it.

        True energy counts from the start of the law. The device's report at the end of the run
        covers all laws together, so it is left out.
        """
        device, all_ns = self.document.get("device", {}), self.columns.time_ns
        begins = [(-1, device.get("law"), self.energy_before)]
        for event in self._changes:
            energy = float(event.data.get("energy_before", "nan"))
            begins.append((event.time_ns, event.data["law"], energy))
        for (start, law, energy), (end, *_) in pairwise([*begins, (2**63 - 1, "", 0.0)]):
            part = self.columns.slice((all_ns > start) & (all_ns <= end))
            engaged = part.time[part.engagement > 0.0]
            since = part.time - (engaged[0] if engaged.size else 0.0)
            given = part.true_energy - (energy - self.energy_before)
            events = [
                event
                for event in self.events
                if event.time_ns <= end and not (event.is_fault and event.time_ns <= start)
                if event.event not in (LAW_CHANGED, BOUNDER_REPORTED)
            ]
            document = {**self.document, "device": {**device, "law": law}}
            columns = replace(part, time=since, true_energy=given)
            if since.size:
                yield replace(self, columns=columns, document=document, events=events)

    def last(self, seconds: float) -> "RunResult":
        """Return the last seconds as the result of a run whose force engaged when they began.

        True energy still counts from the beginning of the run.
        """
        time = self.columns.time
        part = self.columns.slice(time > time[-1:] - seconds)
        begin = int(part.time_ns[0])
        before = [event.data["law"] for event in self._changes if event.time_ns <= begin]
        device = self.document.get("device", {})
        events = [
            event
            for event in self.events
            if event.event != BOUNDER_REPORTED
            if event.time_ns > begin or not (event.is_fault or event.event == LAW_CHANGED)
        ]
        document = {
            **self.document,
            "device": {**device, **({"law": before[-1]} if before else {})},
        }
        columns = replace(part, time=part.time - part.time[0])
        return replace(self, columns=columns, document=document, events=events)

    @property
    def failed(self) -> str:
        """Why the run failed, or nothing came of it; empty: it did what it was to do."""
        broken = [event.message for event in self.events if event.event in CODE_FAILED]
        if self.failure or broken or self.interrupted:
            return self.failure or "".join(broken[:1])
        if not (self.columns.engagement >= LEAST_ENGAGEMENT).any():
            return (
                "the force never engaged: no command younger than the age limit reached the device,"
                " or the run was much shorter than device.engage_time"
            )
        is_answered = bool((self.columns.reply_age >= 0.0).any())
        return "" if is_answered else "no tick was answered by the environment"

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The figures; see :func:`forcebound.results.summary.summarize`.

        An incomplete recording is a further fault, ``recording_incomplete``: it was cut, or the
        recorder was so late on a busy machine that the device went on for more than a second after
        the last sample.
        """
        from forcebound.results.summary import OF_ONE_LAW, summarize, summarize_phases
        from forcebound.results.verdict import verdict

        summary = {
            **summarize(self.columns, self.document, self.events, self.explains),
            "hand": self.columns.hand,
            "law": self.label,
            "phases": summarize_phases(self.columns, self.events, self.document),
            "interrupted": self.interrupted,
            "failed": self.failed,
        }
        if not self.is_complete or self._lacks_its_end:
            summary["faults"]["recording_incomplete"] = 1
        if self._changes:
            reasons = dict.fromkeys(OF_ONE_LAW, "the run had several laws: see `laws`")
            laws = [
                {
                    **part.summary,
                    **dict.fromkeys(OF_THE_RUN),
                    "law": part.document["device"]["law"],
                    "start_s": part.columns.elapsed[0],
                }
                for part in self.by_law
            ]
            of_one = {"little_force": [], "broken_promises": [], "undefined": reasons}
            summary |= {**dict.fromkeys(OF_ONE_LAW), **of_one}
            summary["laws"] = laws
        summary = {name: _finite(value) for name, value in summary.items()}
        return {**summary, "verdict": verdict(summary, self.document)}


def _finite(value: Any) -> Any:
    """A value of a summary; None for a number that JSON does not have."""
    if isinstance(value, dict):
        return {name: _finite(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
