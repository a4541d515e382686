"""A session in three dimensions tick by tick, along the normal and in space; its fixture as rendered and as it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from foretouch.messages import SessionLog
from foretouch.quantities import Array, ByValue, Rows
from foretouch.report.numbers import number_of
from foretouch.report.rows import Pairs

AXES = ("x", "y", "z", "rx", "ry", "rz")  # Ends of the names of the columns of a pose

ONE_CLOCK_NS = 5_000_000
"""Two clocks that the fastest command shows no further apart than this, and the jitter, are one [ns]."""

OVER_NETWORK_NS = 1_000_000_000
"""How much further over a network with delays of its own [ns]. Clocks of two machines are further apart: each counts
from when its machine was started."""


@dataclass(frozen=True, eq=False)
class SceneRows(ByValue):
    """One segment of a session in three dimensions; columns of one side have the same length."""

    leader: Rows  # rows of `SessionLog.leader`
    hand: Rows  # those of `SessionLog.leader_space` of the same ticks
    follower: Rows  # rows of `SessionLog.follower`
    probe: Rows  # those of `SessionLog.follower_space` of the same ticks
    leader_time: Array  # of the leader's ticks, by the follower's clock, since its tick of `Pairs.time` zero [s]
    follower_time: Array  # of the follower's ticks, since the same [s]
    newest: NDArray[np.int64]  # for each tick of the leader, the follower's newest then; -1 where there was none yet


def scene_rows(log: SessionLog, pairs: Pairs) -> SceneRows:
    """The rows of a segment, with the leader's ticks on the follower's clock.

    The clocks of two machines are brought together by the fastest command, which took the position delay of the
    settings. Where that shows them less apart than the jitter and a few ticks, they are one, as in simulated time.
    """
    leader, hand = _of_same_tick(log.leader, log.leader_space, "epoch")
    follower, probe = _of_same_tick(log.follower, log.follower_space, "run")
    apart = _clocks_apart(log.settings, pairs)
    start = int(pairs.follower["time_ns"][0]) if pairs.time.size else int(log.follower["time_ns"].min(initial=0))
    clock = leader["time_ns"] + apart
    newest = np.searchsorted(follower["time_ns"], clock, side="right") - 1
    return SceneRows(
        leader, hand, follower, probe, (clock - start) * 1e-9, (follower["time_ns"] - start) * 1e-9, newest
    )


def vectors(rows: Rows, name: str, *, turn: bool = False) -> Array:
    """Three columns of a table as vectors, shape (n, 3), by the beginning of their names; or a rotation vector."""
    return np.stack([rows[f"{name}_{'r' if turn else ''}{axis}"] for axis in "xyz"], axis=1)


def _of_same_tick(rows: Rows, space: Rows, process: str) -> tuple[Rows, Rows]:
    """The ticks that both tables have; a segment has one process of either side."""
    if not rows.size:
        return rows, space[:0]
    space = space[space[process] == rows[process][0]]
    _, first, second = np.intersect1d(rows["sequence"], space["sequence"], return_indices=True)
    return rows[first], space[second]


def _clocks_apart(settings: Mapping[str, str], pairs: Pairs) -> int:
    """Offset from the leader's clock to the follower's [ns]."""
    if not pairs.time.size:
        return 0
    transit = round(1e9 * number_of(settings, "position_delay", 0.0))
    apart = int((pairs.follower["time_ns"] - pairs.leader["time_ns"]).min()) - transit
    slack = round(1e9 * number_of(settings, "jitter", 0.0)) + ONE_CLOCK_NS
    if settings.get("network"):  # whose shortest way is not known here
        slack += OVER_NETWORK_NS
    return 0 if abs(apart) <= slack else apart


TOUCHES = 4  # Number of touches after which a pose should be known

NEAR_MM, NEAR_DEGREES, NEAR_FOR = 0.5, 0.5, 0.5
"""A pose is right again after a bump once it has been nearer than this [mm, degrees] for this time [s]."""


@dataclass(frozen=True, eq=False)
class PoseError(ByValue):
    """Difference between the rendered and the true fixture, at each tick of the leader; shape (n,)."""

    time: Array  # time of the tick [s]
    distance: Array  # distance of the two origins [mm]; NaN where the truth is unknown
    turn: Array  # angle between them [degrees]
    distance_deviation: Array  # standard deviation of the distance by the filter [mm]
    turn_deviation: Array  # standard deviation of the angle by the filter [degrees]
    touches: Array  # beginning of each touch [s]
    bumps: tuple[tuple[float, float], ...]  # beginning and end of each motion of the true fixture [s]


def pose_error(rows: SceneRows) -> PoseError:
    """The error of the fixture that the leader renders, against the true one in the follower's newest tick.

    That is what an operator sees and feels: it holds the delay of the network.
    """
    probe = rows.probe[np.maximum(rows.newest, 0)] if rows.probe.size else rows.probe
    hand, time = (rows.hand, rows.leader_time) if probe.size else (rows.hand[:0], rows.leader_time[:0])
    distance = 1e3 * np.linalg.norm(vectors(hand, "fixture") - vectors(probe, "exact"), axis=1)
    turn = np.full(distance.size, np.nan)
    known = np.isfinite(distance) & (rows.newest[: distance.size] >= 0)
    distance[~known] = np.nan
    if known.any():
        shown = Rotation.from_rotvec(vectors(hand[known], "fixture", turn=True))
        true = Rotation.from_rotvec(vectors(probe[known], "exact", turn=True))
        turn[known] = np.degrees((shown.inv() * true).magnitude())
    ticks, first = np.unique(rows.probe["touch_tick"], return_index=True)
    touches = rows.follower_time[first[ticks > 0]]
    deviations = 1e3 * hand["fixture_deviation"], np.degrees(hand["fixture_turn"])
    return PoseError(time, distance, turn, *deviations, touches, _bumps(rows))


def pose_figures(log: SessionLog, error: PoseError) -> dict[str, Any]:
    """The figures of the pose.

    Returns:
        ``place_mm`` and ``turn_degrees``, each with ``median``, ``p95`` and the filter's median ``deviation``, from
        the fourth touch on, all ticks if there were fewer; those between a bump and `recovered` are left out.
        ``touches``; ``bumps``, each with ``at_s`` and ``recovered_s``, the time from its beginning until the error is
        below 0.5 mm and 0.5 degrees for half a second, None where it never is. ``images_used``, ``contacts_used`` and
        ``refused`` as the tracker counted. Errors are None where the truth is unknown.
    """
    counted = np.isfinite(error.distance)
    if error.touches.size >= TOUCHES:
        counted &= error.time >= error.touches[TOUCHES - 1]
    recovered = [(begin, _recovered(error, begin, end)) for begin, end in error.bumps]
    for begin, seconds in recovered:
        if seconds is not None:
            counted &= (error.time < begin) | (error.time > begin + seconds)
    belief = log.beliefs[-1] if log.beliefs else None
    return {
        "place_mm": _spread(error.distance[counted], error.distance_deviation[counted]),
        "turn_degrees": _spread(error.turn[counted], error.turn_deviation[counted]),
        "touches": int(error.touches.size),
        "after_touches": TOUCHES if error.touches.size >= TOUCHES else 0,
        "bumps": [{"at_s": begin, "recovered_s": seconds} for begin, seconds in recovered],
        "images_used": None if belief is None else belief.images,
        "contacts_used": None if belief is None else belief.contacts,
        "refused": None if belief is None else belief.refused,
    }


def _bumps(rows: SceneRows) -> tuple[tuple[float, float], ...]:
    pose = np.hstack([vectors(rows.probe, "exact"), vectors(rows.probe, "exact", turn=True)])
    moved = np.flatnonzero((np.diff(pose, axis=0) != 0.0).any(axis=1) & np.isfinite(pose[1:]).all(axis=1))
    if not moved.size:
        return ()
    parts = np.split(moved, np.flatnonzero(np.diff(rows.follower_time[moved]) > NEAR_FOR) + 1)
    return tuple((float(rows.follower_time[part[0]]), float(rows.follower_time[part[-1] + 1])) for part in parts)


def _recovered(error: PoseError, begin: float, end: float) -> float | None:
    near = (error.distance < NEAR_MM) & (error.turn < NEAR_DEGREES)
    after = error.time >= end
    starts = np.unique([end, *error.time[after & ~near]])  # right behind some tick that was far off
    lasts = np.diff(starts, append=error.time.max(initial=end))  # until the next of them
    long = np.flatnonzero(lasts >= NEAR_FOR)
    return float(starts[long[0]] - begin) if long.size else None


def _spread(values: Array, deviation: Array) -> dict[str, float | None]:
    if not values.size:
        return {"median": None, "p95": None, "deviation": None}
    known = deviation[np.isfinite(deviation)]
    return {
        "median": float(np.median(values)),
        "p95": float(np.percentile(values, 95.0)),
        "deviation": float(np.median(known)) if known.size else None,
    }
