"""What a follower did beside following, what its sensors were worth, and who spoke: over a whole session.

Of the guarded first touch it says how often, for how long, and what it took away.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import SENSOR_SENTENCES, SensorState
from foretouch.messages import STATUS_SENTENCES, WITH_THE_COMMANDS, SessionLog, Status
from foretouch.messages.session_log import believable
from foretouch.quantities import Rows

Flags = NDArray[np.bool_]

APART_NS = 100_000_000
"""Stretches that are nearer to each other than this are one [ns]: about its speed a command comes and goes."""


def runs_of(follower: Rows, flags: Flags) -> list[slice]:
    """Stretches of rows from the first to the last that is flagged, those less than 0.1 s apart joined.

    Time without any tick is no time apart: a loop that was late did not do something else meanwhile.

    Args:
        follower: Rows of `SessionLog.follower`, shape (n,).
        flags: Shape (n,).
    """
    ticks = np.flatnonzero(flags)
    if not ticks.size:
        return []
    others = np.diff(ticks) > 1
    cuts = np.flatnonzero(others & (np.diff(follower["time_ns"][ticks]) > APART_NS)) + 1
    return [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(ticks, cuts)]


def seconds_of(follower: Rows, flags: Flags) -> float:
    """How long the flag was set [s]: from each flagged tick to the next tick, however late that was.

    Args:
        follower: Rows of `SessionLog.follower` of one process, shape (n,).
        flags: Shape (n,).
    """
    lasted = np.diff(follower["time_ns"]) * 1e-9
    last = usual_period(follower) if flags.size and flags[-1] else 0.0  # nobody knows how long after the last tick
    return float(lasted[flags[:-1]].sum()) + last


def guarded_runs(follower: Rows) -> list[slice]:
    """Stretches of rows from the first to the last guarded tick, those less than 0.1 s apart joined.

    Args:
        follower: Rows of `SessionLog.follower`.
    """
    return runs_of(follower, follower["guarded"])


def guarded_figures(log: SessionLog) -> dict[str, Any]:
    """What the guard did, over all ticks of the follower.

    Args:
        log: The session.

    Returns:
        ``guarded_contact_percent``: share of the ticks in contact that were guarded; None without contact.
        ``guarded_contacts``: guarded stretches with contact in them. ``guarded_s``: all guarded ticks, those of an
        approach that it slowed down too. ``depth_lost_mm``: the farthest that the applied command was beyond what the
        robot was told, in guarded ticks in contact. ``time_lost_s``: the longest time from a guarded contact's
        beginning until commands were followed again, or the session was over.
    """
    follower, period = log.follower, usual_period(log.follower)
    commands = np.ascontiguousarray(log.leader["sequence"])  # as a column it is copied at every search
    depth = time = 0.0
    contacts = 0
    for run in guarded_runs(follower):
        rows = follower[run]
        touching = np.flatnonzero(rows["in_contact"])
        if not touching.size:
            continue
        contacts += 1
        rows = rows[touching[0] :]
        time = max(time, float(np.ptp(rows["time_ns"])) * 1e-9 + period)
        depth = max(depth, _depth_lost(log.leader, commands, rows[rows["guarded"] & rows["in_contact"]]))
    touching, held = follower["in_contact"], follower["in_contact"] & follower["guarded"]
    return {
        "guarded_contact_percent": 100.0 * float(held.sum() / touching.sum()) if touching.any() else None,
        "guarded_contacts": contacts,
        "guarded_s": seconds_of(follower, follower["guarded"]),
        "depth_lost_mm": 1e3 * depth,
        "time_lost_s": time,
    }


def _depth_lost(leader: Rows, commands: NDArray[np.int64], rows: Rows) -> float:
    """How much deeper the applied commands were than the robot was told, at most [m]."""
    if not leader.size:
        return 0.0
    place = np.searchsorted(commands, rows["command_sequence"])
    place = np.minimum(place, leader.size - 1)
    heard = commands[place] == rows["command_sequence"]
    lost = leader["position"][place[heard]] - rows["desired_position"][heard]
    lost = lost[np.isfinite(lost)]
    return max(float(lost.max()), 0.0) if lost.size else 0.0


def usual_period(table: Rows) -> float:
    """Usual time from tick to tick [s]."""
    return float(np.median(np.diff(table["time_ns"]))) * 1e-9 if table.size > 1 else 0.0


A_MOMENT_NS = 100_000_000
"""A robot that joins the first command within so long [ns] is not said to have returned."""

FOUND_WITHIN_NS = 100_000_000
"""A fault of the sensors is found no later than so long after it began [ns], but for steps in contact."""

REFUSALS = ("stale", "overtaken", "future", "of_others", "before_release")
"""Why commands were refused, as their counters are called."""


class Stretch(NamedTuple):
    """A stretch of time [s] in which the robot was not where the commands said."""

    begin: float
    end: float
    failing: bool
    """Whether its sensors could not be believed."""


def away(follower: Rows) -> Flags:
    """In which rows the robot was not where the commands said, guarded ones left out: they have figures of their own.

    Args:
        follower: Rows of `SessionLog.follower`.
    """
    return np.asarray(~np.isin(follower["status"], WITH_THE_COMMANDS))


def trusted(follower: Rows, rows: Rows) -> Flags:
    """Which rows hold a true force: the sensors are believed, then and in the 0.1 s that a fault may go unnoticed.

    Args:
        follower: All rows of one process of the follower, as in `SessionLog.follower`.
        rows: Some of them.
    """
    good = believable(rows)
    failing = follower["validity"] > 0
    found = follower["time_ns"][failing & ~np.concatenate((np.zeros(min(1, failing.size), np.bool_), failing[:-1]))]
    if found.size:
        following = np.append(found, 2 * FOUND_WITHIN_NS + int(rows["time_ns"].max(initial=0)))
        until = following[np.searchsorted(found, rows["time_ns"])] - rows["time_ns"]
        good &= until > FOUND_WITHIN_NS
    return good


def follower_away(log: SessionLog, start_ns: int) -> list[Stretch]:
    """Where one process of the follower was away, or its sensors failed, since a time of its clock [ns].

    Args:
        log: One stretch of a session.
        start_ns: Time zero.
    """
    rows = _since_first_command(log.follower)
    failing = rows["validity"] > 0
    told = away(rows) & ~joining(rows)
    found = []
    for flags, kind in ((told & ~failing, False), (failing, True)):
        for run in runs_of(rows, flags):
            times = (rows["time_ns"][run] - start_ns) * 1e-9
            found.append(Stretch(float(times[0]), float(times[-1]), kind))
    return found


def stretch_figures(log: SessionLog) -> dict[str, Any]:
    """How often each side began, and which part of the session the figures are of.

    Returns:
        ``leader_starts``, ``follower_starts``: processes that were heard. ``changes``: how often settings changed in
        between. ``count``: of `SessionLog.phases`.
        ``max_rendered_force_N``, ``max_follower_force_N``: over all of them.
    """
    exact, felt = log.follower["exact_force"], log.follower["force"]
    phases = len(log.phases())
    return {
        "leader_starts": int(np.unique(log.leader["epoch"]).size),
        "follower_starts": int(np.unique(log.follower["run"]).size),
        "changes": phases - len(log.stretches()),
        "count": phases,
        "max_rendered_force_N": _largest(log.leader["rendered_force"]),
        "max_follower_force_N": _largest(exact if np.isfinite(exact).any() else felt),
    }


def safety_figures(log: SessionLog) -> dict[str, Any]:
    """What happened beside following, over all processes of the follower; what did not happen is not there.

    From the first command on; a robot that joins that within 0.1 s is not said to have returned. An emergency stop in
    which one process ended and the next began is one: nobody had released it.

    Args:
        log: The whole session.

    Returns:
        ``statuses`` and ``sensor_faults``: by name the ``times``, the ``seconds`` and the ``sentence``; what is less
        than 0.1 s apart is one time. ``refused_commands``: by reason, where there were any. ``control``: who held it,
        in turn, as the follower said, ``contests``: who else would have. ``emergency_stops``: their reasons.
        ``step_failures``: exceptions in the steps of the follower.
    """
    runs, first = np.unique(log.follower["run"], return_index=True)
    parts = [_since_first_command(log.follower[log.follower["run"] == run]) for run in runs[np.argsort(first)]]
    refused = {reason: log.counts.get(f"commands_{reason}", 0) for reason in REFUSALS}
    reasons = [*(stop.reason for stop in log.emergencies), *log.news.get("stopped", ())]
    return {
        "statuses": _summed(parts, "status", WITH_THE_COMMANDS, _status),
        "sensor_faults": _summed(parts, "validity", (SensorState.GOOD,), _fault),
        "refused_commands": {reason: count for reason, count in refused.items() if count},
        "control": list(log.news.get("control", ())),
        "contests": list(log.news.get("contest", ())),
        "emergency_stops": list(dict.fromkeys(reasons)),
        "step_failures": log.counts.get("step_failures", 0),
    }


def _summed(parts: list[Rows], column: str, ordinary: tuple[int, ...], name_of: Any) -> dict[str, Any]:
    """Times and seconds of each value of a column that is not ordinary, over the processes of the follower."""
    found: dict[str, Any] = {}
    for value in sorted({int(value) for rows in parts for value in np.unique(rows[column])} - set(map(int, ordinary))):
        times = ticks = 0
        seconds, held = 0.0, False
        for rows in parts:
            flags = rows[column] == value
            if column == "status":
                flags &= ~joining(rows)
            goes_on = held and column == "status" and value == Status.STOPPED and bool(flags[:1].any())
            ticks += int(flags.sum())
            times += len(runs_of(rows, flags)) - goes_on
            seconds += seconds_of(rows, flags)
            held = bool(flags[-1]) if flags.size else held
        if ticks:
            name, sentence = name_of(value)
            found[name] = {"times": times, "seconds": seconds, "sentence": sentence}
    return found


def _status(value: int) -> tuple[str, str]:
    try:
        return Status(value).name.lower(), STATUS_SENTENCES[Status(value)]
    except ValueError:
        return f"status {value}", "is not known to this version of foretouch"


def fault_name(value: int) -> str:
    """Of a fault of the sensors, also one that this version does not know."""
    return _fault(value)[0]


def _fault(value: int) -> tuple[str, str]:
    try:
        return SensorState(value).name.lower(), SENSOR_SENTENCES[SensorState(value)]
    except ValueError:
        return f"fault {value}", "is not known to this version of foretouch"


def _since_first_command(follower: Rows) -> Rows:
    begun = np.flatnonzero(follower["command_sequence"] > 0)
    return follower[begun[0] :] if begun.size else follower[:0]


def joining(rows: Rows) -> Flags:
    """The way to the first command, where it takes no longer than a moment.

    Args:
        rows: Of `SessionLog.follower`, of one process, from the first command on.
    """
    returning = rows["status"] == Status.RETURNING
    flags = np.zeros(rows.size, dtype=np.bool_)
    if rows.size and returning[0]:
        end = rows.size if returning.all() else int(np.argmin(returning))
        flags[:end] = rows["time_ns"][end - 1] - rows["time_ns"][0] < A_MOMENT_NS
    return flags


def _largest(values: NDArray[np.float64]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else None
