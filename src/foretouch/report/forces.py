"""Measured, predicted and delayed force of a recording under a delay: what a prediction is scored on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import Learner, predict
from foretouch.messages import SessionLog
from foretouch.quantities import Recording
from foretouch.report.pairs import pair
from foretouch.report.scores import delayed, lowest_mean
from foretouch.report.session import CONTACT_FLOOR
from foretouch.session import replay

__all__ = ["Forces", "forces_under_delay"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Forces:
    """Columns of shape (n,): those of the recording, or of a session at equal command.

    Attributes:
        time: [s].
        position: Of the probe [m].
        measured: As the sensor gives it [N].
        predicted: [N].
        delayed: What the receiver knows [N].
        contact_floor: Smallest force that counts as contact [N].
    """

    time: Array
    position: Array
    measured: Array
    predicted: Array
    delayed: Array
    contact_floor: float


def forces_under_delay(source: Recording | SessionLog, learner: Learner, delay: float) -> Forces:
    """Predict a recording's force, or a session's at the leader's own motion, whose forces are known late.

    Args:
        source: The recording, or the session.
        learner: Fresh.
        delay: Of the forces [s], 0 or more.

    Raises:
        RecordingError: A session with a side missing.
        SettingError: A delay below 0.
    """
    if isinstance(source, Recording):
        felt = source.force - lowest_mean(source.time, source.force)
        predicted = predict(source, learner, delay=delay)
        known = delayed(source.time, felt, delay)
        return Forces(source.time, source.position, source.force, predicted, known, source.contact_floor)
    again, pairs = replay(source, learner, delay=delay), pair(source)
    ticks = np.searchsorted(source.leader["sequence"], pairs.leader["sequence"])
    return Forces(
        pairs.time,
        pairs.follower["position"],
        pairs.follower["sensor_force"],
        again.predicted[ticks],
        again.delayed[ticks],
        CONTACT_FLOOR,
    )
