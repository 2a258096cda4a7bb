"""The two ends of the link to another machine: what the section ``remote`` makes of each of them.

What is wrong with the section on any machine (:func:`check_section`) is told apart from what this
machine lacks (:func:`check_here`): a key file, an address, a free port.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

from forcebound.errors import ConfigError
from forcebound.network import keys
from forcebound.network.addresses import Host, check_free, numeric_address, resolve
from forcebound.network.keys import KeyPair

DEFAULT_PORT = 7410  # queries; replies use the next one
Role = Literal["graph", "environment"]
T = TypeVar("T")

_WITHOUT_KEYS = (
    "without keys a link stays on this machine. Make a key pair on each machine (forcebound keys "
    "new NAME) and name them under graph_key and environment_keys; or write insecure: true, if "
    "everybody on that network may feed forces to the hand"
)


@dataclass(frozen=True)
class RemoteEnd:
    """One end of the link.

    Attributes:
        role: ``"graph"`` sends queries, ``"environment"`` replies.
        listens: Whether this end listens.
        address: Of the end that listens: IPv4, IPv6 in brackets, or a name.
        port: Of the queries; replies use the next one.
        key: Our own pair; None: no keys.
        peers: Who may be at the other end: name by public key. One, if we connect.
        insecure: Whether a link without keys may leave this machine.

    Raises:
        ConfigError: If that does not fit together.
    """

    role: Role
    listens: bool
    address: str
    port: int = DEFAULT_PORT
    key: KeyPair | None = None
    peers: Mapping[str, str] = field(default_factory=dict)
    insecure: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.port <= 65534:
            raise ConfigError(
                f"port must be 1 to 65534 (replies use the next one), got {self.port}"
            )
        if self.insecure and (self.key is not None or self.peers):
            raise ConfigError("insecure: true means no keys: name keys, or be insecure, not both")
        if (self.key is None) != (not self.peers):
            missing = "our own key pair" if self.key is None else "the key of the other end"
            raise ConfigError(f"keys are used by both ends or by none: {missing} is missing")
        if not self.listens and len(self.peers) > 1:
            raise ConfigError(
                f"the end that connects can expect only one key there, got {len(self.peers)}: "
                f"{', '.join(self.peers.values())}; let the graph listen if several may serve it"
            )


def end_of(
    role: Role,
    listens: Role,
    address: str,
    port: int = DEFAULT_PORT,
    graph_key: str | None = None,
    environment_keys: Sequence[str] = (),
    insecure: bool = False,
    folder: Path | None = None,
) -> RemoteEnd:
    """Return this machine's end for the section ``remote`` of a launch file, with its keys read.

    Args:
        role: Which end this process is.
        listens: Which end listens.
        address: Of the end that listens.
        port: Of the queries.
        graph_key: The graph's key, by name or as a public key.
        environment_keys: The keys of the environments that may serve it, likewise. The one whose
            secret is on this machine is that of this environment.
        insecure: Whether a link without keys may leave this machine.
        folder: Where keys are; the key folder by default.

    Raises:
        ConfigError: If a key is missing or unsafe, or the parts do not fit together.
    """
    check_section(listens, address, graph_key, environment_keys, insecure)
    pair: KeyPair | None = None
    peers: dict[str, str] = {}
    if graph_key is not None:
        pair, peers = _keys_of(role, graph_key, environment_keys, folder)
    return RemoteEnd(role, role == listens, address, port, pair, peers, insecure)


def check_section(
    listens: Role,
    address: str,
    graph_key: str | None,
    environment_keys: Sequence[str],
    insecure: bool,
) -> None:
    """Check what a section ``remote`` says, as far as that can be seen on any machine.

    Each message begins with the name of what is wrong.

    Args:
        listens: As for :func:`end_of`.
        address: Likewise.
        graph_key: Likewise.
        environment_keys: Likewise.
        insecure: Likewise.

    Raises:
        ConfigError: If a key or the address cannot be one, or they do not fit together.
    """
    both = (
        "keys are used by both ends or by none; make a pair on each machine with forcebound keys "
        "new NAME"
    )
    if environment_keys and graph_key is None:
        raise ConfigError(f"graph_key is missing beside environment_keys: {both}")
    if graph_key is not None and not environment_keys:
        raise ConfigError(f"environment_keys is missing or empty beside graph_key: {both}")
    if insecure and graph_key is not None:
        raise ConfigError("insecure: true means no keys: name keys, or be insecure, not both")
    if len(set(environment_keys)) < len(environment_keys):
        raise ConfigError(f"environment_keys names a key twice: {', '.join(environment_keys)}")
    if listens == "environment" and len(environment_keys) > 1:
        raise ConfigError(
            f"environment_keys has {len(environment_keys)} keys, and a graph that connects can "
            "expect only one; let the graph listen if several may serve it"
        )
    number = numeric_address(address)
    if number is not None and not number.is_loopback and graph_key is None and not insecure:
        raise ConfigError(f"address {address} is on a network, and {_WITHOUT_KEYS}")


def check_here(
    role: Role,
    listens: Role,
    address: str,
    port: int = DEFAULT_PORT,
    graph_key: str | None = None,
    environment_keys: Sequence[str] = (),
    insecure: bool = False,
    folder: Path | None = None,
) -> None:
    """Check what an end needs of this machine: keys, the address, and free ports if it listens.

    Args: as for :func:`end_of`.

    Raises:
        ConfigError: If anything is missing; it tells all that is.
    """
    check_section(listens, address, graph_key, environment_keys, insecure)
    problems: list[str] = []
    if graph_key is not None:
        _noting(problems, "", _keys_of, role, graph_key, environment_keys, folder)
    host = _noting(problems, "remote.address: ", resolve, address)
    if host is not None:
        is_open = graph_key is None and not insecure
        before = len(problems)
        _noting(problems, "", refuse_exposure, host, address, role == listens, is_open)
        if role == listens and len(problems) == before:
            _noting(problems, "remote.address: ", check_free, host, 0)
        for place in (port, port + 1) if role == listens and len(problems) == before else ():
            _noting(problems, "remote.port: ", check_free, host, place)
    if problems:
        raise ConfigError("\n".join(problems))


def _own_environment(environment_keys: Sequence[str], folder: Path | None) -> str:
    """Return which of the environments this machine is."""
    ours = [key for key in environment_keys if keys.has_secret(key, folder)]
    if len(ours) > 1:
        raise ConfigError(
            f"this machine holds the secrets of several environment_keys ({', '.join(ours)}): "
            "leave only its own one in its launch file"
        )
    # Without a secret, key_pair says for which file it looked.
    return ours[0] if ours else environment_keys[0]


def _keys_of(
    role: Role, graph_key: str, environment_keys: Sequence[str], folder: Path | None
) -> tuple[KeyPair, dict[str, str]]:
    """Return our own pair, and the other end's names by public key."""
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
    """Return what is asked for; None, with a problem noted, if that fails."""
    try:
        return do(*args)
    except ConfigError as error:
        problems.append(f"{where}{error}")
        return None


def refuse_exposure(host: Host, address: str, listens: bool, is_open: bool) -> None:
    """Refuse to connect to no address in particular, or without keys to another machine."""
    if host.is_wildcard and not listens:
        raise ConfigError(f"cannot connect to {address}: write an address of the other machine")
    if is_open and not host.is_loopback:
        verb = "listen on" if listens else "connect to"
        raise ConfigError(f"will not {verb} {address}: {_WITHOUT_KEYS}")
