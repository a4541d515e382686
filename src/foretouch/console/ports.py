"""Ports of this machine."""

from __future__ import annotations

import errno
import socket

from foretouch.errors import LinkError, SettingError

__all__ = ["free_port", "require_free_port"]


def require_free_port(port: int, host: str = "127.0.0.1") -> None:
    """Raise `LinkError` unless a server could listen there now.

    Raises:
        LinkError: The port is in use, or this machine does not let us have it.
        SettingError: No such port.
    """
    if not 0 <= port <= 65535:
        raise SettingError("port", port, "must be 0 to 65535")
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            what = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be used ({error.strerror})"
            raise LinkError(f"port {port} on {host} {what}: choose another with --port") from None


def free_port(host: str) -> int:
    """A port that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])
