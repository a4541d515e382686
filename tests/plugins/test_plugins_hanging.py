"""A driver of another package whose call does not come back: its session ends all the same, and says why."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import failing_drivers
import pytest
from plugin_packages import make_package
from plugin_sessions import COMMAND, environment, run_with

from foretouch.recordings import is_whole, read_session
from foretouch.session.runners.news import HANGS_AFTER, LoopWatch, where

LONGEST = 60.0
"""Of a session that hangs [s]: about 3 to begin, 3 to 8 to be noticed, 8 to end; the rest is a busy machine's."""


def processes_in(folder: Path) -> list[int]:
    """Processes that run in this folder."""
    result = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and (entry / "cwd").readlink() == folder:
                result.append(int(entry.name))
        except OSError:
            continue
    return result


@pytest.mark.live
@pytest.mark.parametrize(
    ("kind", "call", "said"),
    [
        pytest.param(
            *("device", "read", "the leader hangs: no tick for 3 s, in read (made_up.py, line "), marks=pytest.mark.long
        ),
        pytest.param(
            "device", "held", "the leader hangs: nothing has come of it for 8 s; it is killed", marks=pytest.mark.long
        ),
        pytest.param("device", "close", "the leader did not end and was killed", marks=pytest.mark.long),
        pytest.param(
            *("robot", "stuck", "the follower hangs: no tick for 3 s, in exchange (made_up.py, line "),
            marks=pytest.mark.long,
        ),
        pytest.param(  # it raises once, and hangs when the robot is to unload
            *("robot", "vanishing", "the follower hangs: no tick for 3 s, in fail (made_up.py, line "),
            marks=pytest.mark.long,
        ),
    ],
    ids=["read", "held", "close", "robot", "unloading"],
)
def test_a_session_ends_where_a_call_of_a_driver_does_not_come_back(
    tmp_path: Path, kind: str, call: str, said: str
) -> None:
    source = failing_drivers.DEVICE if kind == "device" else failing_drivers.ROBOT
    options = ("--operator", call) if kind == "device" else ("--robot", call, "--operator", "scripted")
    teleop = ("teleop", "--headless", "--duration", 5 if kind == "device" else 60, "--recording", "s.mcap")
    ran = run_with(tmp_path, kind, source, call, *teleop, *options, seconds=LONGEST)
    assert ran.code == 1, ran.err
    assert said in ran.err
    assert "Traceback" not in ran.err
    assert is_whole(tmp_path / "s.mcap")
    assert read_session(tmp_path / "s.mcap").follower.size > 1000
    assert processes_in(tmp_path) == []


@pytest.mark.live
@pytest.mark.long
def test_a_side_that_was_stopped_by_a_signal_and_goes_on_is_not_ended(tmp_path: Path) -> None:
    """For longer than a loop may hang, and longer than its beats may be missing."""
    site = make_package(tmp_path / "site", "made-up", {"device": {"close": "made_up:close"}}, failing_drivers.DEVICE)
    options = ["--headless", "--duration", "20", "--recording", "s.mcap", "--operator", "scripted"]
    with subprocess.Popen(
        [*COMMAND, "teleop", *options], cwd=tmp_path, env=environment(site), stderr=subprocess.PIPE, text=True
    ) as teleop:
        leaders: list[int] = []
        end = time.monotonic() + 60.0
        while not (leaders and (tmp_path / "s.mcap").exists() and (tmp_path / "s.mcap").stat().st_size > 100_000):
            assert time.monotonic() < end
            assert teleop.poll() is None
            leaders = [pid for pid in processes_in(tmp_path) if b"\0leader\0" in command_of(pid)]
            time.sleep(0.1)
        os.kill(leaders[0], signal.SIGSTOP)
        time.sleep(10.0)
        os.kill(leaders[0], signal.SIGCONT)
        _, err = teleop.communicate(timeout=LONGEST)
    assert teleop.returncode == 0, err
    assert "hangs" not in err


def command_of(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def test_looks_are_counted_and_not_seconds() -> None:
    watch = LoopWatch(0.5)
    looks = round(HANGS_AFTER / 0.5)
    for _ in range(3 * looks):  # a loop that has not begun
        assert not watch.look()
        assert not watch.stuck
    watch.ticked = 1
    assert watch.look()
    for look in range(looks):
        assert not watch.stuck, look
        assert not watch.look()
    assert watch.stuck.startswith(f"no tick for {HANGS_AFTER:g} s, in stuck (news.py, line ")
    watch.ticked = 2
    assert watch.look()
    assert not watch.stuck


def test_it_is_said_where_a_thread_is_and_not_where_python_waits() -> None:
    inside, leave = threading.Event(), threading.Event()

    def hangs() -> None:
        inside.set()
        leave.wait()

    thread = threading.Thread(target=hangs)
    thread.start()
    inside.wait()
    time.sleep(0.05)
    output = where(sys._current_frames()[thread.ident or 0])
    leave.set()
    thread.join()
    assert output.startswith("in hangs (test_plugins_hanging.py, line ")
    assert where(None) == "in a place that is not known"
