"""The scoring, the same for a session, a recording and a benchmark."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from foretouch.errors import InputError, SettingError
from foretouch.errors.checks import NUMBER, require_type
from foretouch.identification.force_calibration import (
    THRESHOLD_SHARE,
    TOUCH,
    columns_of,
    lowest_mean,
    median_period,
    never_leaves_contact,
    zero_in_hindsight,
)
from foretouch.models.contact_map.layout import CLEAR, LETTING_GO, PLAYS
from foretouch.quantities import Array, ByValue, Flags
from foretouch.report.numbers import finite_or_none, runs

JND_SHARE = 0.10  # Just noticeable difference of force, as a fraction of the force
JND_FORCE = 0.05  # The smallest just noticeable difference that is asked for [N]

STATUSES: dict[str, str] = {
    "nothing_to_score": "no sample is in the window, those that were guarded or not coupled left out",
    "no_contact": "the measured force never rises above the contact floor in the window, but for noise",
    "prediction_not_finite": "a predicted force is not a number: its error has no bound and is given as null",
    "offset_unobservable": "the probe never leaves contact, so that the zero of its force is not known and is a "
    "convention: who knows it gives it (--force-offset)",
    "ok": "scored",
}
"""Values of `Scores.status`; where several hold, the first of them in this order."""


@dataclass(frozen=True, eq=False)
class Scores(ByValue):
    """Quality of a predicted force. A metric is None where there is nothing to measure it on.

    Attributes:
        samples: Samples in all.
        scored_samples: Samples that the errors are taken over: in the window, and in contact or predicted to be.
        contact_force_rms_N: RMS of the measured force over the contact samples of the window.
        prediction_rmse_N: RMS of predicted less measured force over the scored samples.
        prediction_error_percent: The same as a fraction of `contact_force_rms_N`.
        error_up_to_constant_percent: The same of the standard deviation of predicted less measured force in place of
            its RMS, where the zero of the force is not known (``offset_unobservable``); None elsewhere.
        delayed_force_error_percent: The delayed force's RMS error over the contact samples, as the same fraction.
        delayed_force_rmse_N: That RMS error.
        within_jnd_percent: Share of contact samples whose error is at most max(10 % of the force, 0.05 N).
        phantom_force_rms_N: RMS of the prediction over the window's samples out of contact.
        missed_contact_percent: Share of contact samples predicted below the threshold.
        status: A key of `STATUSES`.
        threshold_N: The measured force above which a sample is in contact; None without contact.
        in_contact: The scoring flag, for every sample, those outside the window too.
        measured_force: Measured force less its zero [N], every sample.
        window: Which samples are in the window, without those that are skipped.
        force_zero_N: Zero of the measured force; None without samples.
        force_zero_from: What that is: given, or as `foretouch.identification.force_calibration.zero_in_hindsight` says.
    """

    samples: int
    scored_samples: int
    contact_force_rms_N: float | None
    prediction_rmse_N: float | None
    prediction_error_percent: float | None
    error_up_to_constant_percent: float | None
    delayed_force_error_percent: float | None
    delayed_force_rmse_N: float | None
    within_jnd_percent: float | None
    phantom_force_rms_N: float | None
    missed_contact_percent: float | None
    status: str
    threshold_N: float | None
    in_contact: Flags
    measured_force: Array
    window: Flags
    force_zero_N: float | None
    force_zero_from: str

    def coverage(self, predicted_force: Array, deviation: Array | None) -> dict[str, float | None]:
        """Calibration of the predicted force's standard deviation [N]: contact samples within one and two of it."""
        known = self.in_contact & self.window & np.isfinite(np.nan if deviation is None else deviation)
        if deviation is None or not known.any():
            return {"median_N": None, "within_one_percent": None, "within_two_percent": None}
        error, deviation = np.abs(predicted_force - self.measured_force)[known], deviation[known]
        return {
            "median_N": float(np.median(deviation)),
            "within_one_percent": float(100.0 * np.mean(error <= deviation)),
            "within_two_percent": float(100.0 * np.mean(error <= 2.0 * deviation)),
        }

    def largest_phantom(self, predicted_force: Array) -> float | None:
        """Largest prediction over the window's samples out of contact [N]; None where there are none."""
        apart = predicted_force[self.window & ~self.in_contact]
        return finite_or_none(float(np.abs(apart).max())) if apart.size else None


