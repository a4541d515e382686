"""Forces of a recording under a delay, by which a prediction is scored, and remarks on what affects it there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification import Learner, predict
from foretouch.identification.force_calibration import TOUCH, lowest_mean, zero_in_hindsight
from foretouch.messages import SessionLog
from foretouch.quantities import Array, ByValue, Flags, Recording
from foretouch.report.perception import LargestJump, largest_jump, time_to_accuracy
from foretouch.report.rows import not_scored, pair
from foretouch.report.scores import STATUSES, Scores, delayed_force
from foretouch.report.session import CONTACT_FLOOR
from foretouch.session import replay


@dataclass(frozen=True, eq=False)
class Forces(ByValue):
    """Columns of shape (n,): those of the recording, or of a session at equal command.

    Attributes:
        time: [s].
        position: Position of the probe [m].
        measured: Force as the sensor gives it [N].
        predicted: Predicted force [N].
        delayed: Newest force that the receiver has, less its zero [N]; 0 before the first one.
        contact_floor: Smallest force that counts as contact [N].
        standard_deviation: Standard deviation of the predicted force [N], NaN where the model has none; None
            where no model is used, as for the next two.
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

    def honesty(self, scores: Scores) -> dict[str, float | None]:
        """The largest force that is predicted where nothing is touched, and how often the standard deviation holds."""
        coverage = scores.coverage(self.predicted, self.standard_deviation)
        return {
            "largest_phantom_force_N": scores.largest_phantom(self.predicted),
            "within_one_deviation_percent": coverage["within_one_percent"],
            "within_two_deviations_percent": coverage["within_two_percent"],
        }

    def perception(self, scores: Scores) -> dict[str, float | None]:
        """Noticeable effects in the scores of all samples: the largest jump by a model, and the time to accuracy."""
        jump = LargestJump(None, None, None)
        if self.jump is not None and self.period is not None:
            jump = largest_jump(self.time, self.jump, self.period)
        scored = scores.in_contact if self.skipped is None else scores.in_contact & ~self.skipped
        accurate = time_to_accuracy(self.time, scores.measured_force, self.predicted, scored)
        return {**jump.figures("largest_update_jump"), "time_to_ten_percent_s": accurate}


def require_delay_within(source: Recording | SessionLog, delay: float) -> None:
    """Refuse a delay [s] that is below 0, not finite, or as long as a recording or longer, with a SettingError.

    Nothing would arrive before the recording ends; of a session the longest segment is taken.
    """
    require("delay", delay, at_least=0.0)
    time = source.time if isinstance(source, Recording) else source.longest().leader["time_ns"] * 1e-9
    length = float(time[-1] - time[0]) if time.size else 0.0
    if time.size and delay >= length:
        rule = f"the recording is {length:.3g} s long, and nothing would arrive before it ends: give a shorter delay"
        raise SettingError("delay", delay, rule)


def forces_under_delay(
    source: Recording | SessionLog, learner: Learner, delay: float, zero: float | None = None
) -> Forces:
    """Predict a recording's force, or a session's at the leader's own motion, whose forces are known late.

    The learner is fresh, and the zero [N] that of a recording's forces, None to find it in hindsight. Of a session the
    longest segment is taken; a RecordingError says that it has one side alone. The delay of the forces [s] is refused
    as by `require_delay_within`.
    """
    require_delay_within(source, delay)
    if isinstance(source, Recording):
        if zero is None:
            zero, _ = zero_in_hindsight(source.time, source.force, source.position, source.contact_floor)
        predicted = predict(source, learner, delay=delay)
        known = np.nan_to_num(delayed_force(source.time, source.force - zero, delay), nan=0.0)
        columns = source.time, source.position, source.force, predicted.force, known
        models = predicted.standard_deviation, predicted.jump, np.diff(source.time, prepend=np.nan)
        return Forces(*columns, source.contact_floor, *models)
    again, pairs, leader = replay(source, learner, delay=delay), pair(source), source.longest().leader
    ticks = np.searchsorted(leader["sequence"], pairs.leader["sequence"])
    predicted, period = again.predicted, np.diff(leader["time_ns"] * 1e-9, prepend=np.nan)[ticks]
    motion = pairs.time, pairs.follower["position"], pairs.follower["sensor_force"]
    models = predicted.standard_deviation[ticks], predicted.jump[ticks], period
    return Forces(*motion, predicted.force[ticks], again.delayed[ticks], CONTACT_FLOOR, *models, not_scored(pairs))


APART = 0.1  # Touches that are nearer to each other than this [s] are one
BEGINNING = 0.02  # A recording begins in contact if it is in contact for this time from the first sample on [s]

GAP, SHORTEST_GAP = 10.0, 0.02
"""A time between two samples is a gap if it exceeds this multiple of the usual one, and this length [s]."""

