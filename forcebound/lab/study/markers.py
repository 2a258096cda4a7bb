"""Trial events: on the graph's topic `event`, and as markers of LSL if asked for."""

import json
from collections.abc import Mapping
from importlib import import_module
from typing import Any

from forcebound.extras import missing
from forcebound.lab.study.session import Mark
from forcebound.messages.events import TrialEvent


def find_lsl(scope: str) -> Any:
    """Return the module pylsl; its streams are found within ``scope``: ``machine``, ``link``.

    ConfigError if it cannot be used.
    """
    try:
        lsl = import_module("pylsl")
        # Warnings and errors, not how it starts.
        lsl.set_config_content(f"[log]\nlevel = -1\n[multicast]\nResolveScope = {scope}\n")
    except (ImportError, RuntimeError) as error:  # RuntimeError: without its library, or old
        raise missing("--lsl", "pylsl", error) from error
    return lsl


class Markers:
    """Sends each event of a session to its graph and, with LSL, as a marker.

    Args:
        publish: Sends an event on the topic `event` of the graph.
        lsl: The module pylsl; None: no stream. The stream `forcebound` has a marker for each event:
            JSON with ``event`` and its data.
    """

    def __init__(self, publish: Mark, lsl: Any = None) -> None:
        self._publish, self._outlet = publish, None
        if lsl is not None:
            about = ("forcebound", "Markers", 1, lsl.IRREGULAR_RATE, "string", "forcebound-study")
            self._outlet = lsl.StreamOutlet(lsl.StreamInfo(*about))

    def __call__(self, kind: TrialEvent, message: str, data: Mapping[str, str]) -> None:
        """Send an event now: its kind, a message for people, data for programs."""
        if self._outlet is not None:  # first: asking the graph takes time
            self._outlet.push_sample([json.dumps({"event": kind, **data})])
        self._publish(kind, message, data)
