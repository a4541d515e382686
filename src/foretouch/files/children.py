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
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""No pool of threads takes a core that another contestant has."""

GRACE = 5.0  # Time after which a process that was asked to end is killed [s]

ENDINGS = (signal.SIGTERM, signal.SIGHUP)
"""Signals that end a process, besides SIGINT: its children, in sessions of their own, do not receive them."""

SHOWN = 4  # Number of arguments shown of a process that failed


class Ended(NamedTuple):
    """A process that has ended well: how long it took [s], the most memory it held at once [bytes], its output."""

    seconds: float
    peak: int
    output: str


class Children:
    """Processes, each leading a session of its own, so that what they start in turn ends with them."""

    def __init__(self) -> None:
        self._running: list[subprocess.Popen[Any]] = []

    def start(self, command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
        """Start a command, with nothing to read and one thread a pool, and with options of `subprocess.Popen`."""
        given = {"stdin": subprocess.DEVNULL, "env": os.environ | ONE_THREAD, "start_new_session": True, **options}
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
            for pipe in (process.stdin, process.stdout, process.stderr):
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
        with _handled((signal.SIGINT, *ENDINGS), signal.SIG_IGN):  # an impatient Ctrl-C leaves no processes behind
            started.end(grace)


@contextlib.contextmanager
def _handled(numbers: Iterable[int], handler: Any) -> Iterator[None]:
    """Handle signals in another way meanwhile; only a main thread can."""
    main = threading.current_thread() is threading.main_thread()
    before = {number: signal.signal(number, handler) for number in numbers} if main else {}
    try:
        yield
    finally:
        for number, kept in before.items():
            signal.signal(number, kept)


def interruptible() -> contextlib.AbstractContextManager[None]:
    """Treat SIGTERM and SIGHUP like Ctrl-C meanwhile: `KeyboardInterrupt`, so that all cleaning up is done."""
    return _handled(ENDINGS, signal.default_int_handler)


def measure_process(arguments: Sequence[str]) -> Ended:
    """Run Python with these arguments and wait for its end; a RuntimeError where it did not end well.

    Another process, which runs this file, starts it: what the parent holds at the start counts as the memory of a
    process, so the parent must be small, and this file imports nothing of the package before it needs it.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryFile("w+") as out,
        tempfile.TemporaryFile("w+") as err,
        children() as started,
    ):
        result = Path(folder) / "result.json"
        command = [sys.executable, "-I", __file__, str(result), sys.executable, *arguments]
        code = started.start(command, stdout=out, stderr=err).wait()
        measured = json.loads(result.read_text()) if code == 0 else {"code": code}
        out.seek(0)
        err.seek(0)
        output, errors = out.read(), err.read()
    if measured["code"]:
        left = len(arguments) - SHOWN
        named = " ".join(arguments[:SHOWN]) + (f" and {left} arguments more" if left > 0 else "")
        raise RuntimeError(f"{named}: exit code {measured['code']}: {last_line(errors)}")
    return Ended(measured["seconds"], measured["peak"] * (1 if sys.platform == "darwin" else 1024), output)


def last_line(output: str, nothing: str = "it printed nothing") -> str:
    """The last line of a process's output, which is why it failed."""
    return (output.strip().splitlines() or [nothing])[-1]


def _launch(result: str, *command: str) -> None:
    """Run a command and write seconds, most memory (as the system counts it) and exit code into the file `result`."""
    start = time.perf_counter()
    child = subprocess.Popen(command)
    _, status, used = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - start
    child.returncode = os.waitstatus_to_exitcode(status)
    Path(result).write_text(json.dumps({"seconds": seconds, "peak": used.ru_maxrss, "code": child.returncode}))


if __name__ == "__main__":
    _launch(*sys.argv[1:])
