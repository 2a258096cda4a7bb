"""What happened on a link to another machine, in words, and never more than a log can bear."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

BURST = 2  # notices of one kind in a window; the others are counted
WINDOW_NS = 10_000_000_000
PAIR_NS = 250_000_000  # what happens to both streams of a link does not do so in one instant


@dataclass(frozen=True)
class Notice:
    """Something happened to a connection.

    Attributes:
        kind: A word for machines; :data:`forcebound.network.remote.KINDS` lists them.
        message: What happened, and what to do, for the log.
        data: Details as text, such as ``stream``, ``address``, ``key``.
    """

    kind: str
    message: str
    data: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_problem(self) -> bool:
        """Whether somebody should do something about it."""
        return self.kind not in ("listening", "connecting", "connected", "disconnected")

    @property
    def place(self) -> str:
        """Where it happened, as the message writes it: ``192.168.1.20:7410 (queries)``."""
        return f"{self.data.get('address')} ({self.data.get('stream')})"


class StreamPairs:
    """Makes one notice of two that say the same of the two streams of a link.

    A notice is held back until the other stream's comes, another one of its own stream, or the end
    of a short time.
    """

    def __init__(self) -> None:
        self._held: dict[str, tuple[int, Notice]] = {}  # stream: until when, what

    @property
    def due_ns(self) -> int | None:
        """When :meth:`pair` wants to be called at the latest; None if nothing is held back."""
        return min((end_ns for end_ns, _ in self._held.values()), default=None)

    def pair(self, time_ns: int, notices: list[Notice]) -> list[Notice]:
        """Return what is to be said at ``time_ns``."""
        said: list[Notice] = []
        for notice in notices:
            other = self._take_other(notice)
            if other is not None:
                said.append(_of_both(*sorted((other, notice), key=lambda n: n.data["stream"])))
                continue
            stream = notice.data.get("stream", "")
            said += self._release(stream)
            if notice.place in notice.message:
                self._held[stream] = (time_ns + PAIR_NS, notice)
            else:
                said.append(notice)
        for stream, (end_ns, _) in list(self._held.items()):
            if time_ns >= end_ns:
                said += self._release(stream)
        return said

    def _release(self, stream: str) -> list[Notice]:
        _, notice = self._held.pop(stream, (0, None))
        return [] if notice is None else [notice]

    def _take_other(self, notice: Notice) -> Notice | None:
        for stream, (_, held) in self._held.items():
            if stream != notice.data.get("stream") and _without_place(held) == _without_place(
                notice
            ):
                del self._held[stream]
                return held
        return None


def _without_place(notice: Notice) -> tuple[str, str]:
    return notice.kind, notice.message.replace(notice.place, "")


def _of_both(first: Notice, second: Notice) -> Notice:
    addresses = dict.fromkeys(notice.data["address"] for notice in (first, second))
    streams = [notice.data["stream"] for notice in (first, second)]
    place = f"{first.place} and {second.place}"
    if len(addresses) == 1:
        place = f"{first.data['address']} ({' and '.join(streams)})"
    data = {**first.data, "stream": ", ".join(streams), "address": ", ".join(addresses)}
    return Notice(first.kind, first.message.replace(first.place, place), data)


class NoticeLimit:
    """Lets the first few notices of a kind through, and says how many came after them."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self._windows: dict[str, tuple[int, int]] = {}  # kind: end of the window, notices in it
        self._last: dict[str, Notice] = {}

    def admit(self, time_ns: int, notices: list[Notice]) -> list[Notice]:
        """Return what may be said at ``time_ns``; all notices are counted by kind."""
        said = self._summaries(time_ns)
        for notice in notices:
            kind = notice.kind
            self.counts[kind] = self.counts.get(kind, 0) + 1
            end_ns, number = self._windows.get(kind, (time_ns + WINDOW_NS, 0))
            self._windows[kind] = (end_ns, number + 1)
            self._last[kind] = notice
            if number < BURST:
                said.append(notice)
        return said

    def _summaries(self, time_ns: int) -> list[Notice]:
        said = []
        for kind, (end_ns, number) in list(self._windows.items()):
            if time_ns < end_ns:
                continue
            del self._windows[kind]
            last, more = self._last.pop(kind), number - BURST
            if more > 0:
                message = f"{more} more like this within {WINDOW_NS // 10**9} s: {last.message}"
                data = {**last.data, "suppressed": str(more - 1)}
                said.append(replace(last, message=message, data=data))
        return said
