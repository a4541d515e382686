"""Runs a reader in a process of its own with limits, and hands its result back."""

from __future__ import annotations

import atexit
import mmap
import os
import pickle
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Final, NamedTuple, ParamSpec, TypeVar

from foretouch.errors import RecordingError
from foretouch.files.budget import Budget, budget_for, require_data

Given = ParamSpec("Given")
Made = TypeVar("Made")

PATIENCE: Final = 4.0
"""A reader that computes nothing is waited for this many times its processor time: others may use the processor."""

STARTING: Final = 60.0
"""Time that its server has to start and to import what readers need [s]; the reading itself gets nothing of it."""

BEGUN: Final = b"b"  # first answer of the server: it has what it needs, and a copy of it begins to read
LONGEST_WORD: Final = 256  # bytes of a message to the process that reads

ENDED = struct.Struct("<id")
"""Answer of the server: the exit code of the copy that read, negative for a signal, and its processor time [s]."""

inside = False  # whether this is the process that reads: then a reader that calls another just calls it


class Request(NamedTuple):
    """What is asked of the process that reads."""

    read: Callable[..., Any]  # a function of a module
    given: tuple[Any, ...]  # its arguments
    named: Mapping[str, Any]  # likewise
    budget: Budget  # budget of its file
    folder: str  # folder that relative paths start from


def within_budget(
    path: str | PathLike[str],
    factor: float | None,
    read: Callable[Given, Made],
    /,
    *given: Given.args,
    **named: Given.kwargs,
) -> Made:
    """Call a reader of a file in a process of its own, with the limits of `budget_for`.

    Whatever the file does to the reader, or to a library below it, comes back as one line. What it returns is handed
    over as it is, arrays without a copy in this process. One file at a time is read for one process.

    Args:
        path: Path of the file.
        factor: Ratio of its budget to the usual one; None for what the environment says; infinite for no limit, and
            no other process.
        read: A function of a module; what it takes and returns can be pickled.
        *given: For `read`.
        **named: For `read`.

    Raises:
        RecordingError: It is no file or folder, more memory or time was needed, it is nested too deep, or the reader
            failed.
        ForetouchError: Whatever `read` raises of these.
    """
    require_data(path)
    budget = None if inside else budget_for(path, factor)
    if budget is None:
        return read(*given, **named)
    try:
        folder = os.getcwd()
    except OSError:
        folder = "/"
    parcel = os.memfd_create("foretouch")
    try:
        write_parcel(parcel, Request(read, given, named, budget, folder))
        ending = "" if Path(path).is_dir() else Path(path).suffix.lower()
        ended = _ask(f"{ending[:16]}\n{read.__module__}", parcel, budget)
        outcome: tuple[str, Any] = open_parcel(parcel) if ended.code == 0 else (_kind(ended, budget), ended.code)
    finally:
        os.close(parcel)
    kind, result = outcome
    if kind == "made":
        return result  # type: ignore[no-any-return]
    if kind == "raised":
        raise result
    error = RecordingError(path, _problem(kind, result, budget))
    if kind == "odd":
        error.add_note(result[1])
    raise error


def _problem(kind: str, result: Any, budget: Budget) -> str:
    if kind in ("memory", "time"):
        most = f"{budget.shown_memory} of memory" if kind == "memory" else f"{budget.seconds} s"
        return f"reading it takes more than {most}, the most for a file of {budget.shown_size}: {budget.raised}"
    if kind == "deep":
        return "is nested too deep to be read: no recording is"
    if kind == "odd":
        return f"cannot be read: {result[0]}"
    name = signal.Signals(-result).name if result < 0 else f"exit code {result}"
    return f"cannot be read: its reader crashed on it ({name}), so it is damaged, or was made to do that"


class _Ended(NamedTuple):
    code: int  # negative for a signal
    seconds: float  # processor time


