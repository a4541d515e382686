"""The viewer's server behind the gate, and how much a page may send: what no person at a mouse reaches.

What is known here of the viewer's insides: that it serves with ``websockets.asyncio.server.serve`` and hands it a
``process_request``; that each page's messages are read with ``recv`` and are msgpack maps with a ``type``; and where it
keeps its controls by their identifiers. A viewer that does otherwise is not started: `make_gated_server` raises.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import io
import logging
import threading
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from foretouch.console.gate.entrance import Entrance
from foretouch.console.gate.page import LARGEST_MESSAGE, permitted, with_watch
from foretouch.errors import LinkError

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response


RATE, BURST = 250.0, 500.0
"""Messages per second accepted of one page in the long run, and at once after a pause: a mouse that drags causes fewer
than 100. Faster messages wait at their sender."""
MOST_BYTES = 262_144
"""A page that sends more within a second is cut off: it sends some 30 kB when a mouse drags. Frames without content
(pings, empty ones) cost some microseconds each and do not wait."""
READ_AT_ONCE = 8_192
"""Between two reads of one page the others have their turn [byte]: some 1,300 pings of 6 bytes, a few milliseconds."""
LARGEST_BACKLOG = 16_777_216  # A page that sends while more than this waits for it to be read is cut off [byte]
MOST_PAGES = 16  # Pages that may be open at once
MOST_CONNECTIONS = 200
"""Largest number of open connections, including those without a request yet; files and the session's connections need
some of the usual 1,024."""


class Wait:
    """Time that the next message of a page has to wait (a leaky bucket)."""

    _due = 0.0

    def next(self, now: float) -> float:
        """Count one message at a time [s]; how long it has to wait [s], not positive where it need not."""
        self._due = max(self._due, now - BURST / RATE) + 1.0 / RATE
        return self._due - now


class Volume:
    """Messages that a page has sent in the current second."""

    _since, _bytes = 0.0, 0

    def too_much(self, now: float, size: int) -> bool:
        """Count bytes that have come at a time [s], and whether they are too many."""
        if now - self._since > 1.0:
            self._since, self._bytes = now, 0
        self._bytes += size
        return self._bytes > MOST_BYTES


OPEN_TIMEOUT = 5.0  # Time in which a connection must send its request [s]
HEADERS = {
    # The page cannot be shown within another, nothing of its address leaves it, and it talks to its console alone.
    "Content-Security-Policy": "frame-ancestors 'none'; connect-src 'self' data: blob:",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
UNKNOWN_VIEWER = "viser {} serves in a way that the console's gate does not know: install viser 1.1.1"
BUSY = "Too many pages of this console are open: close one.\n"

NOT_ALLOWED = b"HTTP/1.1 405 Method Not Allowed\r\nAllow: GET\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
"""The answer to any request but GET, which is all that the server behind knows."""

_STARTING = threading.Lock()
_OF_STRANGERS = ("opening handshake failed", "connection rejected")  # Errors inside are still logged
_LOGGER = logging.getLogger("foretouch.console.gate")
_LOGGER.addFilter(lambda record: not record.getMessage().startswith(_OF_STRANGERS))


def make_gated_server(host: str, port: int, entrance: Entrance) -> Any:
    """Start the viewer's ``ViserServer`` with the gate in front of it.

    Raises:
        ImportError: viser is not installed.
        LinkError: The port was taken, or this version of the viewer cannot be put behind the gate.
    """
    import viser

    gate = _Gate(entrance, f"viser-v{viser.__version__}")
    # The viewer greets on stdout, which belongs to the report.
    with _serving_through(gate), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, verbose=False)
        controls: Any = getattr(server.gui, "_gui_input_handle_from_uuid", None)
        problem = "" if gate.stands and controls is not None else UNKNOWN_VIEWER.format(viser.__version__)
        if server.get_port() != port:  # the viewer would go on with the next port
            problem = f"port {port} on {host} is in use: choose another with --port"
        if problem:
            server.stop()
            raise LinkError(problem)
    gate.control = controls.get
    return server


class _Gate:
    """Checks every request and every message of a page; `stands` says whether the viewer serves through it."""

    def __init__(self, entrance: Entrance, protocol: str) -> None:
        self._entrance, self._protocol = entrance, protocol
        self._watched: tuple[bytes, bytes] = (b"", b"")
        self.stands = False
        self.control: Callable[[str], Any] = lambda uuid: None
        self.pages: set[Any] = set()
        self.connections: set[Any] = set()

    def process(
        self, serve: Callable[[Any, Any], Response | None], connection: ServerConnection, request: Request
    ) -> Response | None:
        """Answer a request, or let the viewer do so."""
        if not self.stands:  # the viewer, which waits until it serves, is ended in a moment
            return _respond(connection, 403, "")
        socket = any(value.lower() == "websocket" for value in request.headers.get_all("Upgrade"))
        answer = self._entrance.answer(request.path, request.headers, socket=socket)
        if answer.status != 200:
            return _respond(connection, answer.status, answer.text, dict(answer.headers))
        if socket:
            return self._connect(connection, request)
        path = request.path.removeprefix(self._entrance.path) or "/"
        request = dataclasses.replace(request, path=path)
        if "Accept-Encoding" in request.headers:  # the page, which is packed already, is added to
            del request.headers["Accept-Encoding"]
        response = serve(connection, request)
        return response if response is None else self._with_headers(response)

    def _connect(self, connection: ServerConnection, request: Request) -> Response | None:
        """Let a page connect, unless it is of another version or one too many."""
        named = ",".join(request.headers.get_all("Sec-WebSocket-Protocol")).replace(" ", "").split(",")
        if self._protocol not in named:
            return _respond(connection, 400, "Load the page again: this console is of another version.\n")
        if len(self.pages) >= MOST_PAGES:
            return _respond(connection, 503, BUSY)
        self.pages.add(connection)
        return None

    def _with_headers(self, response: Response) -> Response:
        if response.headers.get("Content-Type", "").startswith("text/html") and response.body:
            if self._watched[0] != response.body:
                self._watched = (bytes(response.body), with_watch(bytes(response.body)))
            response.body = self._watched[1]
            del response.headers["Content-Length"]
            response.headers["Content-Length"] = str(len(response.body))
        for name, value in HEADERS.items():
            response.headers[name] = value
        return response


def _respond(connection: ServerConnection, status: int, text: str, headers: dict[str, str] | None = None) -> Response:
    response = connection.respond(status, text)
    for name, value in (HEADERS | (headers or {})).items():
        response.headers[name] = value
    return response


@contextlib.contextmanager
def _serving_through(gate: _Gate) -> Iterator[None]:
    """While this lasts, a viewer that starts to serve does so through the gate."""
    from websockets.asyncio import server as module

    original: Any = module.serve

    def serve(handler: Any, host: Any, port: Any, **options: Any) -> Any:
        behind: Any = options.get("process_request")
        gate.stands = behind is not None
        options |= {
            "process_request": lambda connection, request: gate.process(behind, connection, request),
            "create_connection": _connection_type(gate),
            "max_size": LARGEST_MESSAGE,
            "open_timeout": OPEN_TIMEOUT,
            "logger": _LOGGER,
        }
        return original(handler, host, port, **options)

    with _STARTING:
        module.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            module.serve = original  # type: ignore[misc]


def _connection_type(gate: _Gate) -> type[ServerConnection]:
    """Connections of which the viewer hears only what is permitted, no faster and no more than a person causes."""
    from websockets.asyncio.server import ServerConnection

    class GatedConnection(ServerConnection):
        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            self._wait, self._volume = Wait(), Volume()
            self._first = True

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            transport.max_size = READ_AT_ONCE
            gate.connections.add(self)
            if len(gate.connections) > MOST_CONNECTIONS:
                transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            gate.connections.discard(self)
            gate.pages.discard(self)
            super().connection_lost(exc)

        def data_received(self, data: bytes) -> None:
            backlog = self.transport.get_write_buffer_size()
            if self._volume.too_much(self.loop.time(), len(data)) or backlog > LARGEST_BACKLOG:
                self.transport.abort()
            elif self._first and data[:3] != b"GET"[: len(data)]:  # a link preview, or a monitor
                self.transport.write(NOT_ALLOWED)
                self.transport.close()
            else:
                self._first = False
                super().data_received(data)

        def send_data(self) -> None:
            # In one piece: for a page that pings and is gone each single answer would fail, and be logged.
            writes = self.protocol.writes
            if len(writes) > 2:
                end = [part for part in writes[-1:] if not part]  # an empty part ends the stream
                self.protocol.writes = [b"".join(writes), *end]
            super().send_data()

        async def recv(self, decode: bool | None = None) -> Any:
            while True:
                raw = await super().recv(decode)
                wait = self._wait.next(self.loop.time())
                if wait > 0.0:
                    await asyncio.sleep(wait)
                if (message := permitted(raw, gate.control)) is not None:
                    return message

        def recv_streaming(self, decode: bool | None = None) -> Any:
            raise NotImplementedError("the gate hears whole messages alone")

    return GatedConnection
