"""Trial events: packets of the topic `event`, and markers of LSL where pylsl is installed."""

import json
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib import import_module
from typing import Any

from forcebound.messages.events import EventLog, TrialEvent
from forcebound.messages.packets import Event
from forcebound.roles import LAUNCHER


def find_lsl() -> Any:
    """Return the module pylsl; None if it is not installed (extra ``study``)."""
    try:
        lsl = import_module("pylsl")
    except (ImportError, RuntimeError):  # RuntimeError: without its library
        return None
    with suppress(NotImplementedError):  # an older library prints how it starts
        lsl.set_config_content("[log]\nlevel = -1")  # warnings and errors
    return lsl


class Markers:
    """Sends each event of a session as a packet and, with LSL, as a marker.

    Args:
        publish: Takes the event as a packet of the launcher.
        lsl: The module pylsl; None: no stream. The stream `forcebound` has a marker for each event:
            JSON with ``event`` and its data.
    """

    def __init__(self, publish: Callable[[Event], None], lsl: Any = None) -> None:
        self._publish, self._log, self._outlet = publish, EventLog(LAUNCHER), None
        self._log.is_logged = False
        if lsl is not None:
            about = ("forcebound", "Markers", 1, lsl.IRREGULAR_RATE, "string", "forcebound-study")
            self._outlet = lsl.StreamOutlet(lsl.StreamInfo(*about))

    def __call__(self, kind: TrialEvent, message: str, data: Mapping[str, str]) -> None:
        """Send an event now: its kind, a message for people, data for programs."""
        self._publish(self._log.emit(time.monotonic_ns(), kind, message, data))
        if self._outlet is not None:
            self._outlet.push_sample([json.dumps({"event": kind, **data})])
