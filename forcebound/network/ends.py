"""The two ends of the link to another machine, as the section ``remote`` sets them.

A section that is wrong on any machine is an error when it is made. Something that this machine
lacks (a key file, an address, a free port) is an error of :meth:`RemoteSection.check_here`.

A section without keys is for loopback, which every user of the machine can reach. So both ends use
the keys of :func:`loopback_keys` there, which only processes of the same user can read.
"""

import fcntl
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from forcebound.errors import ConfigError
from forcebound.folders import runtime_folder
from forcebound.messages.topology import HAND
from forcebound.network import keys
from forcebound.network.addresses import Host, check_free, numeric_address, resolve
from forcebound.network.keys import KeyPair
from forcebound.quantities import CheckedText, Range, check_ranges

DEFAULT_PORT = 7410
Role = Literal["graph", "environment"]
T = TypeVar("T")

LOOPBACK = "this-user-graph", ("this-user-environment",)  # names of keys on loopback

_WITHOUT_KEYS = (
    "without keys a link stays on this machine. Make a key pair on each machine with "
    "`forcebound keys new NAME` and name them under graph_key and environment_keys; or write "
    "insecure: true, if everybody on that network may command forces to the hand"
)
_BOTH = (
    "keys are used by both ends or by none; make a pair on each machine with "
    "`forcebound keys new NAME`"
)
_PORTS = Range(at_least=1, at_most=65535)


@dataclass(frozen=True)
class RemoteEnd:
    """One end of the link, as :meth:`RemoteSection.end` gives it."""

    role: Role  # a graph sends queries, an environment replies
    listens: bool  # whether this end does
    address: str  # of the listening end: IPv4, IPv6 in brackets, or a name
    port: int = DEFAULT_PORT  # of the listening end
    key: KeyPair | None = None  # our pair; None: no keys
    peers: Mapping[str, str] = field(default_factory=dict)  # that may connect: name by public key
    insecure: bool = False  # whether a link without keys may leave this machine

    def __post_init__(self) -> None:
        # A listener without a key would admit every peer.
        if (self.key is None) != (not self.peers):
            raise ConfigError("keys are used by both ends or by none")


@dataclass(frozen=True)
class RemoteSection:
    """Address and keys of a graph and its environment: the same on both machines.

    Attributes:
        address: Of the listening end, as the other one reaches it.
        port: TCP port of the listening end.
        listens: Which end listens.
        graph_key: The graph's key, by name or as a public key.
        environment_keys: The keys of the environments that may serve it, likewise. The one whose
            secret is on this machine is that of this environment.
        insecure: Whether to use no keys, so that every peer that reaches the port may take part.

    Raises:
        ConfigError: If something in it would be wrong on any machine; ``field`` names it.
    """

    address: Annotated[str, CheckedText(numeric_address)]
    port: Annotated[int, _PORTS] = DEFAULT_PORT
    listens: Role = "graph"
    graph_key: Annotated[str, CheckedText(keys.check_key)] | None = None
    environment_keys: tuple[Annotated[str, CheckedText(keys.check_key)], ...] = ()
    insecure: bool = False

    def __post_init__(self) -> None:
        check_ranges(self)
        for name, message in self._faults():
            raise ConfigError(message, field=name)

    def _faults(self) -> Iterator[tuple[str, str]]:
        """Yield the name of each wrong field, and why it is wrong."""
        known, has_graph_key = self.environment_keys, self.graph_key is not None
        if known and not has_graph_key:
            yield "environment_keys", f"graph_key is missing beside environment_keys: {_BOTH}"
        if has_graph_key and not known:
            yield "graph_key", f"environment_keys is missing or empty beside graph_key: {_BOTH}"
        if self.insecure and has_graph_key:
            yield "insecure", "insecure: true means no keys: name keys, or be insecure, not both"
        if len(set(known)) < len(known):
            yield "environment_keys", f"environment_keys names a key twice: {', '.join(known)}"
        if self.listens == "environment" and len(known) > 1:
            yield (
                "environment_keys",
                f"environment_keys has {len(known)} keys, and a graph that connects can expect only"
                " one; let the graph listen if several may serve it",
            )
        number = numeric_address(self.address)
        if self._is_open and number is not None and not number.is_loopback:
            yield "address", f"address {self.address} is on a network, and {_WITHOUT_KEYS}"

    def end(self, role: Role, folder: Path | None = None) -> RemoteEnd:
        """Return this machine's end, with its keys; ConfigError if a key is missing or unsafe."""
        pair, peers = self._keys(role, folder)
        listens = role == self.listens
        return RemoteEnd(role, listens, self.address, self.port, pair, peers, self.insecure)

    def check_here(self, role: Role, folder: Path | None = None) -> None:
        """Check what an end needs of this machine; ConfigError names everything that is missing."""
        listens = role == self.listens
        problems: list[str] = []
        host = _noting(problems, "remote.address: ", resolve, self.address)
        if host is not None:
            _noting(problems, "", refuse_exposure, host, self.address, listens, self._is_open)
        if self.graph_key is not None or not problems:
            _noting(problems, "", self._keys, role, folder)
        if host is not None and listens:
            _noting(problems, "remote: ", check_free, host, self.port)
        if problems:
            raise ConfigError("\n".join(problems))

    def _keys(self, role: Role, folder: Path | None) -> tuple[KeyPair | None, dict[str, str]]:
        """Return the pair of an end, None without keys, and the other end's names by public key."""
        if self._is_open:
            folder = loopback_keys()
            try:
                return _keys_of(role, *LOOPBACK, folder)
            except ConfigError as error:
                raise ConfigError(
                    f"{error}\nend the runs that use a link on this machine and delete the folder "
                    f"{folder}: its keys are made again"
                ) from None
        if self.graph_key is not None:
            return _keys_of(role, self.graph_key, self.environment_keys, folder)
        return None, {}

    @property
    def _is_open(self) -> bool:
        return self.graph_key is None and not self.insecure


