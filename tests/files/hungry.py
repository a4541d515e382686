"""Readers that do what hostile files make readers do."""

from __future__ import annotations

import ctypes
import os
import signal
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from foretouch.errors import RecordingError, UnknownNameError


def given_back(*values: Any, **named: Any) -> Any:
    return values, named


def process() -> int:
    return os.getpid()


def arrays(count: int) -> dict[str, Any]:
    fixed = np.arange(count, dtype=np.float64)
    fixed.flags.writeable = False
    return {"fixed": fixed, "free": np.ones((3, count)), "none": np.empty(0), "fields": np.zeros(4, "f8,i4")}


def hungry(size: int) -> int:
    return bytearray(size).count(1)


def hungry_with_a_line_of_its_own(path: str, size: int) -> None:
    try:
        np.ones(size // 8)
    except Exception as error:
        raise RecordingError(path, f"is damaged: {error}") from None


def busy() -> None:
    while True:
        with suppress(Exception):  # as a reader that goes on after any error
            sum(range(1000))


def busy_in_the_library() -> None:
    sum(range(10**15))


def deep(depth: int = 0) -> int:
    return deep(depth + 1)


def crashed() -> None:
    ctypes.string_at(0)


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def odd() -> None:
    raise KeyError("a key\nof two lines")


def refused(path: str) -> None:
    raise RecordingError(path, "one line", row=7)


def unknown() -> None:
    raise UnknownNameError("law", "a", ["b", "c"])


def begun(path: str) -> None:
    Path(path).write_text(str(os.getpid()))
    time.sleep(600.0)
