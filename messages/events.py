"""Events of a process: log lines and recorded packets."""

import logging
from collections.abc import Mapping
from typing import Final, Literal, TypeAlias, cast

from forcebound.messages.packets import MAX_TEXT, Event

#: Of a study's session.
TrialEvent: TypeAlias = Literal["trial_begins", "touch_begins", "touch_ends", "trial_ends"]
#: Kinds of the events that the processes of a graph emit, besides those of a remote link.
EventKind: TypeAlias = TrialEvent | Literal[
    "phase", "parameter_set", "law_changed", "bounder_reported", "link_counted",
    "force_engages", "force_released", "ticks_missed", "readings_refused", "packets_refused",
    "environment_awaited", "environment_serves", "environment_lost", "environment_refused",
    "serving", "environment_failed", "controller_failed", "scene_failed", "scene_cut",
    "process_started", "process_ended", "device_lost", "episode_begins", "episode_ends",
]  # fmt: skip
REMOTE = "remote_"  # kinds of events of a remote link begin so; then the kind of the notice
PHASE_BEGINS: Final = "phase"  # a part of a scripted run begins; its data has the name
EPISODE_BEGINS: Final = "episode_begins"  # a part of a recording begins; its data has the number
EPISODE_ENDS: Final = "episode_ends"  # and ends; its data has the number, and whether it is kept
PARAMETERS_SET: Final = "parameter_set"  # parameters changed; its data has the new values
LINK_COUNTED: Final = "link_counted"  # packets of a link, by fate
BOUNDER_REPORTED: Final = "bounder_reported"  # what the bounder has met in a run
LAW_CHANGED: Final = "law_changed"  # another law bounds from now on; its data has its name
CODE_FAILED = ("environment_failed", "controller_failed")  # code of a part did; its run failed
TAKES_HOLD_LIMIT = "takes_hold_limit"  # in data of an event: this device can be given a hold limit
PUBLISHED = "published"  # in data of an event: code of a device, controller or environment sent it
STATE_INTERVAL_NS = 200_000_000  # between two events about a state that each packet may change
MAX_ENTRIES, MAX_DATA = 60, 1_800  # of an event's data, bytes: it takes part of a packet


class EventLog:
    """Makes the events of one process and counts them; it may write them to the log, too."""

    def __init__(self, node: str) -> None:
        self.node = node
        self.is_logged = True
        self._logger = logging.getLogger(f"forcebound.nodes.{node}")
        self._seq = 0

    def emit(
        self,
        time_ns: int,
        event: EventKind,
        message: str,
        data: Mapping[str, str] | None = None,
        *,
        is_fault: bool = False,
    ) -> Event:
        """Return the next event: its kind in one word, a message for people, data for programs.

        ``time_ns`` is on the process's monotonic clock. A fault is a warning in the log.
        """
        if self.is_logged:
            self._logger.log(logging.WARNING if is_fault else logging.INFO, "%s", message)
        seq = self._seq
        self._seq += 1
        return Event(
            seq=seq,
            time_ns=time_ns,
            node=self.node,
            event=event,
            is_fault=is_fault,
            message=message[:MAX_TEXT],
            data=_bounded(data or {}),
        )

    def publish(self, time_ns: int, event: str, message: str, *, is_fault: bool) -> Event:
        """Return the next event, which a part's code sends; it has no kind of the graph."""
        data = {PUBLISHED: "true"}
        return self.emit(time_ns, cast(EventKind, event), message, data, is_fault=is_fault)

    def link_counts(self, time_ns: int, topic: str, counts: Mapping[str, int]) -> Event:
        """Return an event with the counts of a link's packets, by fate."""
        fates = ", ".join(f"{count} {fate}" for fate, count in counts.items() if count)
        data = {"link": topic, **{fate: str(count) for fate, count in counts.items()}}
        return self.emit(time_ns, LINK_COUNTED, f"{topic}: {fates or 'nothing'}", data)


def is_of(event: Event, hand: str) -> bool:
    """Return whether an event concerns a hand: of its nodes, its links, or of all hands."""
    if event.data.get("hand", hand) != hand:
        return False
    name = event.data.get("link", event.node)
    return "/" not in name or name.startswith(f"{hand}/")


def _bounded(data: Mapping[str, str]) -> dict[str, str]:
    """Return the data that fits into a packet, and the number of entries left out."""
    kept: dict[str, str] = {}
    size = 0
    for name, text in data.items():
        kept[name] = text[:MAX_TEXT]
        size += len(name.encode()) + len(kept[name].encode())
        if size > MAX_DATA or len(kept) > MAX_ENTRIES:
            del kept[name]
            kept["left_out"] = str(len(data) - len(kept))
            break
    return kept