def check_ends(sections: Mapping[str, RemoteSection], role: Role) -> None:
    """Check what the ends of several hands need, as :meth:`RemoteSection.check_here` does."""
    problems = []
    for hand, section in sections.items():
        try:
            section.check_here(role)
        except ConfigError as error:
            problems += [
                f"{hand}.{line}" if hand != HAND else line for line in str(error).splitlines()
            ]
    if problems:
        raise ConfigError("\n".join(problems))


def loopback_keys() -> Path:
    """Return the folder with the keys for links on loopback, of this user and this session.

    They are made when they are first needed, in the user's runtime folder. They cannot belong to
    one run: the other end is started by another command, maybe first. ConfigError without such a
    folder.
    """
    runtime = runtime_folder()
    if runtime is None:
        raise ConfigError(
            "no private folder for the keys of a link on this machine: set XDG_RUNTIME_DIR to a "
            "folder of your own (mkdir -m 700 DIR); or write insecure: true, if every user of this "
            "machine may command forces to the hand"
        )
    folder = runtime / "forcebound"
    graph, environments = LOOPBACK
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as error:
        raise ConfigError(f"cannot keep keys in {folder}: {error.strerror}") from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)  # both ends may start at once; it takes milliseconds
        for name in (graph, *environments):
            if not keys.has_secret(name, folder):
                keys.new_key(name, folder)
    finally:
        os.close(descriptor)
    return folder


def _own_environment(environment_keys: Sequence[str], folder: Path | None) -> str:
    """Return the key of the environment on this machine."""
    ours = [key for key in environment_keys if keys.has_secret(key, folder)]
    if len(ours) > 1:
        raise ConfigError(
            f"this machine holds the secrets of several environment_keys ({', '.join(ours)}): "
            "leave only its own one in its launch file"
        )
    # Without a secret, the error of key_pair names the file.
    return ours[0] if ours else environment_keys[0]


def _keys_of(
    role: Role, graph_key: str, environment_keys: Sequence[str], folder: Path | None
) -> tuple[KeyPair, dict[str, str]]:
    """Return our pair, and the other end's names by public key."""
    problems: list[str] = []
    if role == "graph":
        pair = _noting(problems, "remote.graph_key: ", keys.key_pair, graph_key, folder)
        others, where = list(environment_keys), "remote.environment_keys: "
    else:
        where = "remote.environment_keys: "
        own = _noting(problems, where, _own_environment, environment_keys, folder)
        pair = None if own is None else _noting(problems, where, keys.key_pair, own, folder)
        others, where = [graph_key], "remote.graph_key: "
    found = {name: _noting(problems, where, keys.public_key, name, folder) for name in others}
    peers = {public: name for name, public in found.items() if public is not None}
    if not problems and len(peers) < len(others):
        problems.append(f"{where}a key is named twice: {', '.join(others)}")
    if problems or pair is None:
        raise ConfigError("\n".join(problems))
    return pair, peers


def _noting(problems: list[str], where: str, do: Callable[..., T], *args: Any) -> T | None:
    """Return the result of a function; None, with a problem noted, if it fails."""
    try:
        return do(*args)
    except ConfigError as error:
        problems.append(f"{where}{error}")
        return None


def refuse_exposure(host: Host, address: str, listens: bool, is_open: bool) -> None:
    """Refuse to connect to a wildcard address, or without keys to another machine."""
    if host.is_wildcard and not listens:
        raise ConfigError(f"cannot connect to {address}: write an address of the other machine")
    if is_open and not host.is_loopback:
        verb = "listen on" if listens else "connect to"
        raise ConfigError(f"will not {verb} {address}: {_WITHOUT_KEYS}")
