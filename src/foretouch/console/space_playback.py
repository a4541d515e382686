"""A recorded session in three dimensions at a moment of one's choice."""

from __future__ import annotations

import bisect
import math
from typing import Any

import numpy as np

from foretouch.console.space_heard import PoseTrace, SpaceHeard, newest_field, newest_image
from foretouch.messages import VERSION, CameraImage, FieldUpdate, FollowerSpace, LeaderSpace, SessionLog

__all__ = ["RecordedSpace"]

TRACE_STRIDE = 50
"""Ticks between two points of a trace."""


class RecordedSpace(SpaceHeard):
    """What was heard in space at a moment; see `SpaceHeard`.

    Of the robot's side it is what the operator's had heard by then: two recorded clocks need not agree.

    Args:
        stretch: Of the session; nothing is shown of one along a line.
    """

    def __init__(self, stretch: SessionLog) -> None:
        super().__init__()
        self._leads, self._follows = stretch.leader_space, stretch.follower_space
        if stretch.leader.size:  # a side that began again counts from 1 again
            self._leads = self._leads[self._leads["epoch"] == stretch.leader["epoch"][-1]]
        if stretch.follower.size:
            self._follows = self._follows[self._follows["run"] == stretch.follower["run"][-1]]
        run = int(self._follows["run"][-1]) if self._follows.size else 0
        self._pictures = tuple(image for image in stretch.images if image.run == run or 0 in (run, image.run))
        self._maps = tuple(field for field in stretch.fields if run in (0, field.run))
        self._beliefs = sorted(stretch.beliefs, key=lambda belief: belief.time_ns)
        self._belief_times = [belief.time_ns for belief in self._beliefs]

    def go_to(self, leader: int, telemetry: int) -> None:
        """Show another moment.

        Args:
            leader: Sequence of the leader's tick.
            telemetry: Of the newest telemetry that it had heard.
        """
        row = int(np.searchsorted(self._leads["sequence"], leader, side="right")) - 1
        self.leader = LeaderSpace(VERSION, *_numbers(self._leads[row])) if row >= 0 else None
        self.follower = self.heard(telemetry)
        self.belief = None
        if self.follower is not None:
            last = bisect.bisect_right(self._belief_times, self.follower.time_ns) - 1
            self.belief = self._beliefs[last] if last >= 0 else None

    def heard(self, sequence: int) -> FollowerSpace | None:
        """The robot as the operator's side last heard of it."""
        row = int(np.searchsorted(self._follows["sequence"], sequence, side="right")) - 1
        return FollowerSpace(VERSION, *_numbers(self._follows[row])) if row >= 0 and sequence > 0 else None

    def image(self, sequence: int, camera_delay: float) -> CameraImage | None:
        """The image that had come over the network."""
        return newest_image(self._pictures, sequence, camera_delay)

    def field(self, sequence: int) -> FieldUpdate | None:
        """The materials that had come over the network."""
        tick = self.heard(sequence)
        return None if tick is None else newest_field(self._maps, tick)

    def camera_silence(self, now: float) -> float:
        """Not known of a recording: nobody is missed."""
        return 0.0 if self.belief is not None else math.inf

    def pose_trace(self, seconds: float) -> PoseTrace:
        """What was known of the fixture's pose in the seconds before the moment."""
        if self.leader is None:
            return PoseTrace.of((), 0.0, seconds)
        last = int(np.searchsorted(self._leads["sequence"], self.leader.sequence, side="right"))
        now = self.leader.time_ns * 1e-9
        first = int(np.searchsorted(self._leads["time_ns"][:last], (now - seconds) * 1e9))
        part = self._leads[first:last]
        part = part[part["sequence"] % TRACE_STRIDE == 0]
        columns = (part["time_ns"] * 1e-9, part["fixture_deviation"], part["fixture_turn"], part["fixture_age"])
        return PoseTrace.of(np.column_stack(columns).tolist(), now, seconds)


def _numbers(row: np.void) -> tuple[Any, ...]:
    """Of a row."""
    return tuple(row.tolist())
