"""What happened on a link to another machine, in words, and never more than a log can bear."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

BURST = 5  # notices of one kind in a window; the others are counted
WINDOW_NS = 10_000_000_000


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
        return self.kind not in ("connected", "disconnected")


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
