"""Replay of a recorded session: learning from the follower's columns, prediction on the leader's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError
from foretouch.errors.checks import require
from foretouch.identification import TIME_TOLERANCE, Learner, Motion, PredictedForce, predict_motion
from foretouch.messages import SessionLog
from foretouch.messages.session_log import believable
from foretouch.quantities import ByValue, Recording, Rows
from foretouch.session.network.round_trip import RoundTrip

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Replay(ByValue):
    """A session's forces at each leader tick of its longest segment.

    Attributes:
        predicted: Force that the leader would have rendered under the delay asked for.
        delayed: Force that the leader would have known, the follower's own offset taken off [N].
    """

    predicted: PredictedForce
    delayed: Array


def replay(log: SessionLog, learner: Learner, *, delay: float) -> Replay:
    """Learn from the follower's forces and predict on the operator's motion, under a chosen delay.

    Models and telemetry are sent in the ticks in which the session sent them, and arrive when they arrived in the
    session, earlier or later by the difference of the delays: the network's own jitter and losses stay, and no two
    clocks are compared. At the session's own delay the session's own prediction comes out. As in the session, nothing
    is learnt from samples whose sensors were not to be trusted.

    Where a side ended and began again, the leader's motion is that of the longest segment (`SessionLog.longest`), and
    all that the follower's process of that segment had learnt before it counts; what the leader brought along of a
    process before that does not.

    Args:
        log: Log of the session.
        learner: New learner.
        delay: Delay of models and telemetry [s], not negative.

    Raises:
        RecordingError: A side is missing, the session's own delay is, or a column cannot be read as a recording.
        SettingError: delay is negative or not finite.
    """
    require("delay", delay, at_least=0.0)
    segment = log.longest()
    leader, felt = segment.leader, _felt(log, segment)
    believed = believable(felt)
    if believed.sum() < 2 or not leader.size:
        raise RecordingError("session", "a side is missing: nothing to predict")
    try:
        later = delay - float(segment.settings["force_delay"])
    except (KeyError, ValueError):
        raise RecordingError(
            "session", "does not say its force_delay: no other delay can be put in its place"
        ) from None
    clock = (leader["time_ns"] - leader["time_ns"][0]) * 1e-9
    positions = np.cumsum(believed) - 1  # of the newest sample that was learnt, among those that were
    published = np.flatnonzero((np.diff(felt["model_sequence"], prepend=0) > 0) & (positions >= 0))
    arrived = _arrivals(clock, leader["model_sequence"], felt["model_sequence"][published]) + later
    # A model learnt from the commands of another leader is not taken.
    arrived[~np.isin(felt["epoch"][published], (0, leader["epoch"][0]))] = np.inf
    motion = Motion(
        clock,
        np.ascontiguousarray(leader["position"]),
        positions[published],
        arrived,
        np.searchsorted(leader["sequence"], _learnt_at(felt, believed)[published], side="right"),
        _known_before(_round_trips(log, felt), believed) + later,
    )
    time = (felt["time_ns"] - felt["time_ns"][0])[believed] * 1e-9
    recording = Recording(time, felt["position"][believed], felt["sensor_force"][believed])
    reported = _arrivals(clock, leader["telemetry_sequence"], segment.follower["sequence"]) + later
    known = np.searchsorted(reported, clock + TIME_TOLERANCE, side="right") - 1
    force = segment.follower["force"]
    delayed = np.where(known >= 0, force[known], 0.0) if force.size else np.zeros(clock.size)
    return Replay(predict_motion(recording, learner, motion), delayed)


def _felt(log: SessionLog, segment: SessionLog) -> Rows:
    """Rows of a segment's follower process up to its end; learning begins with the first command."""
    if not segment.follower.size:
        return segment.follower
    last = segment.follower[-1]
    felt = log.follower[(log.follower["run"] == last["run"]) & (log.follower["sequence"] <= last["sequence"])]
    begun: NDArray[np.bool_] = np.maximum.accumulate(felt["command_sequence"] > 0)
    return np.asarray(felt[begun])


def _learnt_at(felt: Rows, believed: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Command at the newest sample that had been learnt from at each tick; 0 where that was another leader's."""
    newest = np.maximum.accumulate(np.where(believed, np.arange(felt.size), 0))
    same = felt["epoch"][newest] == felt["epoch"]
    return np.where(same, felt["command_sequence"][newest], 0)


def _round_trips(log: SessionLog, felt: Rows) -> Array:
    """Delay that the follower gave its estimator at each of these ticks [s], NaN where none.

    The leader's own row of a command shows which models it had when it sent that command.
    """
    trip, reported = RoundTrip(), np.full(felt.size, np.nan)
    acknowledged = np.zeros(felt.size, dtype=np.int64)
    for epoch in np.unique(felt["epoch"]):
        obeying = felt["epoch"] == epoch
        acknowledged[obeying] = _acknowledged(log.leader[log.leader["epoch"] == epoch], felt, obeying)
    columns = (felt["time_ns"], felt["command_sequence"], acknowledged, felt["model_sequence"], felt["epoch"])
    sent, obeyed = 0, int(felt["epoch"][0])
    for index, (now, command, model, newest, epoch) in enumerate(
        zip(*(column.tolist() for column in columns), strict=True)
    ):
        if epoch != obeyed:
            obeyed = epoch
            trip.restart()
        trip.commanded(command, model)
        delay = trip.applied(command, now)
        if delay is not None:
            reported[index] = delay
        if newest != sent:
            sent = newest
            trip.sent(sent, now)
    return reported


def _acknowledged(leader: Rows, felt: Rows, obeying: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The model that one leader process rendered from when it sent the commands applied in these ticks, 0 for none."""
    ours = leader[np.isin(leader["run"], (0, felt["run"][0]))]
    row = np.searchsorted(ours["sequence"], felt["command_sequence"][obeying], side="right")
    newest = np.concatenate(([0], ours["model_sequence"]))[row]
    # It takes no model learnt from the commands of another leader.
    sent = np.flatnonzero(np.diff(felt["model_sequence"], prepend=0) > 0)
    index = np.searchsorted(felt["model_sequence"][sent], newest, side="right") - 1
    for_whom = np.append(felt["epoch"][sent], 0)[index]
    return np.where(np.isin(for_whom, (0, felt["epoch"][obeying][0])), newest, 0)


def _known_before(known: Array, believed: NDArray[np.bool_]) -> Array:
    """Newest delay given before each sample that was learnt, NaN where there was none since the previous one."""
    newest = np.maximum.accumulate(np.where(np.isnan(known), -1, np.arange(known.size)))[believed]
    fresh = np.diff(newest, prepend=-1) > 0
    return np.where(fresh, known[newest], np.nan)


def _arrivals(clock: Array, newest: NDArray[np.int64], sequences: NDArray[np.int64]) -> Array:
    """Time at which each message of increasing number, or a newer one, had arrived [s]; inf where none did.

    The receiver's ticks have a clock [s] and the newest number that had arrived.
    """
    return np.append(clock, np.inf)[np.searchsorted(np.maximum.accumulate(newest), sequences)]
