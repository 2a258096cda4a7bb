"""Notices of the link to another machine, and a limit for the log."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

BURST = 2  # notices of one kind in a window; further ones are counted
WINDOW_NS = 10_000_000_000


class Problem(NamedTuple):
    """A kind of notice after which the user should do something."""

    meaning: str  # what has happened
    action: str
    command: str = ""  # of a shell; capital letters stand for values that the user knows


PROBLEMS: Mapping[str, Problem] = {
    "refused_here": Problem(
        "a peer was refused: its key is not in our list",
        "to admit it, add its key to remote.environment_keys (at an environment: graph_key)",
    ),
    "refused_there": Problem(
        "we were refused: our key is not in the list of the other end",
        "add our public key there",
        "forcebound keys show NAME",
    ),
    "handshake_failed": Problem(
        "a handshake failed: no connection",
        "use the same remote: section and version on both machines, with the present public key of"
        " each; the log of the end that connects knows more. If only the end that listens reports"
        " it, a browser or a port scan may connect to this port",
        "forcebound keys show NAME",
    ),
    "no_answer": Problem(
        "nothing answers at the address",
        "start the other end; check remote.address, remote.port and firewalls",
    ),
}


@dataclass(frozen=True)
class Notice:
    """Something happened to a connection."""

    kind: str  # a key of PROBLEMS, or opened, connected, disconnected
    detail: str  # whom it concerns, and how one knows; without a problem, all that there is to say
    data: Mapping[str, str] = field(default_factory=dict)  # such as address, key, name

    @property
    def is_problem(self) -> bool:
        """True if the user should do something about it."""
        return self.kind in PROBLEMS

    @property
    def message(self) -> str:
        """The event, and the remedy."""
        problem = PROBLEMS.get(self.kind)
        if problem is None:
            return self.detail
        remedy = f"{problem.action} (`{problem.command}`)" if problem.command else problem.action
        return f"{problem.meaning}: {self.detail}; {remedy}"


class NoticeLimit:
    """Lets the first few notices of a kind through, and then gives how many more there were."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        # By kind: the end of the window, how many notices came in it, the last of them.
        self._windows: dict[str, tuple[int, int, Notice]] = {}

    def admit(self, time_ns: int, notices: list[Notice]) -> list[Notice]:
        """Return what may be reported at ``time_ns``; all notices are counted by kind."""
        admitted = []
        for kind, (end_ns, number, last) in list(self._windows.items()):
            if time_ns >= end_ns:
                del self._windows[kind]
                more = number - BURST
                if more > 0:
                    start = f"{more} more like this within {WINDOW_NS // 10**9} s; the last: "
                    data = {**last.data, "suppressed": str(more - 1)}
                    admitted.append(Notice(kind, start + last.detail, data))
        for notice in notices:
            kind = notice.kind
            self.counts[kind] = self.counts.get(kind, 0) + 1
            end_ns, number, _ = self._windows.get(kind, (time_ns + WINDOW_NS, 0, notice))
            self._windows[kind] = (end_ns, number + 1, notice)
            if number < BURST:
                admitted.append(notice)
        return admitted
