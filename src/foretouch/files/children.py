"""Fresh processes, timed and with their use of memory; none outlives its parent."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from foretouch.errors import ForetouchError

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""No pool of threads takes a core that another contestant has."""

LAUNCHER = Path(__file__).with_name("launcher.py")
"""Program that times a process and asks for its memory."""

GRACE = 5.0
"""Time after which a process that was asked to end is killed [s]."""

ENDINGS = (signal.SIGTERM, signal.SIGHUP)
"""Signals that end a process, besides SIGINT: its children, in sessions of their own, do not receive them."""

SHOWN = 4
"""Number of arguments shown of a process that failed."""


class Ended(NamedTuple):
    """A process that has ended well.

    Attributes:
        seconds: Time from its start to its end, start-up included [s].
        peak: Most memory that it held at once [bytes].
        output: What it printed.
    """

    seconds: float
    peak: int
    output: str


class Children:
    """Processes, each leading a session of its own, so that what they start in turn ends with them."""

    def __init__(self) -> None:
        self._running: list[subprocess.Popen[Any]] = []

    def start(self, command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
        """Start a command, with nothing to read and one thread a pool, and with options of `subprocess.Popen`."""
        given = {"stdin": subprocess.DEVNULL, "env": environment(), "start_new_session": True, **options}
        self._running.append(subprocess.Popen(command, **given))
        return self._running[-1]

    def end(self, grace: float) -> None:
        """Ask all to end that have not, and kill what is left of them and of their children after `grace` [s]."""
        asked = [process for process in self._running if process.poll() is None]
        for process in asked:
            _signal(process, signal.SIGTERM)
        until = time.monotonic() + grace
        for process in asked:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, until - time.monotonic()))
        for process in self._running:
            _signal(process, signal.SIGKILL)
            process.wait()
            for pipe in (process.stdout, process.stderr):
                if pipe is not None:
                    pipe.close()


def _signal(process: subprocess.Popen[Any], number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):  # none is left
        os.killpg(process.pid, number)


@contextlib.contextmanager
def children(grace: float = GRACE) -> Iterator[Children]:
    """Start processes; however this ends, none of them is left after a time of grace [s]."""
    started = Children()
    try:
        yield started
    finally:
        with _undisturbed():
            started.end(grace)


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Ignore signals, so that an impatient Ctrl-C leaves no processes behind."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, *ENDINGS)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Treat SIGTERM and SIGHUP like Ctrl-C meanwhile: `KeyboardInterrupt`, so that all cleaning up is done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in ENDINGS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def environment() -> dict[str, str]:
    """Environment of this process, with one thread a pool."""
    return {**os.environ, **ONE_THREAD}


def measure_process(arguments: Sequence[str]) -> Ended:
    """Run Python with these arguments and wait for its end; a ForetouchError where it did not end well."""
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryFile("w+") as out,
        tempfile.TemporaryFile("w+") as err,
        children() as started,
    ):
        result = Path(folder) / "result.json"
        command = [sys.executable, "-I", str(LAUNCHER), str(result), sys.executable, *arguments]
        code = started.start(command, stdout=out, stderr=err).wait()
        measured = json.loads(result.read_text()) if code == 0 else {"code": code}
        out.seek(0)
        err.seek(0)
        output, said = out.read(), err.read()
    if measured["code"]:
        raise ForetouchError(f"{_named(arguments)}: exit code {measured['code']}: {last_line(said)}")
    return Ended(measured["seconds"], measured["peak"] * (1 if sys.platform == "darwin" else 1024), output)


def last_line(said: str) -> str:
    """The last line of a process's output, which is why it failed."""
    return (said.strip().splitlines() or ["it said nothing"])[-1]


def _named(arguments: Sequence[str]) -> str:
    """A command in a line: not all of its files."""
    left = len(arguments) - SHOWN
    return " ".join(arguments[:SHOWN]) + (f" and {left} arguments more" if left > 0 else "")
