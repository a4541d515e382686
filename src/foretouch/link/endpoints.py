"""Endpoints, ``tcp/HOST:PORT`` or ``tls/HOST:PORT``: their form, and which of them are allowed."""

from __future__ import annotations

import errno
import ipaddress
import re
import socket

from foretouch.errors import LinkError

__all__ = ["check_endpoint", "check_port_free", "free_endpoint", "is_encrypted", "is_exposed"]

_FORM = re.compile(r"(?P<kind>tcp|tls)/(?:\[(?P<six>[0-9a-fA-F:.]+)\]|(?P<host>[A-Za-z0-9.-]+)):(?P<port>\d{1,5})")


def _parse(endpoint: str) -> tuple[str, str, int]:
    match = _FORM.fullmatch(endpoint)
    port = int(match["port"]) if match else 0
    if match is None or not 0 < port < 65536:
        raise LinkError(
            f"endpoint {endpoint!r}: write it as tcp/HOST:PORT, for example tcp/127.0.0.1:7447, "
            "or as tls/HOST:PORT between machines"
        )
    return match["kind"], match["six"] or match["host"], port


def is_encrypted(endpoint: str) -> bool:
    """Whether what goes there is encrypted and both ends are checked.

    Raises:
        LinkError: The endpoint is malformed.
    """
    return _parse(endpoint)[0] == "tls"


def is_exposed(endpoint: str) -> bool:
    """Whether it is off this machine and neither encrypted nor checked.

    Raises:
        LinkError: The endpoint is malformed.
    """
    kind, host, _ = _parse(endpoint)
    if kind == "tls" or host == "localhost":
        return False
    try:
        return not ipaddress.ip_address(host).is_loopback
    except ValueError:
        return True  # a name may resolve to anything


def check_endpoint(endpoint: str, *, insecure: bool = False) -> None:
    """Refuse an endpoint that is malformed, or off this machine and not encrypted without `insecure`.

    Raises:
        LinkError: What is wrong and what to do.
    """
    if is_exposed(endpoint) and not insecure:
        raise LinkError(
            f"endpoint {endpoint!r} is off this machine and nothing there is encrypted or checked: "
            "write tls/HOST:PORT (its keys: foretouch keys init), or add --insecure on a network that you trust"
        )


def check_port_free(endpoint: str) -> None:
    """Refuse to listen where somebody already does.

    Raises:
        LinkError: The port is in use, or the address is not this machine's.
    """
    _, host, port = _parse(endpoint)
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise LinkError(f"port {port} on {host} is in use: choose another one, or end what uses it") from None
        raise LinkError(f"cannot listen on {endpoint}: {error.strerror or error}") from None


def free_endpoint(kind: str = "tcp") -> str:
    """A loopback endpoint whose port nobody uses at this moment.

    Args:
        kind: ``"tcp"`` or ``"tls"``.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"{kind}/127.0.0.1:{probe.getsockname()[1]}"
