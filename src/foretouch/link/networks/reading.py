"""Reading a trace of time and delay from a text file: a CSV, or columns between blanks."""

from __future__ import annotations

import functools
import math
import os
import re
from itertools import islice
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from foretouch.errors import SettingError, one_line
from foretouch.link.networks.trace import NetworkTrace

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # In seconds
TIMES = ("time", "t", "timestamp", "elapsed", "pub_time", "sent", "send_time", "sent_at")
ROUND_TRIPS = ("round_trip", "round_trip_time", "rtt", "ping", "delay", "latency")
ONE_WAYS = ("one_way", "one_way_delay", "owd")

LONGEST_ROUND_TRIP = 60.0  # Delays beyond this [s] are refused: they are in other units
LONGEST_GAP = 1.0  # Longest time between two messages [s] of a trace in which something came all the time
USUAL_GAPS = 5.0  # How many times the usual time between two messages a gap has at least, where they are rare
MOST_BYTES = 100_000_000  # Largest size of a file: an hour at 1 kHz


class _Columns(NamedTuple):
    """Which columns there are, and their units in seconds."""

    time: int
    delay: int
    time_unit: float
    delay_unit: float
    one_way: bool
    rows_begin: int  # number of the line of the first row


def read_trace(path: str | Path, last_line: int | None = None) -> NetworkTrace:
    """Read a trace: a row for each message, with when it was sent and how long it was on its way.

    Columns are found by their names, with the unit at the end of each: ``time_s,round_trip_ms``, ``pub_time(ms)``. A
    file of two columns without names has both in seconds. A column ``one_way`` is one way, any other a round trip.

    Args:
        path: Of the file.
        last_line: Number of the last line that is taken; None for all.

    Raises:
        SettingError: It cannot be read, or is no trace: the line, the rule, and what to do.
    """
    try:
        stamp = Path(path).stat()
        if not Path(path).is_file() or stamp.st_size > MOST_BYTES:
            what = f"is larger than {MOST_BYTES // 10**6} MB" if Path(path).is_file() else "is no file"
            _refuse(path, None, f"{what}: give a text file with a row for each message")
        return _read(os.fspath(path), last_line, stamp.st_mtime_ns, stamp.st_size)
    except FileNotFoundError:
        _refuse(path, None, "there is no such file, and no network of this name: see foretouch network list")
    except OSError as error:
        _refuse(path, None, f"cannot be read: {error.strerror}")


@functools.lru_cache(maxsize=16)
def _read(path: str, last_line: int | None, *_stamp: int) -> NetworkTrace:
    """Read it; a file that has changed is read again."""
    data = Path(path).read_bytes()
    try:
        if b"\0" in data:
            raise ValueError
        lines = data.decode("utf-8-sig").splitlines()[:last_line]
    except ValueError:
        _refuse(path, None, "is no text: give a CSV of time and delay")
    columns = _columns(path, lines)
    rows = [_row(path, number, line, columns) for number, line in _rows(lines, columns.rows_begin)]
    if len(rows) < 2:
        found = "one row" if rows else "no rows"
        _refuse(path, None, f"has {found}: a trace needs a row of time and delay for each of many messages")
    time, delay = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
    _check_time(path, time, [row[0] for row in rows])
    source = f"file {Path(path).name}"
    return NetworkTrace(path, time - time[0], delay, one_way=columns.one_way, source=source)


def _rows(lines: list[str], begin: int) -> list[tuple[int, str]]:
    """Numbers and texts of the rows; empty lines and comments are none."""
    numbered = islice(enumerate(lines, 1), begin - 1, None)
    return [(number, line) for number, line in numbered if line.strip() and not line.lstrip().startswith("#")]


def _cells(line: str) -> list[str]:
    """The cells of a row, between commas, semicolons or blanks; a unit belongs to the name before it."""
    for between in (";", ",", "\t"):
        if between in line:
            return [cell.strip().strip('"') for cell in line.strip().split(between)]
    return re.sub(r"\s+(?=[(\[])", "", line).split()


