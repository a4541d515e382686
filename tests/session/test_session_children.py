"""Processes of a session as their supervisor hears them: real ones, that beat, fall silent, and do not end."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from foretouch.session.processes import children
from foretouch.session.processes.children import Child, end_session
from foretouch.session.runners.housekeeping import BEAT, COMPILING
from foretouch.session.runners.live import LEAVING
from foretouch.session.runners.news import HANGS_AFTER

BEATS = f"""
import os, time
for _ in range(COUNT):
    os.write(1, b"and" + {BEAT!r})
    time.sleep(0.1)
time.sleep(60)
"""
STAYS = "import signal, os, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nos.write(1, b'x')\ntime.sleep(60)\n"


@pytest.fixture
def begin() -> Iterator[Callable[..., Child]]:
    made: list[Child] = []

    def start(source: str, role: str = "leader") -> Child:
        process = subprocess.Popen([sys.executable, "-c", source], stdout=subprocess.PIPE)
        assert process.stdout is not None
        os.set_blocking(process.stdout.fileno(), False)
        made.append(Child(role, process))
        return made[-1]

    yield start
    for child in made:
        child.process.kill()
        child.process.communicate()


def listen(child: Child, until: Callable[[], object], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < end
        child.listen()
        time.sleep(0.02)


def test_a_side_that_beats_goes_on_and_one_that_falls_silent_hangs(
    begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(children, "PATIENCE", 1.0)
    child = begin(BEATS.replace("COUNT", "15"))
    assert child.begun is None
    listen(child, lambda: child.begun is not None)
    begun = time.monotonic()
    listen(child, lambda: child.silence > 0.5)
    assert time.monotonic() - begun > 1.2  # it beat for so long
    assert child.hangs() == ""
    listen(child, child.hangs)
    assert child.hangs() == "hangs: nothing has come of it for 1 s"
    child.process.kill()
    child.process.wait()
    assert child.hangs() == ""  # one that has ended is judged by its exit code


def test_one_that_was_stopped_by_a_signal_is_not_silent(begin: Callable[..., Child]) -> None:
    child = begin(BEATS.replace("COUNT", "3"))
    listen(child, lambda: child.begun is not None)
    child.process.send_signal(signal.SIGSTOP)
    time.sleep(0.2)
    for _ in range(50):
        child.listen()
        assert child.silence == 0.0
        time.sleep(0.02)
    child.process.send_signal(signal.SIGCONT)
    listen(child, lambda: child.silence > 0.2)


def test_a_supervisor_that_was_stopped_itself_does_not_count_that_time(
    begin: Callable[..., Child],
) -> None:
    child = begin(BEATS.replace("COUNT", "1"))
    listen(child, lambda: child.begun is not None)
    child.listened -= 100.0
    child.listen()
    assert child.silence <= children.LONGEST_LOOK


def test_one_that_never_begins_and_one_that_does_not_end_are_told(
    begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    child = begin(STAYS)
    listen(child, lambda: child.listened - child.started > 0.3)
    assert child.silence == 0.0  # a side that begins may be silent
    assert child.hangs() == ""
    monkeypatch.setattr(children, "BEGINNING", 0.2)
    assert child.hangs() == "has not begun within 0.2 s"
    beating = begin(BEATS.replace("COUNT", "600"))
    listen(beating, lambda: beating.begun is not None)
    monkeypatch.setattr(children, "PATIENCE", 0.5)
    beating.lasts = 0.1
    assert beating.hangs() == ""
    listen(beating, beating.hangs)
    assert beating.hangs() == "hangs: it has not ended 0.5 s after its duration"


def test_one_that_compiles_is_not_killed_for_it(begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(children, "BEGINNING", 0.5)
    child = begin(BEATS.replace("COUNT", "20").replace(repr(BEAT), repr(COMPILING)))
    end = time.monotonic() + 20.0
    listen(child, lambda: child.compiles)
    while child.compiled - child.started < 1.5:  # three times as long as a side may take that does not compile
        assert time.monotonic() < end
        child.listen()
        assert child.hangs() == ""
        time.sleep(0.02)
    assert child.begun is None
    listen(child, child.hangs)
    assert child.hangs() == "has not begun within 0.5 s"


def test_who_does_not_end_is_killed_and_nobody_waits_longer(
    begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(children, "PATIENCE", 1.0)
    leader, follower = begin(STAYS), begin(BEATS.replace("COUNT", "3"), "follower")
    assert leader.process.stdout is not None
    assert select.select([leader.process.stdout], [], [], 20.0)[0]  # it ignores the signal by now
    begun = time.monotonic()
    assert end_session([follower, leader]) == [leader]
    assert time.monotonic() - begun < 4.0
    assert leader.process.returncode == -signal.SIGKILL
    assert follower.process.returncode == -signal.SIGTERM


def test_a_follower_that_did_not_hear_the_leader_s_last_word_is_told_and_may_unload(
    begin: Callable[..., Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It hears none of a leader that never had control. Told by signal, it has the time that its end may take."""
    monkeypatch.setattr(children, "GOING", 0.5)
    unloads = "signal.signal(signal.SIGTERM, lambda *_: (time.sleep(1.0), sys.exit()))\n"
    follower = begin(f"import signal, sys, time\n{unloads}{BEATS.replace('COUNT', '600')}", "follower")
    leader = begin("import sys, time\ntime.sleep(0.2)\nsys.exit()")
    listen(follower, lambda: follower.begun is not None)
    begun = time.monotonic()
    assert end_session([follower, leader]) == []
    assert follower.process.returncode == 0
    assert time.monotonic() - begun < children.PATIENCE
    assert children.PATIENCE > LEAVING + HANGS_AFTER  # its robot unloads, then the driver of that hangs


def test_a_leader_that_is_ending_keeps_its_exit_code(begin: Callable[..., Child]) -> None:
    leader, follower = begin("import sys, time\ntime.sleep(1.0)\nsys.exit(1)"), begin("", "follower")
    listen(follower, lambda: not follower.running)
    assert end_session([follower, leader]) == []
    assert leader.process.returncode == 1
