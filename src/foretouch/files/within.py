"""Runs a reader in a process of its own with limits, and hands its result back.

That process waits, and makes a copy of itself with limits for each file. It has a single thread of its own, so that
copies are safe whatever threads the process has that asks; and it has imported what readers need, so that a copy costs
milliseconds.
"""

from __future__ import annotations

import atexit
import importlib
import mmap
import os
import pickle
import resource
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any, Final, NamedTuple, ParamSpec, TypeVar

from foretouch.errors import ForetouchError, RecordingError, one_line
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


# --- the process that is asked ----------------------------------------------------------------------------------------


class _Server:
    """The process that makes a copy of itself for each file; it ends when its socket is closed."""

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair()
        command = f"from foretouch.files.within import serve; serve({theirs.fileno()})"
        # No thread beside the first, so that it can be copied; no memory that is set aside for many.
        environment = os.environ | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        environment |= {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONWARNINGS": "ignore"}
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


# --- in the process that reads ---------------------------------------------------------------------------------------

LIBRARIES = {
    "": ("rosbags.rosbag2", "rosbags.typesys"),
    ".csv": ("pyarrow.csv",),
    ".parquet": ("pyarrow.parquet",),
    ".mat": ("scipy.io",),
    ".h5": ("h5py",),
    ".hdf5": ("h5py",),
    ".mcap": ("mcap.records", "mcap.stream_reader"),
    ".db3": ("rosbags.rosbag2", "rosbags.typesys"),
    ".stl": ("networkx", "trimesh"),
    ".obj": ("networkx", "trimesh"),
    ".ply": ("networkx", "trimesh"),
}
"""What the readers of files with an ending import, the empty one being that of folders: here once, so that copies find
it."""


IDLE = 20.0
"""Time for which it waits for a next file [s]: a session that runs for hours has no use for what it has imported."""


class _TimeUp(BaseException):
    """Raised where the processor time is over; no reader takes it for an error of the file."""


def serve(descriptor: int) -> None:
    """Serve readings of files as long as requests come, and not for hours.

    Args:
        descriptor: Socket to the client. Each message is the ending of a file and the module of its reader; the
            parcel of a request comes beside it, and the answer takes its place.
    """
    asked = socket.socket(fileno=descriptor)
    while select.select([descriptor], [], [], IDLE)[0]:
        word, parcels, _, _ = socket.recv_fds(asked, LONGEST_WORD, 1)
        if not parcels:
            return
        ending, module = word.decode().split("\n")
        for library in (module, *LIBRARIES.get(ending, ())):
            with suppress(ImportError):  # the reader that misses it reports it
                importlib.import_module(library)
        asked.sendall(BEGUN)
        copy = os.fork()
        if copy == 0:
            code = 1
            try:
                asked.close()
                _read(parcels[0])
                code = 0
            finally:
                os._exit(code)
        os.close(parcels[0])
        ended = _waited_for(copy, asked)
        if ended is None:
            return
        asked.sendall(ended)


def _waited_for(copy: int, asked: socket.socket) -> bytes | None:
    """The status with which the copy ended; None where no client waits for it any more: then it was killed."""
    process = os.pidfd_open(copy)
    try:
        if asked.fileno() in select.select([asked.fileno(), process], [], [])[0]:
            os.kill(copy, signal.SIGKILL)
            os.waitpid(copy, 0)
            return None
    finally:
        os.close(process)
    _, status, used = os.wait4(copy, 0)
    return ENDED.pack(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime)


def _read(parcel: int) -> None:
    """Do what a request says, within its limits, and put the answer in its place."""
    global inside
    request: Request = open_parcel(parcel)
    inside = True
    with suppress(OSError):  # a folder that was removed
        os.chdir(request.folder)
    _limit(request.budget)
    outcome = _outcome(request)
    signal.signal(signal.SIGXCPU, signal.SIG_IGN)
    try:
        _answer(parcel, outcome)
    except MemoryError:
        _answer(parcel, ("memory", ""))


def _answer(parcel: int, outcome: tuple[str, object]) -> None:
    os.ftruncate(parcel, 0)
    os.lseek(parcel, 0, os.SEEK_SET)
    write_parcel(parcel, outcome)


def _limit(budget: Budget) -> None:
    def time_up(*_: object) -> None:
        signal.signal(signal.SIGXCPU, signal.SIG_IGN)
        raise _TimeUp

    signal.signal(signal.SIGXCPU, time_up)
    for limit, soft, hard in (
        (resource.RLIMIT_CORE, 0, 0),
        # What is written counts, too: the answer, and files that are made out of the one that is read.
        (resource.RLIMIT_FSIZE, budget.memory, budget.memory),
        (resource.RLIMIT_DATA, budget.memory, budget.memory),
        (resource.RLIMIT_CPU, budget.seconds, budget.seconds + 2),
    ):  # none is raised where it is lower already
        given = [most if most != resource.RLIM_INFINITY else hard for most in resource.getrlimit(limit)]
        resource.setrlimit(limit, (min(soft, *given), min(hard, given[1])))


def _outcome(request: Request) -> tuple[str, object]:
    try:
        return "made", request.read(*request.given, **request.named)
    except _TimeUp:
        return "time", ""
    except BaseException as error:
        kinds = set()
        link: BaseException | None = error
        while link is not None:  # a reader may have made a line of its own of it
            kinds |= set(type(link).__mro__)
            link = link.__cause__ or link.__context__
        if kinds & {MemoryError, RecursionError}:
            return ("memory" if MemoryError in kinds else "deep"), ""
        if isinstance(error, ForetouchError):
            return "raised", error
        text = one_line(getattr(error, "strerror", "") or error, 200)
        named = text if isinstance(error, OSError) and text else f"{type(error).__name__} {text}".strip()
        return "odd", (named, "".join(traceback.format_exception(error)))
