"""Where the leader renders the fixture of a scene, against where it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from foretouch.messages import SessionLog
from foretouch.quantities import ByValue
from foretouch.report.scene_rows import SceneRows, vectors

__all__ = ["PoseError", "pose_error", "pose_figures"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TOUCHES = 4
"""So many touches a pose is given until it should be known."""

NEAR_MM, NEAR_DEGREES, NEAR_FOR = 0.5, 0.5, 0.5
"""A pose is right again after a bump once it is nearer than this, for so long [s]."""


@dataclass(frozen=True, eq=False)
class PoseError(ByValue):
    """What is between the rendered and the true fixture, at each tick of the leader; shape (n,).

    Attributes:
        time: [s].
        place: Distance of the two origins [mm]; NaN where nobody knows the truth.
        turn: Angle between them [degrees].
        place_deviation: Standard deviation of the first, as the filter says [mm].
        turn_deviation: And of the second [degrees].
        touches: When each touch began [s].
        bumps: Beginning and end of each motion of the true fixture [s].
    """

    time: Array
    place: Array
    turn: Array
    place_deviation: Array
    turn_deviation: Array
    touches: Array
    bumps: tuple[tuple[float, float], ...]


def pose_error(rows: SceneRows) -> PoseError:
    """The error of the fixture that the leader renders, against the true one in the follower's newest tick.

    That is what an operator sees and feels: it holds the delay of the network.
    """
    probe = rows.probe[np.maximum(rows.newest, 0)] if rows.probe.size else rows.probe
    hand, time = (rows.hand, rows.leader_time) if probe.size else (rows.hand[:0], rows.leader_time[:0])
    place = 1e3 * np.linalg.norm(vectors(hand, "fixture") - vectors(probe, "exact"), axis=1)
    turn = np.full(place.size, np.nan)
    known = np.isfinite(place) & (rows.newest[: place.size] >= 0)
    place[~known] = np.nan
    if known.any():
        shown = Rotation.from_rotvec(vectors(hand[known], "fixture", turn=True))
        true = Rotation.from_rotvec(vectors(probe[known], "exact", turn=True))
        turn[known] = np.degrees((shown.inv() * true).magnitude())
    ticks, first = np.unique(rows.probe["touch_tick"], return_index=True)
    touches = rows.follower_time[first[ticks > 0]]
    deviations = 1e3 * hand["fixture_deviation"], np.degrees(hand["fixture_turn"])
    return PoseError(time, place, turn, *deviations, touches, _bumps(rows))


def pose_figures(log: SessionLog, error: PoseError) -> dict[str, Any]:
    """The figures of the pose.

    Args:
        log: The session, for what the tracker counted.
        error: Of the pose.

    Returns:
        ``place_mm`` and ``turn_degrees``, each with ``median``, ``p95`` and the filter's own median ``deviation``, from
        the fourth touch on, all ticks if there were fewer; those between a bump and `recovered` are left out.
        ``touches``; ``bumps``, each with ``at_s`` and ``recovered_s``, the time from its beginning until the error is
        below 0.5 mm and 0.5 degrees for half a second, None where it never is. ``images_used``, ``contacts_used`` and
        ``refused`` as the tracker counted. Errors are None where nobody knows the truth.
    """
    counted = _settled(error)
    recovered = [(begin, _recovered(error, begin, end)) for begin, end in error.bumps]
    for begin, seconds in recovered:
        if seconds is not None:
            counted &= (error.time < begin) | (error.time > begin + seconds)
    belief = log.beliefs[-1] if log.beliefs else None
    return {
        "place_mm": _spread(error.place[counted], error.place_deviation[counted]),
        "turn_degrees": _spread(error.turn[counted], error.turn_deviation[counted]),
        "touches": int(error.touches.size),
        "after_touches": TOUCHES if error.touches.size >= TOUCHES else 0,
        "bumps": [{"at_s": begin, "recovered_s": seconds} for begin, seconds in recovered],
        "images_used": None if belief is None else belief.images,
        "contacts_used": None if belief is None else belief.contacts,
        "refused": None if belief is None else belief.refused,
    }


def _settled(error: PoseError) -> Flags:
    """Ticks with a known error, from the fourth touch on."""
    known = np.isfinite(error.place)
    if error.touches.size >= TOUCHES:
        known &= error.time >= error.touches[TOUCHES - 1]
    return np.asarray(known)


def _bumps(rows: SceneRows) -> tuple[tuple[float, float], ...]:
    """When the true fixture moved."""
    place = np.hstack([vectors(rows.probe, "exact"), vectors(rows.probe, "exact", turn=True)])
    moved = np.flatnonzero((np.diff(place, axis=0) != 0.0).any(axis=1) & np.isfinite(place[1:]).all(axis=1))
    if not moved.size:
        return ()
    parts = np.split(moved, np.flatnonzero(np.diff(rows.follower_time[moved]) > NEAR_FOR) + 1)
    return tuple((float(rows.follower_time[part[0]]), float(rows.follower_time[part[-1] + 1])) for part in parts)


def _recovered(error: PoseError, begin: float, end: float) -> float | None:
    """Time from the beginning of a bump until the error is and stays small [s]."""
    near = (error.place < NEAR_MM) & (error.turn < NEAR_DEGREES)
    after = error.time >= end
    starts = np.unique([end, *error.time[after & ~near]])  # right behind some tick that was far off
    lasts = np.diff(starts, append=error.time.max(initial=end))  # until the next of them
    long = np.flatnonzero(lasts >= NEAR_FOR)
    return float(starts[long[0]] - begin) if long.size else None


def _spread(values: Array, deviation: Array) -> dict[str, float | None]:
    if not values.size:
        return {"median": None, "p95": None, "deviation": None}
    told = deviation[np.isfinite(deviation)]
    return {
        "median": float(np.median(values)),
        "p95": float(np.percentile(values, 95.0)),
        "deviation": float(np.median(told)) if told.size else None,
    }
