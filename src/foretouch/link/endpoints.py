"""Zenoh endpoints such as ``tcp/127.0.0.1:7447``: their form, and which of them are allowed."""

from __future__ import annotations

import errno
import ipaddress
import re
import socket

from foretouch.errors import LinkError

__all__ = ["check_endpoint", "check_port_free", "free_endpoint"]

_FORM = re.compile(r"tcp/(?:\[(?P<six>[0-9a-fA-F:.]+)\]|(?P<host>[A-Za-z0-9.-]+)):(?P<port>\d{1,5})")


def _parse(endpoint: str) -> tuple[str, int]:
    match = _FORM.fullmatch(endpoint)
    port = int(match["port"]) if match else 0
    if match is None or not 0 < port < 65536:
        raise LinkError(f"endpoint {endpoint!r}: write it as tcp/HOST:PORT, for example tcp/127.0.0.1:7447")
    return match["six"] or match["host"], port


def check_endpoint(endpoint: str, *, insecure: bool = False) -> None:
    """Refuse an endpoint that is malformed, or off this machine without `insecure`.

    Raises:
        LinkError: What is wrong and what to do.
    """
    host, _ = _parse(endpoint)
    if insecure or host == "localhost":
        return
    try:
        loopback = ipaddress.ip_address(host).is_loopback
    except ValueError:
        loopback = False  # a name may resolve to anything
    if not loopback:
        raise LinkError(
            f"endpoint {endpoint!r} is off this machine and nothing there is encrypted or checked: "
            "use a loopback address, or add --insecure on a network that you trust"
        )


def check_port_free(endpoint: str) -> None:
    """Refuse to listen where somebody already does.

    Raises:
        LinkError: The port is in use, or the address is not this machine's.
    """
    host, port = _parse(endpoint)
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise LinkError(f"port {port} on {host} is in use: choose another one, or end what uses it") from None
        raise LinkError(f"cannot listen on {endpoint}: {error.strerror or error}") from None


def free_endpoint() -> str:
    """A loopback endpoint whose port nobody uses at this moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
