"""The rows of a session in three dimensions: what either side said along the normal and in space, tick by tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import SessionLog
from foretouch.quantities import ByValue, Rows
from foretouch.report.hand import number_of, setting
from foretouch.report.pairs import Pairs

__all__ = ["SceneRows", "has_scene", "scene_rows", "vectors"]

Array = NDArray[np.float64]

ONE_CLOCK_NS = 5_000_000
"""Two clocks that the fastest command shows no further apart than this, and the jitter, are one [ns]."""


@dataclass(frozen=True, eq=False)
class SceneRows(ByValue):
    """One stretch of a session in three dimensions; columns of one side have the same length.

    Attributes:
        leader: Rows of `SessionLog.leader`.
        hand: Those of `SessionLog.leader_space` of the same ticks.
        follower: Rows of `SessionLog.follower`.
        probe: Those of `SessionLog.follower_space` of the same ticks.
        leader_time: Of the leader's ticks, by the follower's clock, since its tick of `Pairs.time` zero [s].
        follower_time: Of the follower's ticks, since the same [s].
        newest: For each tick of the leader, the follower's newest then; -1 where there was none yet.
    """

    leader: Rows
    hand: Rows
    follower: Rows
    probe: Rows
    leader_time: Array
    follower_time: Array
    newest: NDArray[np.int64]


def has_scene(log: SessionLog) -> bool:
    """Whether a session is one in three dimensions, with something said in it."""
    return bool(setting(log.settings, "scene", "")) and bool(log.leader_space.size and log.follower_space.size)


def scene_rows(log: SessionLog, pairs: Pairs) -> SceneRows:
    """The rows of a stretch, with the leader's ticks on the follower's clock.

    The clocks of two machines are brought together by the fastest command, which took the position delay of the
    settings. Where that shows them less apart than the jitter and a few ticks, they are one, as in simulated time.

    Args:
        log: One stretch (`SessionLog.stretches`).
        pairs: Its rows at equal command.
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
    """Three columns of a table as vectors, shape (n, 3).

    Args:
        rows: Of `SessionLog.leader_space` or `SessionLog.follower_space`.
        name: Beginning of the columns' names.
        turn: Whether a rotation vector, whose columns end otherwise.
    """
    return np.stack([rows[f"{name}_{'r' if turn else ''}{axis}"] for axis in "xyz"], axis=1)


def _of_same_tick(rows: Rows, space: Rows, process: str) -> tuple[Rows, Rows]:
    """The ticks that both tables have; a stretch has one process of either side."""
    if not rows.size:
        return rows, space[:0]
    space = space[space[process] == rows[process][0]]
    _, first, second = np.intersect1d(rows["sequence"], space["sequence"], return_indices=True)
    return rows[first], space[second]


def _clocks_apart(settings: Mapping[str, str], pairs: Pairs) -> int:
    """What is to be added to the leader's clock for the follower's [ns]."""
    if not pairs.time.size:
        return 0
    transit = round(1e9 * number_of(settings, "position_delay", 0.0))
    apart = int((pairs.follower["time_ns"] - pairs.leader["time_ns"]).min()) - transit
    jitter = round(1e9 * number_of(settings, "jitter", 0.0))
    return 0 if abs(apart) <= jitter + ONE_CLOCK_NS else apart
