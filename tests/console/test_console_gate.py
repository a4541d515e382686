"""The console's gate: who gets in, and what a page may say. A real viewer, real connections, no browser."""

from __future__ import annotations

import contextlib
import http.client
import os
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import msgspec
import pytest
from console_driver import Session, drawn, simulated_session, wait_for
from hostile import HARMFUL, HOSTS, ORIGINS, malformed

pytest.importorskip("viser")

import viser
from visitors import CAMERA, Page, ask, come_in, open_socket, page_of
from websockets.exceptions import ConnectionClosed, InvalidStatus

from foretouch.console import Console
from foretouch.console.gate import Entrance, make_gated_server
from foretouch.console.gate.page import ENDED_ATTRIBUTE, FARTHEST, permitted
from foretouch.console.gate.serving import BURST, MOST_BYTES, MOST_PAGES, RATE, Volume, Wait
from foretouch.console.panels.stop import LATCHED, READY
from foretouch.errors import LinkError
from foretouch.messages import VERSION, Choice, EmergencyStop, Hello, Settings, Status, Telemetry


class Bench(NamedTuple):
    """A console that draws a session, and what it says to people."""

    console: Console
    session: Session
    lines: list[str]
    folder: Path

    def pressed(self) -> int:
        return len(self.session.of(EmergencyStop))


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp("recordings")
    simulated_session(folder / "mine.mcap", seconds=1.0)
    lines: list[str] = []
    with drawn(recordings=folder, say=lines.append) as (console, session), session:
        yield Bench(console, session, lines, folder)
    assert console.trouble == ""


@contextlib.contextmanager
def refused() -> Iterator[None]:
    """The server refuses to connect, and says nothing of itself."""
    with pytest.raises(InvalidStatus) as caught:
        yield
    assert caught.value.response.status_code == 403
    assert b"viser" not in (caught.value.response.body or b"").lower()


# --- who gets in ------------------------------------------------------------------------------------------------------


def test_an_address_lets_one_browser_in_and_the_terminal_shows_the_next(bench: Bench) -> None:
    url, before = bench.console.url, len(bench.lines)
    visitor = come_in(url)
    assert bench.console.url != url
    assert bench.lines[before:] == [
        f"console: a browser has come in with that address; for another one: {bench.console.url}"
    ]
    target = url.removeprefix(f"http://{visitor.address}")
    assert ask(visitor.address, target).status == 403  # somebody else
    again = ask(visitor.address, target, Cookie=visitor.cookie)  # the same browser
    assert (again.status, again.headers["location"]) == (303, f"{visitor.path}/")
    assert ask(visitor.address, f"{visitor.path}/", Cookie=visitor.cookie).status == 200
    assert len(bench.lines) == before + 1
    assert come_in(bench.console.url).cookie == visitor.cookie


def test_the_cookie_goes_to_no_script_no_other_site_and_no_other_port(bench: Bench) -> None:
    url = bench.console.url
    visitor = come_in(url)
    target = url.removeprefix(f"http://{visitor.address}")
    cookie = ask(visitor.address, target, Cookie=visitor.cookie).headers["set-cookie"]
    assert cookie.split("; ")[1:] == [f"Path={visitor.path}", "HttpOnly", "SameSite=Strict"]
    assert len(visitor.path) > 10
    page = ask(visitor.address, f"{visitor.path}/", Cookie=visitor.cookie)
    assert page.headers["x-frame-options"] == "DENY"
    assert "frame-ancestors 'none'" in page.headers["content-security-policy"]
    assert page.headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize("target", ["/", "/?token=", "/?token=guessed", "/index.html", "{path}", "{path}/?token=x"])
def test_without_token_and_cookie_nothing_is_shown(bench: Bench, target: str) -> None:
    visitor = come_in(bench.console.url)
    target = target.format(path=visitor.path)
    for cookie in ("", "foretouch=", "foretouch=guessed", f"other={visitor.cookie.partition('=')[2]}"):
        reply = ask(visitor.address, target, **({"Cookie": cookie} if cookie else {}))
        assert reply.status == 403
        assert "shows in its terminal" in reply.text
        assert "<html" not in reply.text
    with refused():
        open_socket(visitor, cookie="", path=target.partition("?")[0])


