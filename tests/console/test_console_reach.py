"""A real browser: let in by the address, kept out without it; it says by itself when nothing reaches the robot."""

from __future__ import annotations

import contextlib
import http.server
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import pytest
from console_driver import CHROMIUM_ARGUMENTS, Session, chromium, drawn, wait_until_shown

pytest.importorskip("viser")
pytest.importorskip("playwright")

from visitors import Printed, page_of

from foretouch.console import Console
from foretouch.console.gate.page import LOST
from foretouch.console.panels.stop import READY
from foretouch.console.sentences import NOBODY_YET
from foretouch.link import free_endpoint
from foretouch.messages import EmergencyStop, Handle

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(chromium() is None, reason="no Chromium: install it or set FORETOUCH_BROWSER"),
]

PROMISED, SLACK = 1.0, 5.0
"""A page says within so long that it reaches nobody [s]; and what a busy machine is granted."""


class Inside(NamedTuple):
    """A console that draws, its session, and the page of a browser that has come in."""

    console: Console
    session: Session
    page: Any


@pytest.fixture(scope="module")
def inside() -> Iterator[Inside]:
    from playwright.sync_api import sync_playwright

    rules = "--host-resolver-rules=MAP evil.test 127.0.0.1"
    with drawn() as (console, session), session, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=[*CHROMIUM_ARGUMENTS, rules])
        page = browser.new_context().new_page()
        page.goto(console.url)
        wait_until_shown(page)
        yield Inside(console, session, page)
        browser.close()


def until(locator: Any, seconds: float, state: str = "visible") -> float:
    """How long it takes until something is shown [s]."""
    begin = time.monotonic()
    locator.wait_for(state=state, timeout=1000 * seconds)
    return time.monotonic() - begin


def opacity(locator: Any) -> float:
    return float(locator.evaluate("element => getComputedStyle(element).opacity"))


class _Elsewhere(http.server.BaseHTTPRequestHandler):
    """A harmless page of another server."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<h1>elsewhere</h1>")

    def log_message(self, *_: Any) -> None:
        pass


@contextlib.contextmanager
def elsewhere() -> Iterator[int]:
    """A server of somebody else; its port."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Elsewhere) as server:
        serving = threading.Thread(target=server.serve_forever)
        serving.start()
        try:
            yield server.server_address[1]
        finally:
            server.shutdown()
            serving.join()


CONNECT = """async address => await new Promise(done => {
    const socket = new WebSocket(address, ["viser-v" + "VERSION"]);
    socket.onopen = () => done("open"); socket.onclose = () => done("refused"); socket.onerror = () => done("refused");
})"""


@pytest.mark.long  # test_console_gate refuses their requests without a browser
def test_pages_of_other_origins_are_refused_in_the_browser_that_has_come_in(inside: Inside) -> None:
    import viser
    from playwright.sync_api import Error

    console, session, honest = inside
    attempt = CONNECT.replace("VERSION", viser.__version__)
    home = honest.url.partition("?")[0].rstrip("/")
    assert honest.evaluate("document.cookie") == ""  # no script reads it
    address = home.replace("http", "ws")
    assert honest.evaluate(attempt, address) == "open"
    with elsewhere() as port:
        other = honest.context.new_page()
        for origin in (f"http://evil.test:{port}", f"http://127.0.0.1:{port}", f"http://localhost:{port}"):
            other.goto(origin)
            assert other.evaluate(attempt, address) == "refused", origin
            assert other.evaluate(attempt, address.rpartition("/")[0]) == "refused", origin
        own = console.base.rpartition(":")[2]
        for rebound in (f"http://evil.test:{own}", f"http://evil.test:{own}{home.removeprefix(console.base)}/"):
            assert other.goto(rebound).status == 403
            assert other.evaluate(attempt, rebound.replace("http", "ws").rstrip("/")) == "refused"
        frame = f"const one = document.createElement('iframe'); one.src = '{home}/'; document.body.append(one)"
        other.goto(f"http://127.0.0.1:{port}")
        other.evaluate(frame)
        other.wait_for_timeout(500)
        with contextlib.suppress(Error):
            assert "foretouch" not in other.frames[-1].content()
        other.close()
    stranger = honest.context.browser.new_context()
    assert stranger.new_page().goto(f"{home}/").status == 403
    stranger.close()
    assert session.of(EmergencyStop) == session.of(Handle) == []


@pytest.mark.long
def test_after_an_attack_on_the_button_a_click_still_asks_and_a_robot_that_does_not_answer_is_told(
    inside: Inside, monkeypatch: pytest.MonkeyPatch
) -> None:
    console, session, page = inside
    with page_of(console.url) as attacker:
        button = attacker.control("GuiButtonMessage", "EMERGENCY")
        for updates in ({"update_cb": []}, {"props": {}}, {"removed": True}, {"visible": False}):
            attacker.update(button, **updates)
        attacker.hear(0.5)
    monkeypatch.setattr(session, "_watch", lambda message: None)  # neither side is heard any more
    assert until(page.get_by_text("Neither side has been heard for"), PROMISED * SLACK) < PROMISED * SLACK
    page.get_by_role("button", name=READY).click()
    page.get_by_role("button", name="Stopping the robot").wait_for(timeout=10_000)
    page.wait_for_timeout(300)
    assert len(session.of(EmergencyStop)) > 2
    assert console.trouble == ""


@pytest.mark.long
def test_a_page_says_by_itself_that_the_console_does_not_answer_or_is_gone(inside: Inside) -> None:
    """The console stands still (as when a tunnel stalls), goes on, and is killed. The last: the page goes there."""
    command = [sys.executable, "-m", "foretouch", "console", "--listen", free_endpoint(), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as console:
        try:
            page = inside.page
            page.goto(Printed(console).address())
            page.get_by_text(NOBODY_YET).wait_for()
            lost, button = page.get_by_text(LOST), page.get_by_role("button", name=READY)
            lost.wait_for(state="hidden", timeout=30_000)
            assert opacity(button) == 1.0
            console.send_signal(signal.SIGSTOP)
            assert until(lost, PROMISED * SLACK) < PROMISED * SLACK
            assert opacity(button) == 0.0  # what could not stop the robot does not look as if it could
            console.send_signal(signal.SIGCONT)
            lost.wait_for(state="hidden", timeout=30_000)
            assert opacity(button) == 1.0
            console.kill()
            until(lost, PROMISED * SLACK)
            assert page.locator("#foretouch-lost").get_by_text("stop the robot at its own machine").is_visible()
        finally:
            console.kill()