def _columns(path: str, lines: list[str]) -> _Columns:
    number, head = next(iter(_rows(lines, 1)), (0, ""))
    if not head:
        _refuse(path, None, "is empty: give a text file with a row for each message")
    cells = _cells(head)
    if all(_is_number(cell) for cell in cells):
        if len(cells) != 2:
            rule = f"has {len(cells)} columns without names: name them in a first line, such as time_s,round_trip_ms"
            _refuse(path, number, rule)
        return _Columns(0, 1, 1.0, 1.0, one_way=False, rows_begin=number)
    named = [_named(cell) for cell in cells]
    time = _found(path, number, named, TIMES, "when each was sent")
    one_way = any(name in ONE_WAYS for name, _ in named)
    delay = _found(path, number, named, ONE_WAYS if one_way else ROUND_TRIPS, "how long each was on its way")
    return _Columns(time[0], delay[0], time[1], delay[1], one_way, number + 1)


def _named(cell: str) -> tuple[str, str]:
    """Name and unit of a column, such as ``("pub_time", "ms")``; "" where it has no unit."""
    match = re.fullmatch(r"(.*?)[\s_]*[(\[/ _]\s*(s|sec|seconds|ms|us|µs|ns)\s*[)\]]?", cell.strip(), re.IGNORECASE)
    name, unit = match.groups() if match else (cell, "")
    unit = {"sec": "s", "seconds": "s", "µs": "us"}.get(unit.lower(), unit.lower())
    return re.sub(r"[\s-]+", "_", name.strip().lower()), unit


def _found(
    path: str, number: int, named: list[tuple[str, str]], names: tuple[str, ...], what: str
) -> tuple[int, float]:
    """The first column that has one of these names, and its unit in seconds."""
    for index, (name, unit) in enumerate(named):
        if name in names and not unit:
            _refuse(path, number, f"column {name!r} has no unit: end its name with _s or _ms")
        if name in names:
            return index, UNITS[unit]
    _refuse(path, number, f"has no column that says {what}: name one {names[0]}_s or {names[0]}_ms")


def _row(path: str, number: int, line: str, columns: _Columns) -> tuple[int, float, float]:
    """The number of the line, and its time and delay [s]."""
    cells = _cells(line)
    values = []
    for index, unit, what in ((columns.time, columns.time_unit, "time"), (columns.delay, columns.delay_unit, "delay")):
        if index >= len(cells):
            _refuse(path, number, f"has {len(cells)} columns, and its {what} would be in number {index + 1}: mend it")
        if not _is_number(cells[index]) or not math.isfinite(float(cells[index])):
            _refuse(path, number, f"its {what} {one_line(cells[index])[:40]!r} is no finite number: mend or remove it")
        values.append(float(cells[index]) * unit)
    time, delay = values
    if delay < 0.0:
        _refuse(path, number, f"its delay of {delay:g} s is negative: subtract times of one clock")
    if delay > LONGEST_ROUND_TRIP:
        rule = f"its delay of {delay:g} s is longer than {LONGEST_ROUND_TRIP:g} s: name the unit that it is in"
        _refuse(path, number, rule)
    return number, time, delay


def _check_time(path: str, time: np.ndarray, numbers: list[int]) -> None:
    """Time goes on, and no part of it was left out."""
    between = np.diff(time)
    back = np.flatnonzero(between < 0.0)
    if back.size:
        where = int(back[0])
        rule = f"its time is {-between[where]:g} s before the row above: give one run alone, in the order of sending"
        _refuse(path, numbers[where + 1], rule)
    if not time[-1] > time[0]:
        _refuse(path, numbers[-1], "its time is that of the first row: a trace needs messages one after the other")
    most = max(LONGEST_GAP, USUAL_GAPS * float(np.median(between)))
    gaps = np.flatnonzero(between > most)
    if gaps.size:
        where = int(gaps[0])
        rule = f"no message was sent for {between[where]:g} s before it, and {most:g} s are allowed: what the network "
        rule += "did meanwhile is not known; give the rows above it, or those from it on, as a file of their own"
        _refuse(path, numbers[where + 1], rule)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _refuse(path: str | Path, line: int | None, rule: str) -> NoReturn:
    raise SettingError("network", str(path), rule if line is None else f"line {line}: {rule}")
