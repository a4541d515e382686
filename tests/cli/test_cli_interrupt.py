"""Ctrl-C, as a terminal sends it: to the whole foreground group. What was started ends, and nothing stays behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from foretouch.errors import ForetouchError
from foretouch.recordings import read_session

pytestmark = [pytest.mark.live, pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")]

BEGINS, ENDS = 90.0, 30.0
"""Longest time until work has begun, and until it has ended [s]."""


def parents() -> dict[int, int]:
    """Parent of every process that runs, by number."""
    result = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = path.read_text().rpartition(")")[2].split()[:2]
        except OSError:
            continue
        if state != "Z":
            result[int(path.parent.name)] = int(parent)
    return result


def descendants(process: int) -> set[int]:
    """All that a process has started, and what these have."""
    running, result = parents(), {process}
    while more := {child for child, parent in running.items() if parent in result} - result:
        result |= more
    return result - {process}


def wait(done: Callable[[], bool], patience: float) -> bool:
    end = time.monotonic() + patience
    while not (is_done := done()) and time.monotonic() < end:
        time.sleep(0.1)
    return is_done


def interrupted(folder: Path, arguments: list[str], begun: Callable[[int], bool]) -> tuple[int, str, set[int], float]:
    """Start a command, interrupt it when it has begun.

    Returns:
        Exit code, what it said, which processes are still there, and how long it took to end [s].
    """
    output = folder / "said"
    with output.open("w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-m", "foretouch", *arguments],
            cwd=folder,
            stdout=stream,
            stderr=stream,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # tests in the background ignore it
        )
    started: set[int] = set()
    try:
        assert wait(lambda: begun(process.pid) or process.poll() is not None, BEGINS), output.read_text()
        assert process.poll() is None, output.read_text()
        started = descendants(process.pid)
        assert started, f"nothing was started: {output.read_text()}"
        at = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)
        code = process.wait(ENDS)
        took = time.monotonic() - at
        wait(lambda: not started & parents().keys(), 5.0)
        return code, output.read_text(), started & parents().keys(), took
    finally:
        for number in {process.pid, *started} & parents().keys():
            os.kill(number, signal.SIGKILL)
        process.wait()


def has_led(recording: Path) -> bool:
    """Whether a leader's ticks have been recorded: on a new machine it may compile while the follower runs."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # nobody has ended the file yet
        try:
            return read_session(recording).leader.size > 200
        except (ForetouchError, OSError):
            return False


def test_a_session_ends_with_its_report(tmp_path: Path) -> None:
    recording = tmp_path / "session.mcap"
    arguments = ["teleop", "--headless", "--operator", "scripted", "--recording", str(recording)]
    code, output, left, _ = interrupted(
        tmp_path, arguments, lambda process: has_led(recording) and len(descendants(process)) >= 3
    )
    assert not left
    assert code == 0, output
    assert "Traceback" not in output
    assert f"recording  {recording}" in output  # the last line of its report


@pytest.mark.long
def test_a_comparison_ends_at_once(tmp_path: Path) -> None:
    arguments = ["compare", "--simulated", "--jobs", "2"]
    code, output, left, took = interrupted(
        tmp_path, arguments, lambda process: (tmp_path / "said").read_text().count(" by ") >= 2
    )
    assert not left
    assert code == 130, output
    assert "foretouch: interrupted" in output
    assert "Traceback" not in output
    assert took < 10.0


@pytest.mark.long
def test_a_sweep_ends_at_once_and_goes_on_from_there(tmp_path: Path) -> None:
    arguments = ["sweep", "--out", "sweep", "--sessions", "200", "--baselines", "0", "--duration", "6", "--jobs", "2"]
    code, output, left, took = interrupted(
        tmp_path, arguments, lambda process: any((tmp_path / "sweep").glob("*")) and len(descendants(process)) >= 2
    )
    assert not left
    assert code == 130, output
    assert "Traceback" not in output
    assert took < 10.0


def test_a_doctor_ends_at_once(tmp_path: Path) -> None:
    code, output, left, took = interrupted(
        tmp_path, ["doctor", "--seconds", "60"], lambda process: len(descendants(process)) >= 2
    )
    assert not left
    assert code == 130, output
    assert "Traceback" not in output
    assert took < 5.0