def score_prediction(
    time: ArrayLike,
    measured_force: ArrayLike,
    predicted_force: ArrayLike,
    delayed_force: ArrayLike,
    *,
    contact_floor: float,
    score_from: float = 1.5,
    score_to: float | None = None,
    position: ArrayLike | None = None,
    offset: float | None = None,
    delayed_offset: float | None = None,
    skipped: ArrayLike | None = None,
) -> Scores:
    r"""Score a predicted force against the measured one.

    The measured force F is the input less its zero: the one given, or else the lowest 50 ms mean over all samples,
    or the level of free air where that is told apart (`zero_in_hindsight`). With the 98th percentile :math:`F_{98}`
    over the window, a sample is in contact where

    .. math:: F > \theta = \max(0.05\, F_{98},\; \text{contact floor}).

    With the contact samples C of the window, and the scored samples S, which are also those that are predicted above
    :math:`\theta`, the errors of the prediction and of the delayed force D are

    .. math:: e = 100\,\sqrt{\operatorname{mean}_S (\hat F - F)^2} \,\Big/\, \sqrt{\operatorname{mean}_C F^2},
        \qquad
        d = 100\,\sqrt{\operatorname{mean}_C (D - F)^2} \,\Big/\, \sqrt{\operatorname{mean}_C F^2}.

    Where something pulls, a sample with :math:`F < -\theta` is in contact too, and the absolute force counts in place
    of the force. It does where, after a contact and within 5 mm outside of it, the force falls below zero by a tenth of
    :math:`F_{98}` and comes back while the probe still goes out: friction lasts until the probe turns.

    So a recording and a delay have one d, whatever predicts, and what is predicted in free air counts against the
    prediction alone. There is contact in it if some mean over 10 ms is above
    :math:`\theta` too: single samples may be noise. A prediction that is not finite counts as above the threshold, as
    outside the just noticeable difference and as missed contact; the RMS figures that it enters are None, so it
    can never look good.

    Args:
        time: Sample times [s], increasing, shape (n,); they count from the first.
        measured_force: As the sensor gives it [N], offset included, finite, shape (n,).
        predicted_force: Predicted at the same samples [N], shape (n,).
        delayed_force: Known at the receiver at the same samples [N], shape (n,), as the sensor gave it, see
            `foretouch.report.delayed_force`; not finite where nothing had arrived, which counts as no force.
        contact_floor: Smallest force that counts as contact [N], positive.
        score_from: Start of the window [s], included.
        score_to: End of the window [s], included; None for the last sample.
        position: Probe position [m], shape (n,). With it, a recording that never leaves contact is noticed
            (``offset_unobservable``); the force alone does not show this.
        offset: Zero of the measured force [N] where it is known; None to find it.
        delayed_offset: Zero of the delayed force [N]: 0 where the sender took that off; None for that of the
            measured force.
        skipped: Samples that are out of every window, flags of shape (n,); their force still tells the zero.

    Raises:
        InputError: Arrays of other lengths, time that does not increase, a measured force that is not finite.
        SettingError: A floor that is not positive, or a window that ends before it begins.
        ArgumentTypeError: Columns or numbers that are none.
    """
    for name, value in {"contact_floor": contact_floor, "score_from": score_from}.items():
        require_type(name, value, NUMBER, "a number")
    for name, given in {"score_to": score_to, "offset": offset, "delayed_offset": delayed_offset}.items():
        require_type(name, given, (*NUMBER, type(None)), "a number, or None")
    clock, measured, predicted, known = columns_of(time, measured_force, predicted_force, delayed_force)
    _check(clock, measured, contact_floor, score_from, score_to)
    zero, origin = offset, "given"
    if clock.size:
        if zero is None:
            zero, origin = zero_in_hindsight(clock, measured, position, contact_floor)
        measured, known = measured - zero, known - (zero if delayed_offset is None else delayed_offset)
    known = np.where(np.isfinite(known), known, 0.0)
    window = _window(clock, score_from, score_to)
    if skipped is not None:
        (left_out, _) = columns_of(skipped, clock)
        window &= left_out == 0.0
    untouched = np.zeros(clock.size, dtype=np.bool_)
    nothing = Scores(clock.size, 0, *(None,) * 9, "nothing_to_score", None, untouched, measured, window, zero, origin)
    if not window.any():
        return nothing
    threshold = max(THRESHOLD_SHARE * float(np.percentile(measured[window], 98.0)), contact_floor)
    pressed = in_contact = measured > threshold
    force, guess = measured, predicted
    if position is not None and _something_pulls(columns_of(position)[0], measured, pressed, threshold):
        force, guess = np.abs(measured), np.abs(predicted)
        in_contact = force > threshold
    contact = in_contact & window
    # The highest mean is the lowest one of the force turned over.
    if not contact.any() or -lowest_mean(clock[window], -measured[window], TOUCH) <= threshold:
        return replace(nothing, status="no_contact")
    finite = np.isfinite(predicted)
    scored = window & (in_contact | ~finite | (guess > threshold))
    contact_rms = _rms(measured[contact])
    rmse = _rms((predicted - measured)[scored])
    delayed_rmse = _rms((known - measured)[contact])
    tolerance = np.maximum(JND_SHARE * force[contact], JND_FORCE)
    near = np.abs(predicted[contact] - measured[contact]) <= tolerance * (1.0 + 1e-9)
    predicted_contact = guess[contact] >= threshold
    apart = window & ~in_contact
    status = "ok"
    up_to_constant = None
    if position is not None and never_leaves_contact(position, measured, pressed):
        status, up_to_constant = "offset_unobservable", float(np.std((predicted - measured)[scored]))
    if not finite[window].all():
        status = "prediction_not_finite"
    return Scores(
        samples=clock.size,
        scored_samples=int(scored.sum()),
        contact_force_rms_N=contact_rms,
        prediction_rmse_N=finite_or_none(rmse),
        prediction_error_percent=finite_or_none(100.0 * rmse / contact_rms),
        error_up_to_constant_percent=None
        if up_to_constant is None
        else finite_or_none(100.0 * up_to_constant / contact_rms),
        delayed_force_error_percent=finite_or_none(100.0 * delayed_rmse / contact_rms),
        delayed_force_rmse_N=finite_or_none(delayed_rmse),
        within_jnd_percent=100.0 * float(near.mean()),
        phantom_force_rms_N=finite_or_none(_rms(predicted[apart])) if apart.any() else None,
        missed_contact_percent=100.0 * (1.0 - float(predicted_contact.mean())),
        status=status,
        threshold_N=threshold,
        in_contact=in_contact,
        measured_force=measured,
        window=window,
        force_zero_N=zero,
        force_zero_from=origin,
    )


