"""A recorded session at a moment of one's choice, along a line or in space: what a live session shows, and no more."""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from foretouch.console.history import NAN, Array, LossTrace, Window, empty_window, window_of
from foretouch.console.models_seen import ModelFigures, ModelTrace, figures_of, trace_of
from foretouch.console.space_heard import PoseTrace, SpaceHeard, newest_field, newest_image
from foretouch.console.watched import Watched
from foretouch.errors import RecordingError
from foretouch.messages import (
    VERSION,
    WITH_THE_COMMANDS,
    CameraImage,
    FieldUpdate,
    FollowerSpace,
    LeaderSpace,
    LeaderState,
    SessionLog,
    Telemetry,
    settings_at,
)

TRACE_STRIDE = 50
"""Ticks between two points of a trace."""


class RecordedSpace(SpaceHeard):
    """Messages received in space at a moment; see `SpaceHeard`.

    Those of the robot's side are those that the operator's had received: two recorded clocks need not agree.
    """

    def __init__(self, segment: SessionLog) -> None:
        super().__init__()
        self._leads, self._follows = segment.leader_space, segment.follower_space
        if segment.leader.size:  # a side that began again counts from 1 again
            self._leads = self._leads[self._leads["epoch"] == segment.leader["epoch"][-1]]
        if segment.follower.size:
            self._follows = self._follows[self._follows["run"] == segment.follower["run"][-1]]
        run = int(self._follows["run"][-1]) if self._follows.size else 0
        self._pictures = tuple(image for image in segment.images if image.run == run or 0 in (run, image.run))
        self._maps = tuple(field for field in segment.fields if run in (0, field.run))
        self._beliefs = sorted(segment.beliefs, key=lambda belief: belief.time_ns)
        self._belief_times = [belief.time_ns for belief in self._beliefs]

    def go_to(self, leader: int, telemetry: int) -> None:
        """Show the leader's tick of a sequence, and the newest telemetry that it had received."""
        row = int(np.searchsorted(self._leads["sequence"], leader, side="right")) - 1
        self.leader = LeaderSpace(VERSION, *_numbers(self._leads[row])) if row >= 0 else None
        self.follower = self.heard(telemetry)
        self.belief = None
        if self.follower is not None:
            last = bisect.bisect_right(self._belief_times, self.follower.time_ns) - 1
            self.belief = self._beliefs[last] if last >= 0 else None

    def heard(self, sequence: int) -> FollowerSpace | None:
        """State of the robot that the operator's side received last."""
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
        """Not known for a recording: no tracker is reported as missing."""
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


TOLERANCE = 1e-6
"""A tick counts as being at a moment that is at most this much before it [s]."""

M = TypeVar("M", LeaderState, Telemetry)