@pytest.mark.parametrize("host", HOSTS)
def test_a_name_that_was_made_to_point_here_is_refused_with_token_and_cookie(bench: Bench, host: str) -> None:
    """DNS rebinding: a page's own name resolves to this machine."""
    visitor = come_in(bench.console.url)
    host = host.format(port=visitor.address.partition(":")[2])
    assert ask(visitor.address, f"{visitor.path}/", Host=host, Cookie=visitor.cookie).status == 403
    before = bench.console.url
    assert ask(visitor.address, before.removeprefix(f"http://{visitor.address}"), Host=host).status == 403
    assert bench.console.url == before  # and no token is spent on it
    if host:
        with pytest.raises(InvalidStatus, match="403"):
            raw_socket(visitor.address, visitor.path, Host=host, Origin=f"http://{host}", Cookie=visitor.cookie)


def raw_socket(address: str, path: str, **headers: str) -> None:
    """Ask to connect with these headers; raises `InvalidStatus` where it is refused."""
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    reply = ask(
        address,
        path,
        **headers,
        Upgrade="websocket",
        Connection="Upgrade",
        Sec_WebSocket_Key="AAAAAAAAAAAAAAAAAAAAAA==",
        Sec_WebSocket_Version="13",
        Sec_WebSocket_Protocol=f"viser-v{viser.__version__}",
    )
    raise InvalidStatus(Response(reply.status, "", Headers(), reply.text.encode()))


@pytest.mark.parametrize("origin", ORIGINS)
def test_a_page_of_another_origin_does_not_connect_though_the_browser_adds_the_cookie(
    bench: Bench, origin: str | None
) -> None:
    visitor = come_in(bench.console.url)
    with refused():
        open_socket(visitor, origin=origin and origin.format(port=visitor.address.partition(":")[2]))


@pytest.mark.parametrize("host", ["localhost:{port}", "127.0.0.1:9000", "[::1]:{port}", "LOCALHOST:9000"])
def test_this_machine_s_names_do_at_any_port_for_a_tunnel_has_its_own(bench: Bench, host: str) -> None:
    visitor = come_in(bench.console.url)
    host = host.format(port=visitor.address.partition(":")[2])
    assert ask(visitor.address, f"{visitor.path}/", Host=host, Cookie=visitor.cookie).status == 200
    with pytest.raises(InvalidStatus, match="101"):
        raw_socket(visitor.address, visitor.path, Host=host, Origin=f"http://{host.lower()}", Cookie=visitor.cookie)


def test_another_name_is_let_in_where_the_console_was_told_of_it() -> None:
    entrance = Entrance("http://127.0.0.1:8080", names=("Robot.lab",))

    class Headers(dict[str, list[str]]):
        def get_all(self, key: str, /) -> list[str]:
            return self.get(key, [])

    def status(host: str, origin: str) -> int:
        token = entrance.url.removeprefix("http://127.0.0.1:8080")
        return entrance.answer(token, Headers(Host=[host], Origin=[origin]), socket=False).status

    assert status("robot.lab", "https://robot.lab") == 303
    assert status("robot.lab:9000", "http://robot.lab:9000") == 303
    assert status("other.lab", "http://other.lab") == 403
    assert status("robot.lab", "http://other.lab") == 403
    assert entrance.answer(entrance.path, Headers(Host=["robot.lab", "robot.lab"]), socket=False).status == 403


def test_so_many_pages_and_no_more(bench: Bench) -> None:
    visitor = come_in(bench.console.url)
    with contextlib.ExitStack() as stack:
        for _ in range(MOST_PAGES):
            stack.enter_context(open_socket(visitor))
        with pytest.raises(InvalidStatus, match="503"):
            open_socket(visitor)
    wait_for(lambda: connects(visitor))


def connects(visitor: Any) -> bool:
    try:
        open_socket(visitor).close()
    except InvalidStatus:
        return False
    return True


# --- what a page may say ----------------------------------------------------------------------------------------------