def delayed_force(time: ArrayLike, force: ArrayLike, delay: float) -> Array:
    """The force that is known a delay later: the newest sample not later than t - delay, NaN where there is none.

    Times are compared with a tolerance of a thousandth of the median sample period, so that a delay of a whole
    number of samples is that number of samples in spite of rounding.

    Args:
        time: Sample times [s], increasing, shape (n,).
        force: Force at those times [N], shape (n,).
        delay: One-way delay [s], 0 or more.

    Raises:
        InputError: Arrays of other lengths, or time that does not increase.
        SettingError: A delay below 0 or not finite.
        ArgumentTypeError: Columns or a delay that are no numbers.
    """
    clock, values = columns_of(time, force)
    require_type("delay", delay, NUMBER, "a number, in s")
    if not (np.isfinite(delay) and delay >= 0.0):
        raise SettingError("delay", delay, "must be 0 s or more")
    _increasing(clock)
    newest = np.searchsorted(clock, clock - delay + 1e-3 * median_period(clock), side="right") - 1
    return np.where(newest >= 0, values[np.maximum(newest, 0)], np.nan)


def _check(clock: Array, measured: Array, contact_floor: float, score_from: float, score_to: float | None) -> None:
    _increasing(clock)
    bad = ~np.isfinite(measured)
    if bad.any():
        raise InputError(f"measured force, sample {int(np.argmax(bad))}: every value must be finite")
    if not (np.isfinite(contact_floor) and contact_floor > 0.0):
        raise SettingError("contact_floor", contact_floor, "must be above 0 N")
    if not np.isfinite(score_from):
        raise SettingError("score_from", score_from, "must be finite")
    if score_to is not None and not score_to > score_from:
        raise SettingError("score_to", score_to, f"must be later than score_from = {score_from:g} s")


def _increasing(clock: Array) -> None:
    bad = ~np.isfinite(clock)
    bad[1:] |= np.diff(clock) <= 0.0
    if bad.any():
        raise InputError(f"time, sample {int(np.argmax(bad))}: time must be finite and increase")


def _window(clock: Array, score_from: float, score_to: float | None) -> Flags:
    """The samples between two times that count from the first sample, both ends included."""
    since = clock - clock[:1]
    tolerance = 1e-3 * median_period(clock)
    inside: Flags = since >= score_from - tolerance
    if score_to is not None:
        inside &= since <= score_to + tolerance
    return inside


def _something_pulls(position: Array, force: Array, pressed: Flags, threshold: float) -> bool:
    """Whether something holds the probe after some contact, and lets go further out."""
    least = threshold * CLEAR / THRESHOLD_SHARE
    return any(
        _lets_go(position[begin:end], -force[begin:end], position[begin - 1], least)
        for begin, end in runs(~pressed)
        if begin > 0
    )


def _lets_go(position: Array, pull: Array, left: float, least: float) -> bool:
    """Whether what pulls in a stay out of contact, which was left at a position, has ended before the probe turned."""
    out = int(np.argmin(np.maximum(position, left - LETTING_GO))) + 1  # until it turns, or is too far away
    position, pull = position[:out], pull[:out]
    if pull.size < 2:
        return False
    largest = np.minimum(pull[1:], pull[:-1]).max()  # one sample alone may be anything
    if not largest > least:
        return False
    held = np.flatnonzero(pull > 0.5 * largest)[-1]
    gone = (pull < CLEAR * largest) & (position < position[held] - PLAYS[1])
    return bool(gone[held:].any())


def _rms(values: Array) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sqrt(np.mean(np.square(values))))
