"""The access rules of the page: looking at the graph, and changing it.

Any program on this machine, and any page in the user's browser, can reach a port on loopback. So
the address of the page has a token, and a request must come from the page itself: its ``Host`` must
be the server's own, and the ``Origin`` of a WebSocket must be that, too.

Source: RFC 6455, section 10.2 (Origin); on ``Host``: C. Jackson et al., Protecting browsers from
DNS rebinding attacks, ACM TWEB 3(1), 2009.
"""

import hmac
import ipaddress
import secrets
from dataclasses import dataclass, field

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


def _token() -> str:
    return secrets.token_urlsafe(16)


@dataclass(frozen=True)
class Access:
    """The rules of one server."""

    hosts: tuple[str, ...]  # by which a browser may call the server, without port
    port: int
    token: str = field(default_factory=_token)  # of the address that may change the graph
    watching: str = field(default_factory=_token)  # of the address that may only look

    @property
    def is_local(self) -> bool:
        """Whether this machine alone can call the server."""
        return self.hosts == LOOPBACK

    def permits_host(self, host: str | None) -> bool:
        """Return whether ``host``, of a request, is the server's own."""
        return host in {f"{name}:{self.port}" for name in self.hosts}

    def permits_origin(self, origin: str | None, host: str | None) -> bool:
        """Return whether a page of this server opens a WebSocket; a program may name no origin."""
        return self.permits_host(host) and origin in (None, f"http://{host}")

    def may_look(self, token: str) -> bool:
        """Return whether a token opens the page."""
        return self.may_change(token) or hmac.compare_digest(token.encode(), self.watching.encode())

    def may_change(self, token: str) -> bool:
        """Return whether a token may change the graph."""
        return hmac.compare_digest(token.encode(), self.token.encode())

    def address(self, token: str) -> str:
        """Return the address of the page with a token."""
        return f"http://{self.hosts[0]}:{self.port}/?token={token}"


def hosts_of(listen: str) -> tuple[str, ...]:
    """Return the names by which a server at an address is called: itself, or those of loopback."""
    try:
        address = ipaddress.ip_address(listen)
    except ValueError:
        return LOOPBACK if listen == "localhost" else (listen,)
    if address.is_loopback:
        return LOOPBACK
    return (f"[{listen}]" if address.version == 6 else listen,)
