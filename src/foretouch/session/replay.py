"""A recorded session again: its learning from the follower's columns, its prediction on the leader's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.identification import TIME_TOLERANCE, Learner, Motion, predict
from foretouch.messages import SessionLog
from foretouch.quantities import Recording

__all__ = ["Replay", "replay"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Replay:
    """A session's forces at each leader tick, as in `SessionLog.leader`.

    Attributes:
        predicted: Force that the leader would have rendered under the delay asked for [N].
        delayed: Force that the leader would have known, the follower's own offset taken off [N].
    """

    predicted: Array
    delayed: Array


def replay(log: SessionLog, learner: Learner, *, delay: float) -> Replay:
    """Learn from what the follower felt and predict on what the operator did, under a delay of one's own choice.

    Models are sent in the ticks in which the session sent them. The clocks of both sides are taken to agree, as they
    do for a session on one machine; the commands' own delay stays as it was.

    Args:
        log: Of the session.
        learner: Fresh.
        delay: Of models and telemetry [s].

    Raises:
        RecordingError: A side is missing, or its columns cannot be read as a recording.
    """
    if log.follower.size < 2 or not log.leader.size:
        raise RecordingError("session", "a side is missing: nothing to predict")
    origin = log.follower["time_ns"][0]
    felt = (log.follower["time_ns"] - origin) * 1e-9
    moved = (log.leader["time_ns"] - origin) * 1e-9
    recording = Recording(felt, log.follower["position"], log.follower["sensor_force"])
    before = np.concatenate(([0], log.follower["model_sequence"][:-1]))
    published = np.flatnonzero(log.follower["model_sequence"] > before)
    motion = Motion(moved, np.ascontiguousarray(log.leader["position"]), published)
    predicted = predict(recording, learner, delay=delay, motion=motion)
    known = np.searchsorted(felt, moved + TIME_TOLERANCE - delay, side="right") - 1
    return Replay(predicted, np.where(known >= 0, log.follower["force"][known], 0.0))
