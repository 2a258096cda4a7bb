"""Addresses of a launch file: resolved, on this machine or not, free or in use."""

import ipaddress
import re
import socket
from dataclasses import dataclass
from typing import TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import reason
from forcebound.network.sockets import ADVICE

IpAddress: TypeAlias = ipaddress.IPv4Address | ipaddress.IPv6Address

# Some networks have underscores. A name never ends in a number, as a mistyped 192.168.1.300 does.
_NAME = re.compile(r"([\w-]+\.)*(?!\d+\.?$)[\w-]+\.?")


@dataclass(frozen=True)
class Host:
    """A resolved address."""

    numeric: str  # as ZeroMQ writes it: 192.168.1.20 or [::1]
    is_loopback: bool  # it cannot be reached from another machine
    is_wildcard: bool  # it stands for all addresses of this machine


def numeric_address(address: str) -> IpAddress | None:
    """Return a numeric address; None for a name, which has to be looked up; else ConfigError.

    IPv6 may have brackets and a zone (``[fe80::1%eth0]``). Nothing is looked up.
    """
    bare = _bare(address)
    try:
        return ipaddress.ip_address(bare)
    except ValueError:
        if bare == address and _NAME.fullmatch(bare):
            return None
    raise ConfigError(
        f"{address!r} is not an address: write IPv4 (192.168.1.20), IPv6 ([fd00::20]) or a name, "
        "without tcp:// before it and without the port, which belongs under port:"
    )


def resolve(address: str) -> Host:
    """Return the first address of a name, or a numeric address itself.

    Resolved once, before anything starts: libzmq would look a name up again at every attempt to
    connect, in the thread that serves all sockets of the process.

    Raises:
        ConfigError: If the name cannot be found, or is not a valid address.
    """
    numeric_address(address)
    try:
        found = socket.getaddrinfo(_bare(address), None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:  # UnicodeError: a part of the name is too long
        raise ConfigError(
            f"cannot find the address {address!r}: {reason(error)}; check the spelling (IPv6: "
            "[fd00::20]), /etc/hosts and the name server, or write the number"
        ) from None
    numeric = socket.getnameinfo(found[0][4], socket.NI_NUMERICHOST | socket.NI_NUMERICSERV)[0]
    ip = ipaddress.ip_address(numeric)
    return Host(f"[{ip}]" if ip.version == 6 else str(ip), ip.is_loopback, ip.is_unspecified)


def check_free(host: Host, port: int) -> None:
    """Check that this machine can listen at an address and port.

    The port is bound, as libzmq does it, and given back; it never listens, so no peer connects.

    Raises:
        ConfigError: If the address is not this machine's, or the port is in use or not permitted.
    """
    bare = _bare(host.numeric)
    family, _, _, _, place = socket.getaddrinfo(bare, port, type=socket.SOCK_STREAM)[0]
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(place)
        except OSError as error:
            advice = ADVICE.get(error.errno or 0, error.strerror)
            raise ConfigError(f"cannot listen on {host.numeric} port {port}: {advice}") from None


def _bare(address: str) -> str:
    is_bracketed = address.startswith("[") and address.endswith("]") and ":" in address
    return address[1:-1] if is_bracketed else address
