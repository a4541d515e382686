"""Received positions, images, fields and pose estimates of a session in space, each with the delay it is shown with."""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from foretouch.console.history import Array
from foretouch.errors import DecodeError
from foretouch.messages import (
    CameraImage,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    LeaderSpace,
    LeaderState,
    Message,
    SessionLog,
    Telemetry,
)
from foretouch.models import ScaleField, ShapeField
from foretouch.quantities import Rows

TICKS_PER_SECOND = 1000
LENGTH = 16_384  # Ticks of the follower that are kept: as long as a delay may be
MOST_IMAGES, MOST_FIELDS = 360, 128
"""At 30 and at 10 a second: 12 s."""
TRACE_PERIOD_NS, TRACE_STRIDE, TRACE_LENGTH = 50_000_000, 50, 400
"""Between two points of a trace [ns, ticks], and their largest number."""


class PoseTrace(NamedTuple):
    """Standard deviation of the fixture's position [m] and rotation [rad] over time, and since an image showed it [s].

    All arrays have one length; the times are seconds before the newest, not positive, increasing.
    """

    time: Array
    deviation: Array
    turn: Array
    age: Array

    @classmethod
    def of(cls, rows: Sequence[tuple[float, ...]], now: float, seconds: float) -> PoseTrace:
        """The last seconds before a moment [s], of rows as above."""
        table = np.array(rows, dtype=np.float64).reshape(-1, 4)
        table[:, 0] -= now
        return cls(*table[(table[:, 0] >= -seconds) & (table[:, 0] <= 0.0)].T)


class Learnt:
    """What a follower's process told of material and shape, up to a message of a number.

    Attributes:
        field: Of the material.
        shape: Of a surface whose shape is learnt.
    """

    def __init__(self) -> None:
        self._run = self._newest = 0
        self.field, self.shape = ScaleField(), ShapeField()

    def take(self, run: int, told: Sequence[FieldUpdate]) -> None:
        """Take what is new of the messages of a process, in their order, all that had come and are still kept."""
        last = told[-1].sequence if told else 0
        if run != self._run or last < self._newest:  # another process, or back in a recording
            self._run, self._newest, self.field, self.shape = run, 0, ScaleField(), ShapeField()
        for one in told:
            if one.sequence > self._newest:
                with suppress(DecodeError):
                    self.field.take(one.content)
                    if one.shape:
                        self.shape.take(one.shape)
        self._newest = last


class SpaceState:
    """The newest messages in space, and those of the robot's side that the operator's had received by then.

    Images and fields come to a console as soon as they are made, and to an operator over a slow network. Those shown
    are selected by the follower's tick that the leader received last, and by no clock. Copies share what is shown of
    material and shape, for it is more than the messages that are kept told.

    One thread calls `take`; others read.
    """

    def __init__(self) -> None:
        self.belief: FixtureBelief | None = None
        self._belief_received = -math.inf
        self._run = 0  # of the follower's process that is there
        self._ticks: list[Telemetry | None] = [None] * LENGTH
        self._images: deque[CameraImage] = deque(maxlen=MOST_IMAGES)
        self._fields: deque[FieldUpdate] = deque(maxlen=MOST_FIELDS)
        self._learnt = Learnt()  # what is shown of them
        self._trace: deque[tuple[float, ...]] = deque(maxlen=TRACE_LENGTH)
        self._traced: LeaderState | None = None

    def take(self, message: Message, now: float) -> None:
        """Take note of a message received at a time [s], of a leader that of the one that is shown."""
        match message:
            case LeaderState(space=LeaderSpace() as space):
                self._take_leader(message, space)
            case Telemetry(space=FollowerSpace()):
                self._run = message.run
                self._ticks[message.sequence % LENGTH] = message
            case CameraImage():
                self._images.append(message)
            case FieldUpdate():
                self._fields.append(message)
            case FixtureBelief():
                self.belief, self._belief_received = message, now

    def tick(self, sequence: int) -> Telemetry | None:
        """The newest telemetry in space that the leader had, by its number."""
        tick = self._ticks[sequence % LENGTH]
        return tick if tick is not None and (tick.sequence, tick.run) == (sequence, self._run) else None

    def follower_at(self, sequence: int) -> FollowerSpace | None:
        """State of the robot in the newest telemetry that the leader had."""
        tick = self.tick(sequence)
        return None if tick is None else tick.space

    def image(self, sequence: int, camera_delay: float) -> CameraImage | None:
        """The image that had come by that telemetry, a camera's delay [s] after its exposure; else None."""
        return newest_image(tuple(self._images), sequence, camera_delay, self._run)

    def field(self, sequence: int) -> ScaleField | None:
        """What had come of the material by that telemetry; None before the first."""
        learnt = self._learnt_by(sequence)
        return learnt.field if learnt is not None and learnt.field.count else None

    def shape(self, sequence: int) -> ShapeField | None:
        """What had come by then of a shape that is learnt; None where the shape is given, and before the first."""
        learnt = self._learnt_by(sequence)
        return learnt.shape if learnt is not None and learnt.shape.count else None

    def _learnt_by(self, sequence: int) -> Learnt | None:
        tick = self.tick(sequence)
        if tick is None:
            return None
        mine = (one for one in tuple(self._fields) if one.run == tick.run)
        self._learnt.take(tick.run, [one for one in mine if one.time_ns <= tick.time_ns])
        return self._learnt

    def camera_silence(self, now: float) -> float:
        """Time since the last message of the fixture's tracker [s]; infinite before."""
        return now - self._belief_received

    def pose_trace(self, seconds: float) -> PoseTrace:
        """Estimates of the fixture's pose in the last seconds."""
        rows = tuple(self._trace)
        return PoseTrace.of(rows, rows[-1][0] if rows else 0.0, seconds)

    def _take_leader(self, state: LeaderState, space: LeaderSpace) -> None:
        before = self._traced
        if before is not None and state.epoch != before.epoch:
            self._trace.clear()  # another clock
        elif before is not None and state.time_ns - before.time_ns < TRACE_PERIOD_NS:
            return
        self._traced = state
        self._trace.append((state.time_ns * 1e-9, space.fixture_deviation, space.fixture_turn, space.fixture_age))