SLOWEST = 0.008  # With more time between two samples than this [s] a recording is slow: an impact lasts about as long
OUTERMOST = 0.15  # Drift is looked for in this outermost part of the range of positions
FEWEST_SAMPLES, SPAN_SHARE = 50, 0.5
"""Drift is looked for if there are at least this many samples there, over at least this part of the recording."""
CLEAR = 3.0  # Drift over the recording is reported from this multiple of the residual on


def remarks(forces: Forces, scores: Scores, delay: float, score_from: float | None = None) -> tuple[str, ...]:
    """Sentences on what is special about a recording: none for most.

    Among them: what the status means where it is not ``ok``; a recording that begins in contact, touches only once,
    whose probe never moves, whose force drifts in free air, that has gaps in time or is sampled slowly. The scores are
    those of all samples; scoring begins at `score_from` [s after the first sample], where that is known.
    """
    return tuple(_said(forces, scores, delay, score_from))


def _said(forces: Forces, scores: Scores, delay: float, score_from: float | None) -> Iterator[str]:
    time = forces.time - (forces.time[0] if forces.time.size else 0.0)
    if scores.status != "ok":
        yield f"{scores.status}: {_meaning(scores.status, time, forces.skipped is None, score_from)}."
    if time.size > 1:
        yield from _of_time(time)
        if not np.ptp(forces.position) > 0.0:
            yield "The probe never moves: how the force depends on depth and velocity cannot be learnt."
    if scores.status == "no_contact" and -lowest_mean(time, -scores.measured_force, TOUCH) > forces.contact_floor:
        yield "It touches outside of the scoring window only: --score-from and --score-to choose another one."
    if scores.status in ("ok", "prediction_not_finite") and scores.in_contact.any():
        drift = list(_of_drift(time, forces.position, scores))
        yield from drift or _of_touches(time, scores.in_contact, delay)  # what drifts cannot tell when it touches


def _meaning(status: str, time: Array, all_count: bool, score_from: float | None) -> str:
    if status == "nothing_to_score" and score_from is not None and time.size and time[-1] < score_from:
        return f"the recording ends after {time[-1]:.3g} s, before --score-from {score_from:g}"
    if status == "nothing_to_score" and all_count:
        return "no sample is in the window"
    return STATUSES[status]


def _of_time(time: Array) -> Iterator[str]:
    periods = np.diff(time)
    usual = float(np.median(periods))
    gaps = periods[periods > max(GAP * usual, SHORTEST_GAP)]
    if gaps.size:
        many = "a gap" if gaps.size == 1 else f"{gaps.size} gaps"
        yield f"Time has {many}, up to {gaps.max():.2f} s long: what the material felt meanwhile is not known."
    if usual > SLOWEST:
        yield f"It has {1.0 / usual:.0f} samples a second: what is over between two of them, as an impact, is not seen."


def _of_touches(time: Array, in_contact: Flags, delay: float) -> Iterator[str]:
    touched = time[in_contact]
    breaks = np.flatnonzero(np.diff(touched) > APART)
    begin = float(touched[0])
    apart = time[~in_contact & (time > BEGINNING)]
    if in_contact[time <= BEGINNING].mean() > 0.5 and apart.size:
        left = float(apart[0])
        yield (
            f"It begins in contact: surface and zero of the force are only known from {left:.2f} s on, when the "
            "probe first leaves it, and what is predicted before is uncertain."
        )
    elif not breaks.size:
        unknown = 100.0 * float(np.mean(touched < begin + delay))
        yield (
            f"It touches once, from {begin:.2f} to {touched[-1]:.2f} s: what is felt is known {delay:g} s later, and "
            f"{unknown:.0f} % of the contact is over by then."
        )


def _of_drift(time: Array, position: Array, scores: Scores) -> Iterator[str]:
    """Where the probe is furthest out the force should depend on position at most."""
    outside = position < position.min() + OUTERMOST * np.ptp(position)
    if outside.sum() < FEWEST_SAMPLES or np.ptp(time[outside]) < SPAN_SHARE * time[-1]:
        return
    columns = np.column_stack((time[outside] - time[outside].mean(), position[outside], np.ones(int(outside.sum()))))
    force = scores.measured_force[outside]
    scale = np.abs(columns).max(axis=0)
    fit = np.linalg.lstsq(columns / scale, force, rcond=None)[0] / scale
    drift = float(fit[0]) * float(time[-1])
    with np.errstate(over="ignore"):
        left = float(np.sqrt(np.mean(np.square(force - columns @ fit))))
    if abs(drift) > max(scores.threshold_N or 0.0, CLEAR * left):
        yield (
            f"The force in free air drifts by {fit[0]:+.2g} N/s: its zero is that of one moment, and what drifts "
            "away from it counts as error."
        )