def test_no_message_takes_the_emergency_button_away_and_the_honest_click_stops(bench: Bench) -> None:
    with page_of(bench.console.url) as attacker:
        button = attacker.control("GuiButtonMessage", "EMERGENCY")
        for updates in HARMFUL:
            attacker.update(button, **updates)
        for value in (False, None, "", 0, [], {}):
            attacker.update(button, value=value)
        for kind in ("GuiRemoveMessage", "GuiCloseModalMessage", "ResetGuiMessage", "ShareUrlRequest"):
            attacker.say({"type": kind, "uuid": button})
        attacker.say({"type": "RunJavascriptMessage", "source": "1"})
        attacker.hear(0.5)
    assert bench.pressed() == 0
    assert bench.console.trouble == ""
    with page_of(bench.console.url) as honest:
        assert honest.control("GuiButtonMessage", READY) == button
        honest.update(button, value=True)
        wait_for(lambda: bench.pressed() > 0)
    finish_emergency(bench)


def finish_emergency(bench: Bench) -> None:
    """The robot says that it has stopped, and is released."""
    bench.session.status = Status.STOPPED
    wait_for(lambda: not bench.console._emergency.asking)
    bench.session.status = Status.FOLLOWING
    wait_for(lambda: bench.console._panel.alarm._button.label == READY)
    bench.session.published.clear()


def test_controls_take_values_of_their_own_alone(bench: Bench) -> None:
    with page_of(bench.console.url) as page:
        slider, material = page.control("GuiSliderMessage", "Delay there"), page.control("GuiDropdownMessage", "Mat")
        for value in (9.9, -0.1, float("nan"), float("inf"), "1", True, None, [1.0], 2**63):
            page.update(slider, value=value)
        for value in ("../../etc; rm", "", 3, None, ["bone"]):
            page.update(material, value=value)
        page.update("no such control", value=1.0)
        page.hear(0.3)
        assert bench.session.of(Settings) == []
        assert bench.session.of(Choice) == []
        page.update(slider, value=0.25)
        wait_for(lambda: [one.position_delay for one in bench.session.of(Settings)] == [0.25])
        page.update(material, value="bone")
        wait_for(lambda: [one.material for one in bench.session.of(Choice)] == ["bone"])
        hidden = page.control("GuiButtonMessage", "Back to live")  # disabled until a recording is looked at
        page.update(hidden, value=True)
    assert bench.console.trouble == ""


