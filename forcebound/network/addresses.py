"""Which address a launch file means, and whether it stays on this machine."""

import ipaddress
import socket
from dataclasses import dataclass

from forcebound.errors import ConfigError


@dataclass(frozen=True)
class Host:
    """A resolved address.

    Attributes:
        numeric: As ZeroMQ writes it: ``192.168.1.20`` or ``[::1]``.
        is_loopback: Whether it cannot be reached from another machine.
        is_wildcard: Whether it stands for all addresses of this machine.
    """

    numeric: str
    is_loopback: bool
    is_wildcard: bool


def resolve(address: str) -> Host:
    """Return the first address that a name or a numeric address means.

    Resolved once, before anything starts: libzmq would look a name up again at every attempt to
    connect, in the thread that serves all sockets of the process.

    Args:
        address: IPv4, IPv6 with or without brackets and zone (``[fe80::1%eth0]``), or a name.

    Raises:
        ConfigError: If there is no such name.
    """
    bare = address.removeprefix("[").removesuffix("]") if address.startswith("[") else address
    if not bare or any(c in bare for c in " /*"):
        raise ConfigError(
            f"{address!r} is no address: write IPv4 (192.168.1.20), IPv6 ([fd00::20]) or a name"
        )
    try:
        found = socket.getaddrinfo(bare, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise ConfigError(
            f"cannot find the address {address!r}: {getattr(error, 'strerror', None) or error}; "
            "check the spelling (IPv6: [fd00::20]), /etc/hosts and the name server, or write the "
            "number"
        ) from None
    family, _, _, _, place = found[0]
    numeric = str(place[0])
    zone = ""
    if family == socket.AF_INET6 and len(place) == 4 and place[3]:
        numeric, zone = numeric.partition("%")[0], f"%{socket.if_indextoname(int(place[3]))}"
    ip = ipaddress.ip_address(numeric)
    text = f"[{numeric}{zone}]" if family == socket.AF_INET6 else numeric
    return Host(text, ip.is_loopback, ip.is_unspecified)
