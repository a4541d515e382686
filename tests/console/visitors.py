"""Who comes to a console without a browser: with or without what lets one in, and what it says there."""

from __future__ import annotations

import contextlib
import http.client
import re
import subprocess
import threading
import time
from collections.abc import Iterator
from typing import IO, Any, NamedTuple
from urllib.parse import urlsplit

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, -5.0, 1.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 10.0,
    "image_height": 10,
    "image_width": 10,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
"""Without it the viewer counts nobody as there."""


class Reply(NamedTuple):
    """What came of a request: status, headers, text."""

    status: int
    headers: dict[str, str]
    text: str


class Visitor(NamedTuple):
    """Who has come in: where, to which page, with which cookie."""

    address: str
    path: str
    cookie: str


def ask(address: str, target: str, **headers: str) -> Reply:
    """Ask a server for a page.

    Args:
        address: Such as 127.0.0.1:8080.
        target: Path and query.
        headers: ``Host`` is the address unless it is named here; an underscore stands for a hyphen.
    """
    connection = http.client.HTTPConnection(address, timeout=5)
    try:
        connection.putrequest("GET", target, skip_host="Host" in headers, skip_accept_encoding=True)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        response = connection.getresponse()
        text = response.read().decode(errors="replace")
        return Reply(response.status, {name.lower(): value for name, value in response.getheaders()}, text)
    finally:
        connection.close()


def come_in(url: str) -> Visitor:
    """Use an address as a browser would."""
    parts = urlsplit(url)
    reply = ask(parts.netloc, f"{parts.path}?{parts.query}")
    assert reply.status == 303, reply
    return Visitor(parts.netloc, reply.headers["location"].rstrip("/"), reply.headers["set-cookie"].partition(";")[0])


def open_socket(visitor: Visitor, **changes: Any) -> ClientConnection:
    """Connect as the visitor's page does; another origin, cookie, host or path where it is named."""
    headers = {"Cookie": changes.pop("cookie", visitor.cookie)}
    host = changes.pop("host", None)
    address = visitor.address.partition(":") if host else None
    uri = f"ws://{host or visitor.address}{changes.pop('path', visitor.path)}"
    where = {"host": address[0], "port": int(address[2])} if address else {}
    origin = changes.pop("origin", f"http://{host or visitor.address}")
    return connect(
        uri,
        origin=origin,
        additional_headers={name: value for name, value in headers.items() if value},
        subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
        compression=None,
        close_timeout=0.2,
        max_size=None,
        **{**where, **changes},
    )


class Page:
    """A page without a browser: it says what it is told to, and hears what the console shows.

    Args:
        socket: Its connection.
    """

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.shown: list[dict[str, Any]] = []
        self.say(CAMERA)

    def say(self, message: Any) -> None:
        """Say a message, or bytes as they are."""
        self.socket.send(message if isinstance(message, bytes | str) else msgspec.msgpack.encode(message))

    def update(self, uuid: str, /, **updates: Any) -> None:
        """Say that a control was operated."""
        self.say({"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates})

    def hear(self, seconds: float, until: str = "") -> list[dict[str, Any]]:
        """What is shown within a time [s], or until a message of this type has come."""
        end, begun = time.monotonic() + seconds, len(self.shown)
        while (left := end - time.monotonic()) > 0.0:
            try:
                self.shown += _decode(self.socket.recv(timeout=left))  # type: ignore[arg-type]
            except TimeoutError:
                break
            if any(message["type"] == until for message in self.shown[begun:]):
                break
        return self.shown[begun:]

    def control(self, kind: str, label: str) -> str:
        """The identifier of a control."""
        for message in self.shown:
            if message["type"] == kind and label in (message["props"].get("label") or ""):
                return str(message["uuid"])
        raise LookupError(f"no {kind} with {label!r}")


@contextlib.contextmanager
def page_of(url_or_visitor: str | Visitor) -> Iterator[Page]:
    """A page of a console, with all of its controls."""
    visitor = come_in(url_or_visitor) if isinstance(url_or_visitor, str) else url_or_visitor
    with open_socket(visitor) as socket:
        page = Page(socket)
        page.hear(5.0, until="ReplayDoneMessage")
        with contextlib.suppress(ConnectionClosed):
            yield page


def _decode(raw: bytes) -> list[dict[str, Any]]:
    """The messages of a frame: two lengths, then msgpack in zstd, then arrays."""
    size, packed = (int.from_bytes(raw[start : start + 8], "little") for start in (0, 8))
    inner = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + packed], max_output_size=size)
    messages: list[dict[str, Any]] = msgspec.msgpack.decode(inner)["messages"]
    return messages


class Printed:
    """What a command prints to people, and in it the newest address of its console.

    Args:
        process: With its stderr in a pipe, as text.
    """

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        self.lines: list[str] = []
        self._addresses: list[str] = []
        self._thread = threading.Thread(target=self._read, args=(process.stderr,), daemon=True)
        self._thread.start()

    def address(self, seconds: float = 60.0) -> str:
        """The address that lets the next browser in; each is given once."""
        self.wait(seconds)
        address = self._addresses[-1]
        self._addresses.clear()
        return address

    def wait(self, seconds: float = 60.0) -> None:
        """Wait until there is an address."""
        end = time.monotonic() + seconds
        while not self._addresses:
            assert time.monotonic() < end, f"no console came up:\n{''.join(self.lines)}"
            time.sleep(0.05)

    @property
    def text(self) -> str:
        """All of it; call it when the command has ended."""
        self._thread.join(10)
        return "".join(self.lines)

    def _read(self, stream: IO[str]) -> None:
        with contextlib.suppress(ValueError):  # who ends the command closes its pipe
            for line in stream:
                self.lines.append(line)
                if result := re.search(r"console: .*?(http://\S+)", line):
                    self._addresses.append(result[1])
