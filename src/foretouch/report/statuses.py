"""In which segments of time the robot was where the commands said, guarded a first touch, or had failing sensors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import WITH_THE_COMMANDS, SessionLog, Status
from foretouch.messages.session_log import believable
from foretouch.quantities import Rows

Flags = NDArray[np.bool_]


APART_NS = 100_000_000
"""Segments that are nearer to each other than this are one [ns]: about its speed a command comes and goes."""


def runs_of(follower: Rows, flags: Flags) -> list[slice]:
    """Segments of rows from the first to the last that is flagged, those less than 0.1 s apart joined.

    Time without any tick is no time apart: a loop that was late did not do something else meanwhile.
    """
    ticks = np.flatnonzero(flags)
    if not ticks.size:
        return []
    others = np.diff(ticks) > 1
    cuts = np.flatnonzero(others & (np.diff(follower["time_ns"][ticks]) > APART_NS)) + 1
    return [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(ticks, cuts)]


def seconds_of(follower: Rows, flags: Flags) -> float:
    """How long the flag was set [s]: from each flagged tick to the next tick, however late that was."""
    lasted = np.diff(follower["time_ns"]) * 1e-9
    last = usual_period(follower) if flags.size and flags[-1] else 0.0  # the last tick's duration is unknown
    return float(lasted[flags[:-1]].sum()) + last


def guarded_runs(follower: Rows) -> list[slice]:
    """Segments of rows from the first to the last guarded tick, those less than 0.1 s apart joined.

    Args:
        follower: Rows of `SessionLog.follower`.
    """
    return runs_of(follower, follower["guarded"])


def usual_period(table: Rows) -> float:
    """Usual time from tick to tick [s]."""
    return float(np.median(np.diff(table["time_ns"]))) * 1e-9 if table.size > 1 else 0.0


A_MOMENT_NS = 100_000_000
"""A robot that joins the first command within this time [ns] does not count as returned."""


FOUND_WITHIN_NS = 100_000_000
"""A fault of the sensors is detected within this time after it began [ns], except for steps in contact."""


class Segment(NamedTuple):
    """A segment of time [s] in which the robot was not where the commands said."""

    begin: float
    end: float
    failing: bool
    """Whether its sensors could not be believed."""


def away(follower: Rows) -> Flags:
    """In which rows the robot was not where the commands said, guarded ones left out: they have separate figures."""
    return np.asarray(~np.isin(follower["status"], WITH_THE_COMMANDS))


def trusted(follower: Rows, rows: Rows) -> Flags:
    """Which rows hold a true force: the sensors are believed, then and in the 0.1 s that a fault may go unnoticed."""
    good = believable(rows)
    failing = follower["validity"] > 0
    found = follower["time_ns"][failing & ~np.concatenate((np.zeros(min(1, failing.size), np.bool_), failing[:-1]))]
    if found.size:
        following = np.append(found, 2 * FOUND_WITHIN_NS + int(rows["time_ns"].max(initial=0)))
        until = following[np.searchsorted(found, rows["time_ns"])] - rows["time_ns"]
        good &= until > FOUND_WITHIN_NS
    return good


def follower_away(log: SessionLog, start_ns: int) -> list[Segment]:
    """Where one process of the follower was away, or its sensors failed, since a time of its clock [ns]."""
    rows = since_first_command(log.follower)
    failing = rows["validity"] > 0
    told = away(rows) & ~joining(rows)
    found = []
    for flags, kind in ((told & ~failing, False), (failing, True)):
        for run in runs_of(rows, flags):
            times = (rows["time_ns"][run] - start_ns) * 1e-9
            found.append(Segment(float(times[0]), float(times[-1]), kind))
    return found


def since_first_command(follower: Rows) -> Rows:
    """Rows from the first that carries out a command."""
    begun = np.flatnonzero(follower["command_sequence"] > 0)
    return follower[begun[0] :] if begun.size else follower[:0]


def joining(rows: Rows) -> Flags:
    """The way to the first command, where it takes no longer than a moment."""
    returning = rows["status"] == Status.RETURNING
    flags = np.zeros(rows.size, dtype=np.bool_)
    if rows.size and returning[0]:
        end = rows.size if returning.all() else int(np.argmin(returning))
        flags[:end] = rows["time_ns"][end - 1] - rows["time_ns"][0] < A_MOMENT_NS
    return flags
