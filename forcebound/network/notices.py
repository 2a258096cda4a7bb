"""Notices of the link to another machine: codes with data, their sentences, a limit for the log.

A notice carries a code and what it is about; the sentence is made when somebody reads it. To add
one: a line in :data:`SENTENCES`, and for a new kind a line in :data:`KINDS`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from forcebound.network.limits import (
    HANDSHAKE_MS,
    HEARTBEAT_TIMEOUT_MS,
    MAX_CONNECTIONS,
    MAX_FRAME,
    MAX_UNFINISHED,
    NO_ANSWER_NS,
)

BURST = 2  # notices of one kind in a window; the others are counted
WINDOW_NS = 10_000_000_000


class Kind(NamedTuple):
    """A kind of notice."""

    meaning: str  # what has happened
    action: str = ""  # what to do; empty if it is no problem
    command: str = ""  # of a shell; capital letters stand for what the user knows

    @property
    def is_problem(self) -> bool:
        """Whether somebody should do something about it."""
        return bool(self.action)


_OTHER_SOFTWARE = "find who sends it: a node of your own, or of another version of forcebound"

KINDS: Mapping[str, Kind] = {
    "listening": Kind("this end waits for the other one"),
    "connecting": Kind("this end looks for the other one"),
    "connected": Kind("a peer is there; packets pass from now on"),
    "disconnected": Kind("a peer has gone"),
    "refused_here": Kind(
        "a peer was refused: its key is not in our list",
        "if it is wanted, add its key to remote.environment_keys (at an environment: graph_key)",
    ),
    "refused_there": Kind(
        "we were refused: our key is not in the list there, or its port is full",
        "add our public key there",
        "forcebound keys show NAME",
    ),
    "wrong_key_of_ours": Kind(
        "a peer expects another public key of ours",
        "give the peer our present key",
        "forcebound keys show NAME",
    ),
    "wrong_key_there": Kind(
        "the listener ended our handshake, most likely because it has another key",
        "copy its present public key to this machine",
    ),
    "other_security": Kind(
        "one end uses keys and the other does not", "use the same remote: section on both machines"
    ),
    "handshake_timeout": Kind(
        "a peer was silent or too slow in its handshake",
        "does a browser, a port scan or the like connect to this port?",
    ),
    "handshake_failed": Kind(
        "what came is no handshake of this link",
        "does the other end use keys, too (the same remote: section), and the same version? The end"
        " that listens cannot tell a peer without keys from another program; the peer's log can. "
        "Else: who else uses this port?",
    ),
    "too_many_connections": Kind(
        "the port has as many connections as it takes", "end the peers that are not wanted"
    ),
    "protocol_error": Kind(
        "a peer sent a message that is too large, or broke the protocol", _OTHER_SOFTWARE
    ),
    "no_answer": Kind(
        "nobody answers at the address",
        "start the other end; check remote.address, remote.port and firewalls",
    ),
}

_NO = "no connection with {address}: "

# By code: the kind, and the sentence with the keys of the notice's data.
SENTENCES: Mapping[str, tuple[str, str]] = {
    "listening": ("listening", "listening at {address} port {port}, {keys}; no peer yet"),
    "connecting": ("connecting", "connecting to {address} port {port}, {keys}"),
    "came": ("connected", "{peer} connected from {address}"),
    "met": ("connected", "connected to {peer} at {address}"),
    "left": (
        "disconnected",
        f"{{peer}} at {{address}} has gone: it left, was silent for {HEARTBEAT_TIMEOUT_MS} ms, or "
        f"sent a message of over {MAX_FRAME} bytes",
    ),
    "lost": (
        "disconnected",
        f"{{peer}} at {{address}} has gone: it left, or was silent for {HEARTBEAT_TIMEOUT_MS} ms; "
        "connecting again",
    ),
    "unknown_key": (
        "refused_here",
        "refused {address}: its key {key} is not in the list of who may connect; if it should be, "
        "name it under {list} in the launch file",
    ),
    "no_key": ("refused_here", "refused {address}: it uses another security than this end"),
    "full": (
        "too_many_connections",
        "refused {address}: {peer} may connect, but this port has as many peers as it takes",
    ),
    "too_many": (
        "too_many_connections",
        "ended the connection of {address}: this port has more than "
        f"{MAX_CONNECTIONS} connections",
    ),
    "unfinished": (
        "protocol_error",
        f"{{peer}} at {{address}} sent over {MAX_UNFINISHED // 10**6} MB without the end of a "
        "message: the connection was ended",
    ),
    "there_full": (
        "refused_there",
        "{address} refused us: it has as many connections as it takes",
    ),
    "there_unknown": (
        "refused_there",
        "{address} refused us: our key {own} is not in its list of who may connect; add it to the "
        "launch file there, or use the key that is in it",
    ),
    # Handshakes that failed, at either end.
    "expects_other_key": (
        "wrong_key_of_ours",
        f"{_NO}it expects another public key of ours than we have: give it the right one",
    ),
    "uses_no_keys": (
        "other_security",
        f"{_NO}it uses no keys (CURVE), and we do: start it with keys",
    ),
    "uses_keys": (
        "other_security",
        f"{_NO}it uses keys (CURVE), and we do not: name the keys in the launch file",
    ),
    "too_slow": (
        "handshake_timeout",
        f"{_NO}it did not finish its handshake in {HANDSHAKE_MS / 1000:g} s",
    ),
    "no_zmtp": (
        "handshake_failed",
        f"{_NO}it does not speak ZMTP, the protocol of ZeroMQ, left during the handshake, or has "
        "another version of forcebound",
    ),
    "left_as_without_keys": (
        "handshake_failed",
        "{address} left during the handshake, as one does that uses no keys or does not speak ZMTP",
    ),
    "left_as_with_keys": (
        "handshake_failed",
        "{address} left during the handshake, as one does that uses keys or does not speak ZMTP",
    ),
    "there_wrong_key": (
        "wrong_key_there",
        "{address} ended the connection during the handshake: most likely {key} ({name}) is not "
        "its public key: ask there with `forcebound keys show NAME`; it may also use no keys",
    ),
    "there_likely_keys": (
        "other_security",
        "{address} ended the connection during the handshake: most likely it uses keys (CURVE), "
        "and we do not",
    ),
    # Later.
    "broken": (
        "protocol_error",
        f"{{address}} broke the protocol, as with a message of over {MAX_FRAME} bytes: the "
        "connection was ended; connecting again",
    ),
    "no_answer": (
        "no_answer",
        f"no connection to {{address}} for {NO_ANSWER_NS // 10**9} s: nothing listens there, or a "
        "firewall or a lost network is between; still trying",
    ),
    "socket_error": ("handshake_failed", "a socket of the remote link: {error}"),
}


@dataclass(frozen=True)
class Notice:
    """Something happened to a connection."""

    code: str  # a key of SENTENCES
    data: Mapping[str, str] = field(default_factory=dict)  # such as address, key, name
    more: int = 0  # how many like this one were not reported

    @property
    def kind(self) -> str:
        """A key of :data:`KINDS`."""
        return SENTENCES[self.code][0]

    @property
    def message(self) -> str:
        """What happened, and what to do, for the log."""
        key = self.data.get("key")
        peer = f"{self.data.get('name')} (key {key})" if key else "a peer without keys"
        sentence = SENTENCES[self.code][1].format_map({**self.data, "peer": peer})
        if not self.more:
            return sentence
        return f"{self.more} more like this within {WINDOW_NS // 10**9} s: {sentence}"

    @property
    def is_problem(self) -> bool:
        """Whether somebody should do something about it."""
        return KINDS[self.kind].is_problem


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
                    data = {**last.data, "suppressed": str(more - 1)}
                    admitted.append(replace(last, data=data, more=more))
        for notice in notices:
            kind = notice.kind
            self.counts[kind] = self.counts.get(kind, 0) + 1
            end_ns, number, _ = self._windows.get(kind, (time_ns + WINDOW_NS, 0, notice))
            self._windows[kind] = (end_ns, number + 1, notice)
            if number < BURST:
                admitted.append(notice)
        return admitted
