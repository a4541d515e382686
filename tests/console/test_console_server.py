"""The console without a browser."""

from __future__ import annotations

import socket
import sys
import threading
import time

import pytest
from console_driver import Session

from foretouch.console import Console, require_free_port
from foretouch.errors import LinkError, MissingExtraError, SettingError

pytest.importorskip("viser")

from visitors import come_in, open_socket


def test_a_port_in_use_is_refused_in_one_line_before_anything_starts():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        threads = threading.active_count()
        for attempt in (lambda: require_free_port(port), lambda: Console(port, lambda message: None)):
            with pytest.raises(LinkError, match=rf"^port {port} on 127\.0\.0\.1 is in use: choose another .*--port$"):
                attempt()
        assert threading.active_count() == threads


def test_a_port_is_free_again_after_close(capfd):
    console = Console(0, lambda message: None)
    port = int(console.base.rsplit(":", 1)[1])
    with pytest.raises(LinkError):
        require_free_port(port)
    console.close()
    require_free_port(port)
    assert capfd.readouterr().out == ""  # stdout belongs to the report


def test_no_such_port():
    with pytest.raises(SettingError, match="65535"):
        require_free_port(70_000)


def test_without_viser_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingExtraError, match=r"\[console\]"):
        Console(0, lambda message: None)


def test_a_browser_that_reads_nothing_stalls_nothing():
    """A client that connects and never reads: pictures keep their pace, and storing messages stays cheap."""
    published = []
    console = Console(0, published.append)
    session = Session(console.watch)
    asked, worst = [0], [0.0]

    def should_stop() -> bool:
        asked[0] += 1
        return time.monotonic() > end

    def watch(message):
        begin = time.perf_counter()
        console.watch(message)
        worst[0] = max(worst[0], time.perf_counter() - begin)

    session._watch = watch
    with open_socket(come_in(console.url), max_queue=1), session:
        end = time.monotonic() + 3.0
        console.run(should_stop)
    console.close()
    assert asked[0] > 45  # 90 where nothing else runs
    assert worst[0] < 0.1
    assert published == []
