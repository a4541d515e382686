"""Attacks on a console: a real process of it, real connections on loopback, a real browser where there is one.

Each line says what was tried, how often, and how often something got in: a page was shown, a connection opened, or
the console published a message to the session, ended, or opened a file that it should not. In the end the honest click
on the emergency stop has to arrive. It takes about half a minute; the exit code is 1 where anything got in.

Usage: `.venv/bin/python tests/attack/attack_console.py`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import logging
import os
import random
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "console"))  # who comes without a browser, and what enemies say

import msgspec  # noqa: E402
from hostile import HARMFUL, HOSTS, ORIGINS, malformed  # noqa: E402
from viser import _messages  # noqa: E402
from visitors import CAMERA, Page, Printed, Visitor, ask, come_in, open_socket, page_of  # noqa: E402
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus  # noqa: E402

from foretouch.link import ZenohLink, free_endpoint  # noqa: E402

SEED = 7
GUESSES, RANDOM_MESSAGES = 500, 1000
FLOOD = 4.0
"""Length of each flood [s]."""
STILL = 1.0
"""A page stands still to which nothing has come for so long [s]; else some 30 pictures a second do."""
MOST_GROWTH = 60e6
"""Of the console's memory by all of this together [byte]."""
PUBLISHED = ("handle", "settings", "choice", "stop", "emergency")
"""Channels on which a console says what a person did."""


@dataclasses.dataclass
class Tally:
    what: str
    tried: int = 0
    got_in: int = 0

    def count(self, got_in: bool) -> None:
        self.tried += 1
        self.got_in += got_in


