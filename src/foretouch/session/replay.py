"""A recorded session again: its learning from the follower's columns, its prediction on the leader's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.identification import TIME_TOLERANCE, Learner, Motion, PredictedForce, predict_motion
from foretouch.messages import SessionLog
from foretouch.models.checks import require
from foretouch.quantities import Recording
from foretouch.session.round_trip import RoundTrip

__all__ = ["Replay", "replay"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Replay:
    """A session's forces at each leader tick, as in `SessionLog.leader`.

    Attributes:
        predicted: Force that the leader would have rendered under the delay asked for.
        delayed: Force that the leader would have known, the follower's own offset taken off [N].
    """

    predicted: PredictedForce
    delayed: Array


def replay(log: SessionLog, learner: Learner, *, delay: float) -> Replay:
    """Learn from what the follower felt and predict on what the operator did, under a delay of one's own choice.

    Models and telemetry are sent in the ticks in which the session sent them, and arrive when they arrived in the
    session, earlier or later by the difference of the delays: the network's own jitter and losses stay, and no two
    clocks are compared. At the session's own delay the session's own prediction comes out.

    Args:
        log: Of the session.
        learner: Fresh.
        delay: Of models and telemetry [s], not negative.

    Raises:
        RecordingError: A side is missing, the session's own delay is, or a column cannot be read as a recording.
        SettingError: delay is negative or not finite.
    """
    require("delay", delay, at_least=0.0)
    felt = log.follower[log.follower["command_sequence"] > 0]  # learning begins with the first command
    if felt.size < 2 or not log.leader.size:
        raise RecordingError("session", "a side is missing: nothing to predict")
    try:
        later = delay - float(log.settings["force_delay"])
    except (KeyError, ValueError):
        raise RecordingError(
            "session", "does not say its force_delay: no other delay can be put in its place"
        ) from None
    clock = (log.leader["time_ns"] - log.leader["time_ns"][0]) * 1e-9
    published = np.flatnonzero(np.diff(felt["model_sequence"], prepend=0) > 0)
    motion = Motion(
        clock,
        np.ascontiguousarray(log.leader["position"]),
        published,
        _arrivals(clock, log.leader["model_sequence"], felt["model_sequence"][published]) + later,
        np.searchsorted(log.leader["sequence"], felt["command_sequence"][published], side="right"),
        _round_trips(log, felt) + later,
    )
    recording = Recording((felt["time_ns"] - felt["time_ns"][0]) * 1e-9, felt["position"], felt["sensor_force"])
    told = _arrivals(clock, log.leader["telemetry_sequence"], log.follower["sequence"]) + later
    known = np.searchsorted(told, clock + TIME_TOLERANCE, side="right") - 1
    delayed = np.where(known >= 0, log.follower["force"][known], 0.0)
    return Replay(predict_motion(recording, learner, motion), delayed)


def _round_trips(log: SessionLog, felt: NDArray[np.void]) -> Array:
    """What the follower told its estimator of the delay at each of these ticks [s], NaN where nothing.

    Which models the leader had when it sent a command stands in the leader's own row of that command.
    """
    trip, told = RoundTrip(), np.full(felt.size, np.nan)
    row = np.searchsorted(log.leader["sequence"], felt["command_sequence"], side="right") - 1
    acknowledged = np.where(row >= 0, log.leader["model_sequence"][row], 0)
    columns = (felt["time_ns"], felt["command_sequence"], acknowledged, felt["model_sequence"])
    sent = 0
    for index, (now, command, model, newest) in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
        trip.commanded(command, model)
        delay = trip.applied(command, now)
        if delay is not None:
            told[index] = delay
        if newest != sent:
            sent = newest
            trip.sent(sent, now)
    return told


def _arrivals(clock: Array, newest: NDArray[np.int64], sequences: NDArray[np.int64]) -> Array:
    """Time at which each message, or a newer one, had arrived [s]; inf where none did.

    Args:
        clock: Of the receiver's ticks [s].
        newest: Newest sequence number that had arrived at each tick.
        sequences: Of the messages, increasing.
    """
    return np.append(clock, np.inf)[np.searchsorted(np.maximum.accumulate(newest), sequences)]