class RecordedWatch(Watched):
    """State of a recorded session as received at `now`; see `Watched`.

    For a session in which a side began again, the longest segment.

    Attributes:
        duration: From the leader's first tick to its last [s].

    Raises:
        RecordingError: Nothing was recorded of the leader.
    """

    def __init__(self, log: SessionLog) -> None:
        super().__init__()
        segment = log.longest()
        if not segment.leader.size:
            raise RecordingError("the recording", "holds nothing of a leader: there is nothing to show over time")
        self._leader, self._follower = segment.leader, segment.follower
        self._seconds: Array = (self._leader["time_ns"] - self._leader["time_ns"][0]) * 1e-9
        self.duration = float(self._seconds[-1])
        self._segment = segment
        self.space = self._recorded_space = RecordedSpace(segment)
        self._row_of = _rows_of(self._leader["telemetry_sequence"], self._follower["sequence"])
        self._columns = self._all_columns(segment)
        run = int(self._follower["run"][-1]) if self._follower.size else 0
        self._by_sequence = {model.sequence: model for model in log.models if run in (0, model.run)}
        self._known: dict[tuple[int, float], ModelFigures | None] = {}
        changes = np.flatnonzero(np.diff(self._leader["model_sequence"], prepend=0) > 0)
        self._adoptions = [(float(self._seconds[row]), int(self._leader["model_sequence"][row])) for row in changes]
        self.now = 0.0
        self.go_to(0.0)

    def go_to(self, now: float) -> None:
        """Show another moment since the leader's first tick [s], held within the recording."""
        self.now = min(max(now, 0.0), self.duration) if math.isfinite(now) else 0.0
        row = int(np.searchsorted(self._seconds, self.now + TOLERANCE, side="right")) - 1
        self.leader = _message(LeaderState, self._leader[row])
        telemetry = int(self._row_of[row])
        self.telemetry = _message(Telemetry, self._follower[telemetry]) if telemetry >= 0 else None
        self.settings = self._settings_at(row, telemetry)
        self.model = self._by_sequence.get(int(self._leader["model_sequence"][row]))
        self._recorded_space.go_to(self.leader.sequence, self.leader.telemetry_sequence)

    @property
    def robot_position(self) -> float:
        """Where the operator's side last saw the robot [m]; NaN before."""
        return NAN if self.telemetry is None else self.telemetry.position

    def window(self, seconds: float) -> Window:
        """Forces, energy and delay of the seconds before `now`."""
        first, last = np.searchsorted(self._seconds, (self.now - seconds, self.now + TOLERANCE), side="right")
        part = slice(int(first), int(last))
        if part.stop <= part.start:
            return empty_window()
        now = float(self._seconds[part.stop - 1])
        return window_of(self._leader["sequence"][part], self._columns[part], now, seconds, 400)

    def model_trace(self, seconds: float) -> ModelTrace:
        """Models of the seconds before `now`, compared at `model_depth`."""
        first = bisect.bisect_left(self._adoptions, (self.now - seconds, 0))
        last = bisect.bisect_right(self._adoptions, (self.now, 1 << 63))
        return trace_of(self._adoptions[first:last], self._figures, self.now, seconds)

    def loss_trace(self, seconds: float, now: float) -> LossTrace:
        """Nothing: a recording has its losses in all, and not over time."""
        none = np.empty(0)
        return LossTrace(none, none, none)

    def _settings_at(self, row: int, telemetry: int) -> Mapping[str, str]:
        """What was set then: a network can be changed while a session runs."""
        segment = self._segment
        if not segment.said:
            return segment.settings
        leader = self._leader[row]
        felt_ns = int(self._follower["time_ns"][max(telemetry, 0)]) if self._follower.size else None
        run = int(self._follower["run"][0]) if self._follower.size else 0
        return settings_at(segment.said, int(leader["epoch"]), run, int(leader["time_ns"]), felt_ns)

    def _figures(self, sequence: int) -> ModelFigures | None:
        key = (sequence, self.model_depth)
        if key not in self._known:
            update = self._by_sequence.get(sequence)
            self._known[key] = None if update is None else figures_of(update, self.model_depth)
        return self._known[key]

    def _all_columns(self, segment: SessionLog) -> Array:
        """The columns of `window_of`, over the whole recording."""
        leader, follower = self._leader, self._follower
        predicted = np.where(np.isfinite(leader["position"]), leader["predicted_force"], NAN)
        true, trips, away = np.full(leader.size, NAN), np.full(leader.size, NAN), np.zeros(leader.size)
        rows = segment.rows()
        force = rows.follower["exact_force"] if self._exact(rows.follower) else rows.follower["force"]
        at = np.searchsorted(leader["sequence"], rows.leader["sequence"])
        true[at] = force
        away[at] = ~np.isin(rows.follower["status"], WITH_THE_COMMANDS)
        if follower.size:
            answered = follower["command_sequence"][np.maximum(self._row_of, 0)]
            at = np.minimum(np.searchsorted(leader["sequence"], answered), leader.size - 1)
            here = (self._row_of >= 0) & (leader["sequence"][at] == answered)
            trips[here] = (self._seconds - self._seconds[at])[here]
        names = ("delayed_force", "standard_deviation", "rendered_force", "energy", "energy_bound", "late_energy")
        known = [leader[name] for name in names]
        columns: Array = np.column_stack([self._seconds, predicted, *known, trips, true, away])
        return columns

    def _exact(self, follower: np.ndarray) -> bool:
        """Whether the recording has the simulator's true force."""
        return bool(follower.size) and bool(np.isfinite(follower["exact_force"]).all())


class Playback:
    """A recording that is played, and perhaps a second run of it beside it.

    Raises:
        RecordingError: Nothing was recorded of a leader.
    """

    def __init__(self, log: SessionLog, other: SessionLog | None = None, *, name: str = "") -> None:
        self.log, self.name = log, name
        self.shown = RecordedWatch(log)
        self.other = None if other is None else RecordedWatch(other)
        self.playing = False
        self._clock = math.nan

    @property
    def now(self) -> float:
        """The moment that is shown, since the leader's first tick [s]."""
        return self.shown.now

    @property
    def duration(self) -> float:
        """Duration of the recording [s]."""
        return self.shown.duration

    def play(self, playing: bool) -> None:
        """Go on, or pause; at the end, go on from the beginning."""
        if playing and self.now >= self.duration:
            self.go_to(0.0)
        self.playing, self._clock = playing, math.nan

    def go_to(self, now: float) -> None:
        """Show another moment [s]."""
        self.shown.go_to(now)
        if self.other is not None:
            self.other.go_to(now)
        self._clock = math.nan

    def tick(self, clock: float) -> None:
        """Let the recording's time go on as the clock [s] did since the last tick."""
        if not self.playing:
            return
        since, now = clock - self._clock, self.now
        if math.isfinite(since):
            self.go_to(now + since)
        self._clock = clock
        if self.now >= self.duration:
            self.playing = False


def _message(kind: type[M], row: np.void) -> M:
    """A message from its row."""
    return kind(VERSION, *row.tolist())


def _rows_of(heard: np.ndarray, sequences: np.ndarray) -> np.ndarray:
    """The follower's row of the telemetry that each leader tick had received last; -1 before the first."""
    rows: np.ndarray = np.searchsorted(sequences, heard, side="right") - 1
    return np.where(heard > 0, rows, -1)
