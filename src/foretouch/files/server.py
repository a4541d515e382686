"""The process in which files are read: it waits, and makes a copy of itself with limits for each file.

It has a single thread of its own, so that copies are safe whatever threads the process has that asks; and it has
imported what readers need, so that a copy costs milliseconds.
"""

from __future__ import annotations

import importlib
import os
import resource
import select
import signal
import socket
import traceback
from contextlib import suppress
from typing import Any

from foretouch.errors import ForetouchError, one_line
from foretouch.files import within

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
        word, parcels, _, _ = socket.recv_fds(asked, within.LONGEST_WORD, 1)
        if not parcels:
            return
        ending, module = word.decode().split("\n")
        for library in (module, *LIBRARIES.get(ending, ())):
            with suppress(ImportError):  # the reader that misses it reports it
                importlib.import_module(library)
        asked.sendall(within.BEGUN)
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
    return within.ENDED.pack(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime)


def _read(parcel: int) -> None:
    """Do what a request says, within its limits, and put the answer in its place."""
    request: within.Request = within.open_parcel(parcel)
    within.inside = True
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
    within.write_parcel(parcel, outcome)


def _limit(budget: Any) -> None:
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


def _outcome(request: Any) -> tuple[str, object]:
    try:
        return "made", request.read(*request.given, **request.named)
    except _TimeUp:
        return "time", ""
    except BaseException as error:
        kinds = set()
        link: BaseException | None = error
        while link is not None:  # a reader may have made a line of its own of it
            kinds |= {type(link)} | set(type(link).__mro__)
            link = link.__cause__ or link.__context__
        if kinds & {MemoryError, RecursionError}:
            return ("memory" if MemoryError in kinds else "deep"), ""
        if isinstance(error, ForetouchError):
            return "raised", error
        text = one_line(getattr(error, "strerror", "") or error, 200)
        named = text if isinstance(error, OSError) and text else f"{type(error).__name__} {text}".strip()
        return "odd", (named, "".join(traceback.format_exception(error)))
