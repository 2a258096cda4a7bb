"""Episodes of a recording: the parts of it that somebody began, and kept or discarded."""

from collections.abc import Iterable
from typing import NamedTuple

from forcebound.messages.events import EPISODE_BEGINS, EPISODE_ENDS
from forcebound.messages.packets import MAX_COUNT, TOPIC_OF, Event, Packet
from forcebound.recordings.recording import Recording


class Episode(NamedTuple):
    """One episode.

    Attributes:
        number: From 0, of all that were begun.
        begin_ns: On the devices' clock, ns.
        end_ns: Likewise, the first instant that is no longer in it.
        kept: Whether it was kept; False: discarded, or never ended.
        is_open: Whether the recording has no end of it.
    """

    number: int
    begin_ns: int
    end_ns: int = MAX_COUNT
    kept: bool = False
    is_open: bool = True


def episodes_of(recording: Recording) -> list[Episode]:
    """Return the episodes of a recording, oldest first; without events of any: all of it, kept.

    An episode without an end, such as the last one of a graph that stopped, is open and not kept.
    """
    found = _episodes(recording.stream(TOPIC_OF[Event]))
    return found or [Episode(0, 0, kept=True, is_open=False)]


def _episodes(events: Iterable[Packet]) -> list[Episode]:
    found: list[Episode] = []
    for event in events:
        assert isinstance(event, Event)
        if found and found[-1].is_open and event.event in (EPISODE_BEGINS, EPISODE_ENDS):
            is_end = event.event == EPISODE_ENDS
            kept = is_end and event.data.get("kept") == "true"
            found[-1] = found[-1]._replace(end_ns=event.time_ns, kept=kept, is_open=not is_end)
        if event.event == EPISODE_BEGINS:
            found.append(Episode(int(event.data["episode"]), event.time_ns))
    return found
