"""Admission to the console's page and to connections: decided from address, port and headers alone."""

from __future__ import annotations

import errno
import hmac
import re
import secrets
import socket
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple
from urllib.parse import parse_qsl

from foretouch.errors import LinkError, SettingError
from foretouch.link.access import bind_error


def require_free_port(port: int, host: str = "127.0.0.1") -> None:
    """Raise `LinkError` unless a server could listen there now.

    Raises:
        LinkError: The port is in use, or this machine does not let us have it.
        SettingError: No such port.
    """
    if not 0 <= port <= 65535:
        raise SettingError("port", port, "must be 0 to 65535")
    if (error := bind_error(host, port, socket.AF_INET)) is not None:
        what = "is in use" if error.errno == errno.EADDRINUSE else f"cannot be used ({error.strerror})"
        raise LinkError(f"port {port} on {host} {what}: choose another with --port")


LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
"""Names by which a browser reaches this machine, at any port: a tunnel may end at another than the console's."""
COOKIE = "foretouch"  # Name of the cookie of a browser that has come in
UNGUESSABLE = 32  # Bytes of chance in token and cookie
PATH_BYTES = 9  # Random bytes in the path, which is secret only to pages at other ports of this machine

_HOST = re.compile(r"(?P<name>\[[0-9a-f:.]+\]|[^\s:/?#@\[\]]+)(:\d{1,5})?")

REFUSED = (
    "This console opens by the address that it shows in its terminal, once: each time that one was used it shows "
    "another. A browser that has come in may load the page again. If the address was used and not by you, somebody "
    "else has come in: end the console.\n"
)
FOREIGN = "This console is not at this address: open the one that it shows in its terminal.\n"


class Answer(NamedTuple):
    """The response to a request: 200 lets it in, 303 sends it on to the page, 403 refuses, and `text` says why."""

    status: int
    text: str = ""
    headers: tuple[tuple[str, str], ...] = ()


class Entrance:
    """Admits a visitor with the address of the terminal, once, and the same browser again by its cookie.

    The page has a random path, to which the cookie is bound: browsers send the cookies of a host name to all of its
    ports, so that without the path any other server of this machine would receive the cookie.

    Args:
        base: Address of the console, such as ``http://127.0.0.1:8080``.
        say: Prints a line for people, with the next address whenever one was used.
        names: Names of hosts, beside `LOOPBACK`, under which the page may be asked for.
    """

    def __init__(self, base: str, say: Callable[[str], None] = lambda line: None, names: Sequence[str] = ()) -> None:
        self.base = base
        self.path = f"/{secrets.token_urlsafe(PATH_BYTES)}"
        self._say = say
        self._names = frozenset((*LOOPBACK, *(name.lower() for name in names)))
        self._cookie = secrets.token_urlsafe(UNGUESSABLE)
        self._token = secrets.token_urlsafe(UNGUESSABLE)

    @property
    def url(self) -> str:
        """The address that lets the next browser in."""
        return f"{self.base}{self.path}/?token={self._token}"

    def answer(self, target: str, headers: Any, *, socket: bool) -> Answer:
        """Decide about a request by its path and query; browsers name the origin where a socket is requested.

        The headers have ``get_all``, which lists the values of one.
        """
        host, origins = _only(headers.get_all("Host")).lower(), headers.get_all("Origin")
        name = _HOST.fullmatch(host)
        if name is None or name["name"] not in self._names:  # one that an attacker made point here is none of them
            return Answer(403, FOREIGN)
        if (socket or origins) and _only(origins).lower() not in (f"http://{host}", f"https://{host}"):
            return Answer(403, FOREIGN)
        path, _, query = target.partition("?")
        if path.rstrip("/") != self.path and not path.startswith(f"{self.path}/"):
            return Answer(403, REFUSED)
        pairs = (pair.strip().partition("=") for line in headers.get_all("Cookie") for pair in line.split(";"))
        known = any(name == COOKIE and _same(value, self._cookie) for name, _, value in pairs)
        if socket:
            return Answer(200) if known else Answer(403, REFUSED)
        if not known and not self._spend(query):
            return Answer(403, REFUSED)
        if known and not query:
            return Answer(200)
        cookie = f"{COOKIE}={self._cookie}; Path={self.path}; HttpOnly; SameSite=Strict"
        return Answer(303, headers=(("Location", f"{self.path}/"), ("Set-Cookie", cookie)))

    def _spend(self, query: str) -> bool:
        """Whether the token is there and was not used; it is used now, and the next one is printed."""
        if not any(name == "token" and _same(value, self._token) for name, value in parse_qsl(query)):
            return False
        self._token = secrets.token_urlsafe(UNGUESSABLE)
        self._say(f"console: a browser has come in with that address; for another one: {self.url}")
        return True


def _only(values: Sequence[str]) -> str:
    return values[0] if len(values) == 1 else ""


def _same(given: str, right: str) -> bool:
    """Whether they are equal, in a time that tells nothing of how far."""
    # A byte that is no text comes as half a surrogate: it stays what it was, and is no letter of the right one.
    return hmac.compare_digest(given.encode(errors="surrogatepass"), right.encode())
