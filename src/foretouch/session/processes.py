"""The whole lap on one machine: follower, leader, recorder and console as four processes, and their supervision."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from foretouch.link import free_endpoint
from foretouch.session.housekeeping import StopFlag
from foretouch.session.recorder import RECORDING_INCOMPLETE
from foretouch.session.settings import SessionSettings

__all__ = ["run_processes"]

PATIENCE = 8.0
"""Once a session ends, each process has so long [s] to end by itself; then it is told to, then it is killed."""

POLL_PERIOD = 0.05

WATCHERS = {"console": "console", "record": "recorder"}
"""Processes that the session goes on without, unless what they were told to do is refused (exit code 2)."""


@dataclass
class _Child:
    role: str
    process: subprocess.Popen[bytes]


def run_processes(
    settings: SessionSettings,
    *,
    recording: Path,
    console_port: int | None,
    duration: float | None,
    stop: StopFlag,
    say: Callable[[str], None],
) -> int:
    """Start the processes of a session, wait for its end, and see that none stays behind.

    Args:
        settings: Of the session.
        recording: The MCAP file to write.
        console_port: Port of the console on 127.0.0.1, None for no console.
        duration: [s], None until somebody ends it.
        stop: Set by Ctrl-C.
        say: Prints one line for people.

    Returns:
        0, or the exit code of the process that failed, or `RECORDING_INCOMPLETE`.
    """
    follower, leader = free_endpoint(), free_endpoint()
    common = ["--parent", str(os.getpid())]
    watching = ["--connect", follower, "--connect", leader, *common]
    chosen = _options(settings)
    recorder = _start("record", [str(recording), *watching])
    children = [_start("follower", ["--listen", follower, *chosen, *common]), recorder]
    if console_port is not None:
        children.append(_start("console", ["--port", str(console_port), *watching]))
    length = [] if duration is None else ["--duration", str(duration)]
    wait = ["--wait-for-recorder"]
    children.append(_start("leader", ["--listen", leader, "--connect", follower, *wait, *length, *chosen, *common]))
    try:
        code = _watch(children, stop, say)
    finally:
        _end(children)
    return code or (RECORDING_INCOMPLETE if recorder.process.returncode else 0)


def _options(settings: SessionSettings) -> list[str]:
    """The settings as options of `foretouch leader` and `foretouch follower`."""
    return [part for name, value in settings.as_text().items() for part in (f"--{name.replace('_', '-')}", value)]


def _start(role: str, arguments: Sequence[str]) -> _Child:
    """Start one process of ours; Ctrl-C reaches only this one, which then ends the others in order."""
    command = [sys.executable, "-m", "foretouch", role, *arguments]
    return _Child(
        role,
        subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True),
    )


def _watch(children: list[_Child], stop: StopFlag, say: Callable[[str], None]) -> int:
    """Wait until the leader has ended, or a process has failed, or `stop` is set; return the exit code."""
    while True:
        for child in children:
            code = child.process.poll()
            if code is None:
                continue
            if child.role in WATCHERS and code != 2:
                if code:
                    who = WATCHERS[child.role]
                    say(f"the {who} ended with exit code {code}; the session goes on without it")
                children.remove(child)
                break
            if code != 0:
                say(f"the {child.role} process ended with exit code {code}")
                return code if code > 0 else 1
            if child.role in ("leader", "follower"):
                return 0
        if stop.reason:
            return 0
        _pass_on(children, stop)
        time.sleep(POLL_PERIOD)


def _pass_on(children: list[_Child], stop: StopFlag) -> None:
    """An emergency stop, and its release, are the follower's."""
    followers = [child.process for child in children if child.role == "follower"]
    if stop.emergency:
        stop.emergency = ""
        for process in followers:
            process.send_signal(signal.SIGUSR1)
    if stop.release:
        stop.release = False
        for process in followers:
            process.send_signal(signal.SIGUSR2)


def _end(children: list[_Child]) -> None:
    """End all processes: the leader first, whose last word ends the others; then, or if it has none, by signal."""
    leading = next((child for child in children if child.role == "leader" and child.process.poll() is None), None)
    if leading is not None:
        leading.process.terminate()
    if leading is not None or all(child.process.poll() in (None, 0) for child in children):
        _wait(children)
    for insist in (subprocess.Popen.terminate, subprocess.Popen.kill):
        for child in children:
            if child.process.poll() is None:
                insist(child.process)
        _wait(children)


def _wait(children: list[_Child]) -> None:
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end and any(child.process.poll() is None for child in children):
        time.sleep(POLL_PERIOD)
