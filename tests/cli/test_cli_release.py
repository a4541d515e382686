"""A stopped robot is released at its own machine, by who says so twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.link import WaitingNote, followers

STOPPED = """
import os, signal, sys, time
from foretouch.link import WaitingNote
from foretouch.session.runners.news import release_command
note, released = WaitingNote(), []
signal.signal(signal.SIGUSR2, lambda *_: released.append(1))
note.say(f"emergency stop (somebody): it is unloaded; to release it at rest: {release_command()}")
print("ready", flush=True)
for _ in range(2000):
    time.sleep(0.01)
    if released and "moves" not in sys.argv:
        note.say("")
"""
"""A process that says what a stopped follower says, and is released by the signal, unless its robot moves."""


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "foretouch" / "followers"


def stopped(*words: str) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, "-c", STOPPED, *words], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.fixture
def robot() -> Iterator[subprocess.Popen[str]]:
    process = stopped()
    yield process
    process.kill()
    process.communicate()


def release(*words: str, said: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["release", *words], input=said)
    error = "" if result.exception is None or isinstance(result.exception, SystemExit) else str(result.exception)
    return result.exit_code, result.output + error


def test_who_does_not_say_so_twice_releases_nothing_and_who_does_releases_it(robot: subprocess.Popen[str]) -> None:
    for answers in ("n\n", "y\ny\n", "y\n\n", ""):
        code, output = release(said=answers)
        assert code == 1, answers
        assert ("not released: nobody answered" in output) == (answers in ("y\n\n", "")), answers
        assert "Abort" not in output, answers
        assert ('"y" was typed, and "release" releases it' in output) == (answers == "y\ny\n"), answers
        assert ("commands again: " in output) == answers.startswith("y"), answers  # with room for what is typed
        assert followers()[robot.pid], answers
    code, output = release(said="y\nrelease\n")
    assert code == 0
    assert f"follower {robot.pid}: emergency stop (somebody): it is unloaded" in output
    assert output.endswith("the robot follows again, slowly at first\n")
    assert followers() == {robot.pid: ""}


@pytest.mark.long
def test_a_robot_that_stays_stopped_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("foretouch.cli.commands.keys.PATIENCE", 0.3)
    process = stopped("moves")
    try:
        code, output = release(said="y\nrelease\n")
    finally:
        process.kill()
        process.communicate()
    assert code == 1
    assert "NOT released (after 0.3 s): emergency stop (somebody)" in output


@pytest.mark.long
def test_where_none_waits_or_several_do_one_line_says_so(robot: subprocess.Popen[str]) -> None:
    other = stopped()
    try:
        first, second = sorted((robot.pid, other.pid))
        several = f"followers {first}, {second} of yours wait to be released: say which, such as `foretouch"
        assert f"{several} release {first}`" in release(said="")[1]
        code, output = release(str(os.getpid()), said="")
        assert code != 0
        assert output.endswith(f"is no follower of yours that waits to be released; these are: {first}, {second}")
        assert release(str(other.pid), said="y\nrelease\n")[0] == 0
    finally:
        other.kill()
        other.communicate()
    robot.kill()
    robot.wait()
    code, output = release(said="")
    assert code != 0
    assert output.endswith("no follower of yours on this machine waits to be released")


@pytest.mark.long
def test_a_folder_that_others_can_write_is_not_believed_and_a_process_that_was_killed_leaves_nothing(
    robot: subprocess.Popen[str], runtime: Path
) -> None:
    assert followers()[robot.pid]
    mode = runtime.stat().st_mode
    runtime.chmod(0o777)
    assert followers() == {}
    note = WaitingNote()
    note.say("to release it: foretouch release 1")
    note.close()
    assert [path.name for path in runtime.iterdir()] == [str(robot.pid)]
    robot.send_signal(signal.SIGKILL)
    robot.wait()
    assert [path.name for path in runtime.iterdir()] == [str(robot.pid)]
    runtime.chmod(mode)
    assert followers() == {}
    assert not list(runtime.iterdir())