def newest_image(images: Sequence[CameraImage], sequence: int, camera_delay: float, run: int = 0) -> CameraImage | None:
    """The newest image that had come by a follower's tick, a camera's delay [s] later; 0 means any run."""
    latest = sequence - round(camera_delay * TICKS_PER_SECOND)
    for image in reversed(images):
        if image.tick <= latest and (image.run == run or 0 in (run, image.run)):
            return image
    return None


class RecordedSpace(SpaceState):
    """Messages received in space at a moment; see `SpaceState`.

    Those of the robot's side are those that the operator's had received: two recorded clocks need not agree.
    """

    def __init__(self, segment: SessionLog) -> None:
        super().__init__()
        leads, follows = segment.leader_space, segment.follower_space
        if segment.leader.size:  # a side that began again counts from 1 again
            leads = leads[leads["epoch"] == segment.leader["epoch"][-1]]
        if segment.follower.size:
            follows = follows[follows["run"] == segment.follower["run"][-1]]
        self._segment, self._now = replace(segment, leader_space=leads, follower_space=follows), (0, 0)
        self._run = run = int(follows["run"][-1]) if follows.size else 0
        self._images = deque(image for image in segment.images if image.run == run or 0 in (run, image.run))
        self._fields = deque(segment.fields)
        self._beliefs = sorted(segment.beliefs, key=lambda belief: belief.time_ns)

    def go_to(self, row: int) -> tuple[LeaderState, Telemetry | None]:
        """Show a tick of the leader, a row of its table; returns it, and the newest telemetry that it had received."""
        leader = self._segment.leader_state(row)
        telemetry = self.tick(leader.telemetry_sequence)
        time_ns = -1 if telemetry is None else telemetry.time_ns
        last = bisect.bisect_right(self._beliefs, time_ns, key=lambda belief: belief.time_ns) - 1
        self.belief = self._beliefs[last] if last >= 0 else None
        self._now = leader.sequence, leader.time_ns
        return leader, telemetry

    def tick(self, sequence: int) -> Telemetry | None:
        """Telemetry that the operator's side received last, on a line too."""
        row = _newest(self._segment.follower, sequence)
        return self._segment.telemetry(row) if row >= 0 and sequence > 0 else None

    def camera_silence(self, now: float) -> float:
        """Not known for a recording: no tracker is reported as missing."""
        return 0.0 if self.belief is not None else math.inf

    def pose_trace(self, seconds: float) -> PoseTrace:
        """Estimates of the fixture's pose in the seconds before the moment."""
        leads, (sequence, now_ns) = self._segment.leader_space, self._now
        last, now = _newest(leads, sequence) + 1, now_ns * 1e-9
        part = leads[int(np.searchsorted(leads["time_ns"][:last], (now - seconds) * 1e9)) : last]
        part = part[part["sequence"] % TRACE_STRIDE == 0]
        columns = (part["time_ns"] * 1e-9, part["fixture_deviation"], part["fixture_turn"], part["fixture_age"])
        return PoseTrace.of(np.column_stack(columns).tolist(), now, seconds)


def _newest(rows: Rows, sequence: int) -> int:
    """The last row up to a number; -1 before the first."""
    return int(np.searchsorted(rows["sequence"], sequence, side="right")) - 1
