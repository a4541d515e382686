"""The guarded first touch: how often, for how long, and what it took away."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog
from foretouch.quantities import Rows

__all__ = ["guarded_figures", "guarded_runs", "runs_of", "seconds_of", "usual_period"]


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
    follower = log.follower
    depth = time = 0.0
    contacts = 0
    for run in guarded_runs(follower):
        rows = follower[run]
        touching = np.flatnonzero(rows["in_contact"])
        if not touching.size:
            continue
        contacts += 1
        rows = rows[touching[0] :]
        time = max(time, float(np.ptp(rows["time_ns"])) * 1e-9 + usual_period(follower))
        depth = max(depth, _depth_lost(log.leader, rows[rows["guarded"] & rows["in_contact"]]))
    touching, held = follower["in_contact"], follower["in_contact"] & follower["guarded"]
    return {
        "guarded_contact_percent": 100.0 * float(held.sum() / touching.sum()) if touching.any() else None,
        "guarded_contacts": contacts,
        "guarded_s": seconds_of(follower, follower["guarded"]),
        "depth_lost_mm": 1e3 * depth,
        "time_lost_s": time,
    }


def _depth_lost(leader: Rows, rows: Rows) -> float:
    """How much deeper the applied commands were than the robot was told, at most [m]."""
    if not leader.size:
        return 0.0
    place = np.searchsorted(leader["sequence"], rows["command_sequence"])
    place = np.minimum(place, leader.size - 1)
    heard = leader["sequence"][place] == rows["command_sequence"]
    lost = leader["position"][place[heard]] - rows["desired_position"][heard]
    lost = lost[np.isfinite(lost)]
    return max(float(lost.max()), 0.0) if lost.size else 0.0


def usual_period(table: Rows) -> float:
    """Usual time from tick to tick [s]."""
    return float(np.median(np.diff(table["time_ns"]))) * 1e-9 if table.size > 1 else 0.0
