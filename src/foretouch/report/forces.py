"""Measured, predicted and delayed force of a recording under a delay: what a prediction is scored on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification import Learner, predict
from foretouch.messages import SessionLog
from foretouch.quantities import ByValue, Recording
from foretouch.report.pairs import not_scored, pair
from foretouch.report.perception import LargestJump, largest_jump, time_to_accuracy
from foretouch.report.scores import Scores, delayed, lowest_mean
from foretouch.report.session import CONTACT_FLOOR
from foretouch.session import replay

__all__ = ["Forces", "forces_under_delay", "require_delay_within"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Forces(ByValue):
    """Columns of shape (n,): those of the recording, or of a session at equal command.

    Attributes:
        time: [s].
        position: Of the probe [m].
        measured: As the sensor gives it [N].
        predicted: [N].
        delayed: What the receiver knows, its zero taken off [N]; 0 while it knows nothing.
        contact_floor: Smallest force that counts as contact [N].
        standard_deviation: Of the predicted force [N], NaN where the model carries no doubt; None where models have
            no part in it, as in the next two.
        jump: Change of the predicted force by the model that came at the sample [N], 0 where none came.
        period: Time since the sample before where the prediction was made [s], NaN at the first.
        skipped: Flags of the samples that are not scored, as in the session's own report; None for a recording.
    """

    time: Array
    position: Array
    measured: Array
    predicted: Array
    delayed: Array
    contact_floor: float
    standard_deviation: Array | None = None
    jump: Array | None = None
    period: Array | None = None
    skipped: Flags | None = None

    def perception(self, scores: Scores) -> dict[str, float | None]:
        """What an operator would notice, as named figures: the largest jump by a model, and the time to accuracy.

        Args:
            scores: What `score` gave of these columns, all samples among them.
        """
        jump = LargestJump(None, None, None)
        if self.jump is not None and self.period is not None:
            jump = largest_jump(self.time, self.jump, self.period)
        scored = scores.in_contact if self.skipped is None else scores.in_contact & ~self.skipped
        accurate = time_to_accuracy(self.time, scores.measured_force, self.predicted, scored)
        return {**jump.figures("largest_update_jump"), "time_to_ten_percent_s": accurate}


def require_delay_within(source: Recording | SessionLog, delay: float) -> None:
    """Refuse a delay under which nothing of a recording arrives before it ends.

    Args:
        source: The recording, or the session, whose longest stretch is taken.
        delay: Of the forces [s].

    Raises:
        SettingError: It is below 0, not finite, or as long as the recording or longer.
    """
    require("delay", delay, at_least=0.0)
    time = source.time if isinstance(source, Recording) else source.longest().leader["time_ns"] * 1e-9
    length = float(time[-1] - time[0]) if time.size else 0.0
    if time.size and delay >= length:
        rule = f"the recording is {length:.3g} s long, and nothing would arrive before it ends: give a shorter delay"
        raise SettingError("delay", delay, rule)


def forces_under_delay(source: Recording | SessionLog, learner: Learner, delay: float) -> Forces:
    """Predict a recording's force, or a session's at the leader's own motion, whose forces are known late.

    Args:
        source: The recording, or the session, whose longest stretch is taken.
        learner: Fresh.
        delay: Of the forces [s], 0 or more.

    Raises:
        RecordingError: A session with a side missing.
        SettingError: As `require_delay_within`.
    """
    require_delay_within(source, delay)
    if isinstance(source, Recording):
        felt = source.force - lowest_mean(source.time, source.force)
        predicted = predict(source, learner, delay=delay)
        known = np.nan_to_num(delayed(source.time, felt, delay), nan=0.0)
        return Forces(
            source.time,
            source.position,
            source.force,
            predicted.force,
            known,
            source.contact_floor,
            predicted.standard_deviation,
            predicted.jump,
            _periods(source.time),
        )
    again, pairs, leader = replay(source, learner, delay=delay), pair(source), source.longest().leader
    ticks = np.searchsorted(leader["sequence"], pairs.leader["sequence"])
    return Forces(
        pairs.time,
        pairs.follower["position"],
        pairs.follower["sensor_force"],
        again.predicted.force[ticks],
        again.delayed[ticks],
        CONTACT_FLOOR,
        again.predicted.standard_deviation[ticks],
        again.predicted.jump[ticks],
        _periods(leader["time_ns"] * 1e-9)[ticks],
        not_scored(pairs),
    )


def _periods(time: Array) -> Array:
    """Time since the sample before, NaN at the first."""
    return np.concatenate((np.full(min(1, time.size), np.nan), np.diff(time)))