def test_malformed_messages_end_neither_the_page_s_connection_nor_the_console(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    with page_of(bench.console.url) as page:
        for raw in malformed(CAMERA):
            page.say(raw)
        assert page.hear(1.0)  # the pictures go on
        command = next(m["uuid"] for m in page.shown if m["type"] == "RegisterCommandMessage")
        page.say({"type": "CommandTriggerMessage", "uuid": command})
        wait_for(lambda: bench.pressed() > 0)
    finish_emergency(bench)
    assert bench.console.trouble == ""
    assert capfd.readouterr().err == ""


def test_of_what_is_permitted_only_the_listed_fields_go_on() -> None:
    raw = msgspec.msgpack.encode(CAMERA | {"excluded_self_client": 3, "more": "x" * 100})
    output = permitted(raw, lambda uuid: None)
    assert output is not None
    received = msgspec.msgpack.decode(output)
    assert received == {name: list(v) if isinstance(v, tuple) else v for name, v in CAMERA.items()}
    assert permitted(msgspec.msgpack.encode(CAMERA | {"near": 2 * FARTHEST}), lambda uuid: None) is None


def test_every_permitted_kind_is_one_of_the_viewer_s_with_its_fields() -> None:
    """A new version of the viewer that says them otherwise is noticed here."""
    import dataclasses

    from viser import _messages

    from foretouch.console.gate import page as room

    kinds = [room.Camera, room.Update, room.Command, room.Drag, room.GizmoStart, room.GizmoMove, room.GizmoEnd]
    for kind in kinds:
        config = kind.__struct_config__
        theirs = getattr(_messages, str(config.tag))
        assert {field.name for field in dataclasses.fields(theirs)} == set(kind.__struct_fields__), config.tag


# --- floods -----------------------------------------------------------------------------------------------------------


def test_an_oversized_frame_and_a_flood_of_frames_are_cut_off_and_the_others_do_not_notice(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    with page_of(bench.console.url) as honest:
        button = honest.control("GuiButtonMessage", READY)
        visitor = come_in(bench.console.url)
        with open_socket(visitor) as oversized, pytest.raises(ConnectionClosed):
            say_and_hear_the_end(Page(oversized), b"\x00" * (MOST_BYTES // 2))
        with open_socket(visitor) as flood, pytest.raises((ConnectionClosed, OSError)):
            pour_until_it_ends(flood, b"\x82\xfe\x3e\x80abcd" + bytes(16_000))  # a frame of 16,000 bytes
        with open_socket(visitor) as flood, contextlib.suppress(ConnectionClosed, OSError):
            pour_until_it_ends(flood, b"\x89\x80abcd" * 1000)  # pings without a word
        begin = time.monotonic()
        honest.update(button, value=True)
        wait_for(lambda: bench.pressed() > 0)
        assert time.monotonic() - begin < 1.0
    finish_emergency(bench)
    assert bench.console.trouble == ""
    assert len(caplog.records) < 10  # nor is the terminal filled


def say_and_hear_the_end(page: Page, raw: bytes) -> None:
    page.say(raw)
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        page.socket.recv(timeout=5)


def pour_until_it_ends(flood: Any, raw: bytes) -> None:
    flood.socket.settimeout(2.0)
    for _ in range(200):
        flood.socket.sendall(raw)
    end = time.monotonic() + 2.0
    while time.monotonic() < end:
        flood.recv(timeout=2)


def test_a_flood_of_messages_waits_where_it_comes_from(bench: Bench) -> None:
    before = resident()
    visitor = come_in(bench.console.url)
    with page_of(visitor) as honest, open_socket(visitor) as flood:
        button = honest.control("GuiButtonMessage", READY)
        end = threading.Event()

        def pour() -> None:
            raw = msgspec.msgpack.encode({"type": "CommandTriggerMessage", "uuid": "x" * 16})
            with contextlib.suppress(ConnectionClosed, OSError):
                while not end.is_set():
                    flood.send(raw)

        pouring = threading.Thread(target=pour)
        pouring.start()
        try:
            assert len(honest.hear(1.5)) > 5  # it still draws
            begin = time.monotonic()
            honest.update(button, value=True)
            wait_for(lambda: bench.pressed() > 0)
            assert time.monotonic() - begin < 1.0
        finally:
            end.set()
            flood.socket.shutdown(socket.SHUT_RDWR)
            pouring.join(10)
    finish_emergency(bench)
    assert resident() - before < 50e6


def resident() -> float:
    """Memory of this process [byte]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return float(pages * os.sysconf("SC_PAGE_SIZE"))


def test_the_bucket_and_the_volume() -> None:
    wait = Wait()
    first = [wait.next(10.0) for _ in range(int(BURST))]
    assert max(first) <= 1e-9
    assert wait.next(10.0) == pytest.approx(1.0 / RATE)
    assert sum(wait.next(10.0 + k / RATE) > 0.05 for k in range(1000)) == 0
    volume = Volume()
    assert not volume.too_much(5.0, MOST_BYTES)
    assert volume.too_much(5.9, 1)
    assert not volume.too_much(7.0, MOST_BYTES)


# --- recordings, and the viewer itself --------------------------------------------------------------------------------


def test_recordings_of_the_folder_alone_are_opened(bench: Bench, tmp_path: Path) -> None:
    secret = tmp_path / "secret.mcap"
    secret.write_bytes((bench.folder / "mine.mcap").read_bytes())
    (bench.folder / "link.mcap").symlink_to(secret)
    (bench.folder / "circle.mcap").symlink_to(bench.folder / "circle.mcap")
    os.mkfifo(bench.folder / "fifo.mcap")
    (bench.folder / "folder.mcap").mkdir()
    library = bench.console._library
    names = ("link.mcap", "fifo.mcap", "folder.mcap", "circle.mcap", str(secret), f"../{tmp_path.name}/secret.mcap")
    try:
        for name in (*names, "/etc/shadow", "/nonexistent/x", "/dev/zero", "", ".", "\0"):
            library.open(name)
            library.wait(5)
            assert not library.busy, name
            assert library.playback is None, name
            assert library.note == "This recording cannot be looked at: the recording: is none that is listed", name
        assert library.names() == ("mine.mcap",)
        library.open("mine.mcap")
        library.wait(20)
        assert library.playback is not None
    finally:
        library.close()
        for name in ("link.mcap", "fifo.mcap", "circle.mcap"):
            (bench.folder / name).unlink()
        (bench.folder / "folder.mcap").rmdir()


def test_a_viewer_that_cannot_be_put_behind_the_gate_is_not_left_running(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if a new version served in another way: the console says so, and nothing listens."""
    import types

    from viser.infra import _infra
    from websockets.asyncio import server

    past = types.SimpleNamespace(**vars(_infra.websockets))
    past.asyncio = types.SimpleNamespace(server=types.SimpleNamespace(serve=server.serve))
    monkeypatch.setattr(_infra, "websockets", past)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with pytest.raises(LinkError, match=r"gate does not know: install viser"):
        make_gated_server("127.0.0.1", port, Entrance(f"http://127.0.0.1:{port}"))
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0


@pytest.mark.parametrize("method", ["HEAD", "POST", "OPTIONS"])
def test_what_asks_for_no_page_gets_an_answer_and_prints_nothing(
    bench: Bench, method: str, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    """A link preview does, or a monitor."""
    where = urlsplit(bench.console.base)
    connection = http.client.HTTPConnection(where.netloc, timeout=5)
    try:
        connection.request(method, "/")
        reply = connection.getresponse()
        assert (reply.status, reply.getheader("Allow"), reply.read()) == (405, "GET", b"")
    finally:
        connection.close()
    assert ask(where.netloc, "/").status == 403  # the next is heard as ever
    assert caplog.text == ""
    assert capfd.readouterr().err == ""


def test_the_pages_of_a_session_that_has_ended_say_so_and_those_of_a_console_that_ends_alone_do_not() -> None:
    for ended in (True, False):
        console = Console(0, lambda message: None)
        with page_of(console.url) as page:
            closing = threading.Thread(target=console.close, kwargs={"ended": ended})
            closing.start()
            with contextlib.suppress(ConnectionClosed):
                for _ in range(100):
                    page.hear(0.05)
        closing.join()
        received = str(page.shown)
        assert (ENDED_ATTRIBUTE in received and "foretouch teleop" in received) == ended


def test_a_picture_that_cannot_be_drawn_leaves_the_emergency_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    with drawn() as (console, session), page_of(console.url) as page:
        monkeypatch.setattr(console, "_plot", lambda shown: 1 / 0)
        button = page.control("GuiButtonMessage", READY)
        wait_for(lambda: "division by zero" in str(page.hear(0.2)))
        page.update(button, value=True)
        wait_for(lambda: session.of(EmergencyStop))
    assert "division by zero" in console.trouble


def test_an_error_of_the_picture_hides_nothing_that_is_urgent(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stop stays as far as it is, other alerts stay, and a recording that cannot be shown is closed."""
    console = Console(0, lambda message: None)
    shown: list[tuple[str, tuple[str, ...]]] = []
    monkeypatch.setattr(console._panel.alarm, "show", lambda label, alerts: shown.append((label, alerts)))

    class Odd:
        name = "odd.mcap"

        def tick(self, now: float) -> None:
            raise IndexError("row 3 of 2")

    try:
        stopped = Telemetry(
            VERSION, 1, 1, 1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, False, 1, 1, 1, epoch=7, status=Status.STOPPED
        )
        console._watched.take(stopped, time.monotonic())
        console._watched.take(Hello.of("follower", 1, 0, {"contest": "CONTROL CONTESTED: by bob"}), time.monotonic())
        console._library.playback = Odd()  # type: ignore[assignment]
        rounds = iter((False, True))
        console.run(lambda: next(rounds))
        label, alerts = shown[-1]
        assert label == LATCHED
        assert alerts[0] == "CONTROL CONTESTED: by bob."
        assert alerts[-1] == "The picture stands still (IndexError: row 3 of 2); the stop works."
        assert console._library.playback is None
        assert "odd.mcap cannot be shown" in console._library.note
    finally:
        console.close()


def test_a_cookie_that_is_no_text_is_refused_as_any_wrong_one() -> None:
    entrance = Entrance("http://127.0.0.1:8080")

    class Asked:
        def get_all(self, key: str, /) -> list[str]:
            return {"Host": ["127.0.0.1:8080"], "Cookie": ["foretouch=\udcff"]}.get(key, [])

    assert entrance.answer(f"{entrance.path}/", Asked(), socket=False).status == 403
