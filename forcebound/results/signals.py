"""Signals of a recording over time."""

from __future__ import annotations

from array import array
from math import nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from forcebound.messages.packets import (
    TOPIC_OF,
    DeviceState,
    EnvironmentReply,
    ForceCommand,
    Meaning,
)

if TYPE_CHECKING:
    from forcebound.recordings.recording import Recording


class Curve(NamedTuple):
    """A signal over time."""

    about: Meaning  # label and unit
    time_ns: NDArray[np.int64]  # (n,), device's clock: of the state that the sender answered
    values: NDArray[np.float64]  # (n,), NaN where there was no number


def curves_of(recording: Recording) -> list[Curve]:
    """Return the signals of a recording; of one without any, the packets are not read."""
    declared = recording.signals
    kinds = (DeviceState, EnvironmentReply, ForceCommand)
    if not any(declared.values()) and "remote" not in recording.launch:
        return []
    topics = [TOPIC_OF[kind] for kind in kinds]
    times = {topic: array("q") for topic in topics}
    found: dict[str, dict[str, array[float]]] = {
        topic: {name: array("d") for name in declared.get(topic, {})} for topic in topics
    }
    for packet in recording.stream(*topics):
        assert isinstance(packet, kinds)
        topic, signals = TOPIC_OF[type(packet)], packet.signals or {}
        for name in signals:  # of a program of another language, perhaps
            found[topic].setdefault(name, array("d", [nan]) * len(times[topic]))
        time_ns = packet.time_ns if isinstance(packet, DeviceState) else packet.device_time_ns
        times[topic].append(time_ns)
        for name, values in found[topic].items():
            values.append(signals.get(name, nan))
    return [
        Curve(
            declared.get(topic, {}).get(name, Meaning(name, "")),
            np.array(times[topic]),
            np.array(values),
        )
        for topic in topics
        for name, values in found[topic].items()
    ]