class Target:
    def __init__(self, folder: Path) -> None:
        endpoint = free_endpoint()
        command = [sys.executable, "-m", "foretouch", "console", "--listen", endpoint, "--port", "0"]
        self.process = subprocess.Popen(
            [*command, "--recordings", str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        self.printed = Printed(self.process)
        self.visitor = come_in(self.printed.address())
        self._link = ZenohLink(connect=[endpoint], subscribe=PUBLISHED)
        time.sleep(1.0)

    def heard(self) -> list[Any]:
        return [message for channel in PUBLISHED for _, message in self._link.take(channel)]

    def memory(self) -> float:
        pages = int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return float(pages * os.sysconf("SC_PAGE_SIZE"))

    @property
    def alive(self) -> bool:
        if self.process.poll() is not None:
            return False
        with page_of(self.visitor) as page:
            return len(page.hear(0.5)) > 1

    def close(self) -> None:
        self._link.close()
        self.process.kill()
        self.process.wait()


def strangers(target: Target) -> Iterator[Tally]:
    visitor = target.visitor
    tally = Tally("page without token and cookie")
    own = (f"{visitor.path}/", f"{visitor.path}/?token=")
    for path in ("/", "/index.html", "/?token=", "/..%2f..%2fetc/passwd", *own):
        for host in (visitor.address, f"localhost:{_port(visitor)}", *_hosts(visitor)):
            tally.count(ask(visitor.address, path, Host=host).status != 403)
    yield tally
    tally = Tally("guessed tokens and cookies")
    for _ in range(GUESSES):
        guess = secrets.token_urlsafe(32)
        reply = ask(visitor.address, f"{visitor.path}/?token={guess}", Cookie=f"foretouch={guess}")
        tally.count(reply.status != 403)
    yield tally
    tally = Tally("names made to point here (rebinding), with cookie")
    for host in _hosts(visitor):
        tally.count(ask(visitor.address, f"{visitor.path}/", Host=host, Cookie=visitor.cookie).status != 403)
    yield tally
    tally = Tally("connections of other origins, with cookie")
    for origin in ORIGINS:
        tally.count(_opens(visitor, origin=origin and origin.format(port=_port(visitor))))
    yield tally
    tally = Tally("connections without cookie")
    for cookie in ("", "foretouch=", "foretouch=x"):
        for path in ("/", visitor.path, f"{visitor.path}/x"):
            tally.count(_opens(visitor, cookie=cookie, path=path))
    yield tally


def pages(target: Target) -> Iterator[Tally]:
    tally = Tally("properties of every control set by a page")
    with page_of(target.visitor) as page:
        controls = [message["uuid"] for message in page.shown if message["type"].startswith("Gui")]
        for number, uuid in enumerate(controls):
            for updates in HARMFUL:
                page.update(uuid, **updates)
                tally.count(False)
            if number % 10 == 9:
                page.hear(0.3)  # no faster than the gate hears
        page.hear(3.0)
    tally.got_in = len(target.heard())
    yield tally
    tally = Tally("malformed messages")
    with page_of(target.visitor) as page:
        for raw in malformed(CAMERA):
            page.say(raw)
            tally.count(False)
    tally.got_in = len(target.heard()) + (not target.alive)
    yield tally
    tally = Tally("random messages of every kind that the viewer has")
    generator = random.Random(SEED)
    kinds = [kind for kind in _messages.Message.get_subclasses() if kind.__name__ != "CommandTriggerMessage"]
    with page_of(target.visitor) as page:
        for number in range(RANDOM_MESSAGES):
            page.say(_random_message(generator, generator.choice(kinds), controls))
            tally.count(False)
            if number % 100 == 99:
                page.hear(0.4)
        page.hear(1.0)
    tally.got_in = len(target.heard()) + (not target.alive)
    yield tally


def recordings(target: Target, folder: Path) -> Iterator[Tally]:
    tally = Tally("recordings that are none of the folder")
    secret = folder.parent / "secret.mcap"
    secret.write_bytes(b"secret")
    (folder / "link.mcap").symlink_to(secret)
    os.mkfifo(folder / "fifo.mcap")
    names = ("link.mcap", "fifo.mcap", str(secret), "../secret.mcap", "/etc/shadow", "/dev/zero", "/nonexistent", "")
    with page_of(target.visitor) as page:
        listed = page.control("GuiDropdownMessage", "Recording")
        page.hear(2.5)  # the list is read again every two seconds
        for name in names:
            page.update(listed, value=name)
            output = str(page.hear(1.0))
            tally.count(
                "Reading" in output or "No such file" in output or "is not an MCAP" in output or "looked at:" in output
            )
    yield tally


def floods(target: Target) -> Iterator[Tally]:
    trigger = msgspec.msgpack.encode({"type": "CommandTriggerMessage", "uuid": "x" * 20})
    kinds: dict[str, Callable[[Page], None]] = {
        "messages": lambda page: page.say(trigger),
        "frames of 16 kB": lambda page: page.say(b"\0" * 16_000),
        "frames of 1 MB": lambda page: page.say(b"\0" * 1_000_000),
        "pings": lambda page: page.socket.socket.sendall(b"\x89\x80abcd" * 100),
    }
    for what, pour in kinds.items():
        tally = Tally(f"flood of {what}, {FLOOD:g} s: another page stood still for {STILL:g} s")
        with page_of(target.visitor) as honest:
            end = time.monotonic() + FLOOD
            while time.monotonic() < end:
                tally.tried += _pour(target.visitor, pour, min(end, time.monotonic() + 0.5))
                tally.got_in += _stands_still(honest)
        yield tally


def browser(target: Target) -> Iterator[Tally]:
    from console_driver import CHROMIUM_ARGUMENTS, chromium

    with contextlib.suppress(ImportError):
        from playwright.sync_api import sync_playwright
        from test_console_reach import CONNECT, elsewhere

        if chromium() is None:
            return
        import viser

        tally = Tally("pages of other origins in a real browser")
        attempt = CONNECT.replace("VERSION", viser.__version__)
        visitor, arguments = target.visitor, [*CHROMIUM_ARGUMENTS, "--host-resolver-rules=MAP evil.test 127.0.0.1"]
        with sync_playwright() as playwright, elsewhere() as port:
            running = playwright.chromium.launch(executable_path=chromium(), args=arguments)
            context = running.new_context()
            honest, page = context.new_page(), context.new_page()
            honest.goto(target.printed.address())
            for origin in (f"http://evil.test:{port}", f"http://127.0.0.1:{port}", f"http://localhost:{port}"):
                page.goto(origin)
                for address in (f"ws://{visitor.address}{visitor.path}", f"ws://{visitor.address}"):
                    tally.count(page.evaluate(attempt, address) == "open")
            for path in ("/", f"{visitor.path}/"):
                reply = page.goto(f"http://evil.test:{_port(visitor)}{path}")
                tally.count(reply is None or reply.status != 403)
            running.close()
        yield tally


def honest_stop(target: Target) -> Iterator[Tally]:
    from foretouch.console.panels.stop import READY

    target.heard()
    tally = Tally("the honest click on the emergency stop did not arrive", tried=1)
    with page_of(target.visitor) as page:
        page.update(page.control("GuiButtonMessage", READY), value=True)
        page.hear(1.0)
    tally.got_in = int(not any(type(message).__name__ == "EmergencyStop" for message in target.heard()))
    yield tally


def main() -> int:
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # of connections that were cut off, at this end
    done: list[Tally] = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "recordings"
        folder.mkdir()
        target = Target(folder)
        try:
            before = target.memory()
            attacks = (strangers(target), browser(target), pages(target), recordings(target, folder), floods(target))
            for tally in itertools.chain(*attacks, honest_stop(target)):
                done.append(tally)
                print(f"{tally.tried:6d} tried {tally.got_in:4d} got in   {tally.what}", flush=True)
            grown = target.memory() - before
            done.append(Tally("memory", 1, int(grown > MOST_GROWTH)))
            print(f"The console runs: {target.alive}; its memory grew by {grown / 1e6:.0f} MB.")
            done.append(Tally("alive", 1, int(not target.alive)))
        finally:
            target.close()
    return int(any(tally.got_in for tally in done))


def _port(visitor: Visitor) -> str:
    return visitor.address.partition(":")[2]


def _hosts(visitor: Visitor) -> list[str]:
    return [host.format(port=_port(visitor)) for host in HOSTS]


def _opens(visitor: Visitor, **changes: Any) -> bool:
    try:
        open_socket(visitor, **changes).close()
    except (InvalidStatus, InvalidMessage, ConnectionClosed, OSError):
        return False
    return True


def _pour(visitor: Visitor, pour: Callable[[Page], None], end: float) -> int:
    """Send until a moment, or until it is cut off; how many were sent."""
    sent = 0
    with contextlib.suppress(InvalidStatus, InvalidMessage, ConnectionClosed, OSError), open_socket(visitor) as socket:
        page = Page(socket)
        socket.socket.settimeout(0.5)
        while time.monotonic() < end:
            pour(page)
            sent += 1
    return sent


def _stands_still(page: Page) -> bool:
    end = time.monotonic() + STILL
    while time.monotonic() < end:
        if page.hear(0.1):
            return False
    return True


def _random_message(generator: random.Random, kind: type[Any], controls: list[str]) -> dict[str, Any]:
    """A message of the viewer with random fields; half of the time they name a control."""
    values = (None, True, -1, 2**63 - 1, 1e300, float("nan"), "", "x" * 300, [], [0.0] * 3, [0.0] * 4, {}, {"value": 1})
    fields = {field.name: generator.choice(values) for field in dataclasses.fields(kind)}
    if "uuid" in fields and generator.random() < 0.5:
        fields["uuid"] = generator.choice(controls)
    return {"type": kind.__name__, **fields}


if __name__ == "__main__":
    sys.exit(main())
