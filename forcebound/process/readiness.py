"""Readiness of a process: topics received, and topics still missing."""

from collections.abc import Mapping
from typing import Any

from forcebound.messages.packets import (
    TOPIC_OF,
    Event,
    Scene,
)

UNCERTAIN = (TOPIC_OF[Event], TOPIC_OF[Scene])  # nothing may ever come on these


def readiness(received: Mapping[str, int]) -> dict[str, Any]:
    """Return ``ready``, ``waiting_for`` and ``received`` of a status, for counts by topic."""
    waiting_for = [
        topic for topic, count in received.items() if count == 0 and topic not in UNCERTAIN
    ]
    return {"ready": not waiting_for, "waiting_for": waiting_for, "received": dict(received)}
