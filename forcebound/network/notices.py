"""Notices of the link to another machine: their kinds, and a limit for the log."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from forcebound.network.limits import HEARTBEAT_TIMEOUT_MS, MAX_FRAME

BURST = 2  # notices of one kind in a window; further ones are counted
WINDOW_NS = 10_000_000_000


class Kind(NamedTuple):
    """A kind of notice."""

    meaning: str  # what has happened
    action: str = ""  # what to do; empty if it is no problem
    command: str = ""  # of a shell; capital letters stand for values that the user knows

    @property
    def is_problem(self) -> bool:
        """Whether the user should do something about it."""
        return bool(self.action)


KINDS: Mapping[str, Kind] = {
    "opened": Kind("this end listens or connects"),
    "connected": Kind("a peer is connected; packets pass from now on"),
    "disconnected": Kind("a peer has gone"),
    "refused_here": Kind(
        "a peer was refused: its key is not in our list",
        "to admit it, add its key to remote.environment_keys (at an environment: graph_key)",
    ),
    "refused_there": Kind(
        "we were refused: our key is not in the list of the other end",
        "add our public key there",
        "forcebound keys show NAME",
    ),
    "wrong_key": Kind(
        "one end expects another public key than the other one has",
        "copy the present public key of each machine to the other one",
        "forcebound keys show NAME",
    ),
    "other_security": Kind(
        "one end uses keys and the other does not", "use the same remote: section on both machines"
    ),
    "handshake_failed": Kind(
        "a peer was silent, or did not send a valid handshake",
        "does the other end use keys, too (the same remote: section), and the same version? The end"
        " that listens cannot distinguish a peer without keys from another program; the peer's log"
        " can. Otherwise a browser or a port scan may connect to this port",
    ),
    "too_many_connections": Kind(
        "the port has as many connections as it accepts", "end the peers that do not belong here"
    ),
    "no_answer": Kind(
        "nothing answers at the address",
        "start the other end; check remote.address, remote.port and firewalls",
    ),
}


@dataclass(frozen=True)
class Notice:
    """Something happened to a connection."""

    kind: str  # a key of KINDS
    message: str  # what happened, and what to do
    data: Mapping[str, str] = field(default_factory=dict)  # such as address, key, name

    @property
    def is_problem(self) -> bool:
        """Whether the user should do something about it."""
        return KINDS[self.kind].is_problem


def gone(peer: str, address: str) -> str:
    """Return the sentence for a peer that has gone."""
    return (
        f"{peer} at {address} has gone: it left, was silent for {HEARTBEAT_TIMEOUT_MS} ms, or sent "
        f"a message of over {MAX_FRAME} bytes"
    )


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
                    start = f"{more} more like this within {WINDOW_NS // 10**9} s: "
                    data = {**last.data, "suppressed": str(more - 1)}
                    admitted.append(Notice(kind, start + last.message, data))
        for notice in notices:
            kind = notice.kind
            self.counts[kind] = self.counts.get(kind, 0) + 1
            end_ns, number, _ = self._windows.get(kind, (time_ns + WINDOW_NS, 0, notice))
            self._windows[kind] = (end_ns, number + 1, notice)
            if number < BURST:
                admitted.append(notice)
        return admitted
