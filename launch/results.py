"""What a run leaves behind, live or in virtual time: samples, configuration, summary."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from forcebound.analysis.metrics import summarize
from forcebound.recording import TelemetryColumns, read


@dataclass(frozen=True)
class RunResult:
    """The samples of one run and the resolved launch document that made them."""

    columns: TelemetryColumns
    document: Mapping[str, Any]

    @classmethod
    def from_recording(cls, path: Path) -> "RunResult":
        """Return the result that a recording holds.

        Raises:
            ConfigError: If there is no such file or it is no recording of a run.
        """
        recording = read(path)
        return cls(recording.telemetry, json.loads(recording.metadata.get("launch", "{}")))

    @property
    def label(self) -> str:
        """The run's law, for titles."""
        return str(self.document.get("device", {}).get("law", "unknown law"))

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The key figures; see :func:`forcebound.analysis.metrics.summarize`."""
        return summarize(self.columns, self.document)