def _kind(ended: _Ended, budget: Budget) -> str:
    """Why there is no answer."""
    if ended.seconds >= budget.seconds or ended.code == -signal.SIGXCPU:
        return "time"
    return "memory" if ended.code == -signal.SIGKILL else "crash"


# --- values on their way between two processes: arrays are mapped, not copied -----------------------------------------

_length = struct.Struct("<Q")
ALIGNED: Final = 64  # arrays begin at multiples of this [bytes], as NumPy's own do


def write_parcel(descriptor: int, value: object) -> None:
    """Write a value to an empty file: arrays first, then what refers to them."""
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    with os.fdopen(os.dup(descriptor), "wb") as file:
        spans = []
        for buffer in buffers:
            with buffer.raw() as raw:
                file.write(bytes(-file.tell() % ALIGNED))
                spans.append((file.tell(), raw.nbytes, raw.readonly))
                file.write(raw)
        tail = pickle.dumps((spans, body), protocol=5)
        file.write(tail + _length.pack(len(tail)))


def open_parcel(descriptor: int) -> Any:
    """The value in a file that `write_parcel` wrote in a process of ours; its arrays are views of that file."""
    content = memoryview(mmap.mmap(descriptor, 0, access=mmap.ACCESS_COPY))
    (length,) = _length.unpack(content[-_length.size :])
    spans, body = pickle.loads(content[-_length.size - length : -_length.size])
    views = ((content[start : start + size], fixed) for start, size, fixed in spans)
    parts = [view.toreadonly() if fixed else view for view, fixed in views]
    return pickle.loads(body, buffers=parts)


# --- the process that reads -------------------------------------------------------------------------------------------


class _Server:
    """The process that makes a copy of itself for each file; it ends when its socket is closed."""

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair()
        command = f"from foretouch.files.server import serve; serve({theirs.fileno()})"
        # No thread beside the first, so that it can be copied; no memory that is set aside for many.
        one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        environment = {**os.environ, **one, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONWARNINGS": "ignore"}
        environment |= {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "2"}
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", command],  # -P: nothing is imported from the working folder
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=environment,
                start_new_session=True,  # Ctrl-C is for the client
            )

    def ask(self, word: str, parcel: int, patience: float) -> _Ended | None:
        """Have a parcel read, whose place the answer takes; None where the server had gone before it was asked."""
        self._socket.settimeout(STARTING)
        try:
            socket.send_fds(self._socket, [word.encode()], [parcel])
            answer = self._socket.recv(len(BEGUN))
            self._socket.settimeout(patience)
            answer = answer and self._socket.recv(ENDED.size)
        except ConnectionError:
            answer = b""
        if answer:
            return _Ended(*ENDED.unpack(answer))
        code = self.process.wait()
        return _Ended(code, 0.0) if code else None

    def close(self) -> None:
        """Let it end."""
        self._socket.close()
        self.process.wait()

    def forget(self) -> None:
        """What a copy of this process does: it has not started it."""
        self._socket.close()
        self.process.returncode = 0


_lock = threading.Lock()
_server: _Server | None = None


def _ask(word: str, parcel: int, budget: Budget) -> _Ended:
    """Have a parcel read; the process that does it is started where there is none."""
    global _server
    with _lock:
        try:
            while True:
                if _server is None:
                    _server = _Server()
                ended = _server.ask(word, parcel, PATIENCE * budget.seconds)
                if ended is not None:
                    return ended
                close()
        except TimeoutError:
            close()
            return _Ended(-signal.SIGXCPU, 0.0)
        except BaseException:  # Ctrl-C among them: the reader is ended with its server
            close()
            raise


def close() -> None:
    """End the server of this process, if it has one."""
    global _server
    if _server is not None:
        _server.close()
        _server = None


def _in_a_copy() -> None:
    global _lock, _server
    _lock = threading.Lock()
    if _server is not None:
        _server.forget()
        _server = None


atexit.register(close)
os.register_at_fork(after_in_child=_in_a_copy)
