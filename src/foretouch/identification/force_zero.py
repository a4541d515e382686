"""Where the force of a recording is zero, and whether the recording shows it at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import InputError
from foretouch.quantities import Recording, numbers_of

__all__ = [
    "OFFSET_WINDOW",
    "THRESHOLD_SHARE",
    "TOUCH",
    "columns_of",
    "is_zero_unobservable",
    "lowest_mean",
    "median_period",
    "never_leaves_contact",
]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

OFFSET_WINDOW = 0.05
"""Length of the window whose lowest mean is the zero of the measured force [s]."""

THRESHOLD_SHARE = 0.05
"""The contact threshold as a share of the 98th percentile of the measured force."""

TOUCH = 0.01
"""A force that is not above the threshold in the mean of any so long time [s] is noise, and no contact."""

REST_SLOPE = 0.25
"""Force slope below the contact threshold, as a share of the slope above it, from which on a recording counts as
never out of contact. Measured files: foam and skin at most 0.1, preloaded springs at least 0.8."""

FEWEST_SAMPLES = 10
"""Samples that an offset window must hold, unless most windows of the file hold fewer."""

BLOCK, OVERLAP = 1 << 18, 1 << 15
"""Samples whose means are taken at once, and how many of them are those before again: more than a window holds at any
rate below 600 kHz. Shorter recordings are one block."""


def lowest_mean(time: ArrayLike, force: ArrayLike, window: float = OFFSET_WINDOW) -> float:
    """The lowest mean of the force over a time window: where the sensor's zero is, seen from afterwards.

    A window ends at each sample and reaches back by its length; it counts once the samples before it fill it, and
    if it holds 10 samples, or as many as most windows of the file do, so that one sample after a gap is no mean. At
    an even rate these are all runs of ``window / sample period`` samples. A file shorter than the window has one
    mean, that of all its samples.

    Args:
        time: Sample times [s], increasing, shape (n,).
        force: Measured force [N], shape (n,), n of at least 1.
        window: Its length [s].
    """
    clock, values = columns_of(time, force)
    period = median_period(clock)
    first = np.searchsorted(clock, clock - window + 1e-3 * period, side="right")
    last = np.arange(1, clock.size + 1)
    held = last - first
    full = clock - clock[0] >= window - 1.001 * period
    if not full.any():
        return float(values.mean())
    full &= held >= min(FEWEST_SAMPLES, float(np.median(held[full])))
    middle = values.mean()  # sums of small numbers lose fewer digits
    sums = np.concatenate(([0.0], np.cumsum(values - middle)))
    return float(((sums[last] - sums[first])[full] / held[full]).min() + middle)


def is_zero_unobservable(recording: Recording) -> bool:
    """Whether the probe never leaves contact: what `foretouch.report.score` calls ``offset_unobservable``.

    However long the recording is, this takes little memory beside it.

    Args:
        recording: Of presses; its `contact_floor` is the least force that counts as contact.
    """
    time, force = recording.time, recording.force
    # What is asked of the force less its zero is asked of the force itself: no copy of it is made.
    zero = _lowest(time, force, 1.0, OFFSET_WINDOW)
    threshold = max(THRESHOLD_SHARE * (float(np.percentile(force, 98.0)) - zero), recording.contact_floor)
    in_contact = force > threshold + zero
    if not in_contact.any() or -_lowest(time, force, -1.0, TOUCH) - zero <= threshold:
        return False
    return never_leaves_contact(recording.position, force, in_contact)


def _lowest(time: Array, force: Array, sign: float, window: float) -> float:
    """`lowest_mean` of the force times a sign, block by block."""
    found, begin, end = np.inf, 0, 0
    while end < time.size:
        end = min(begin + BLOCK, time.size)
        found = min(found, lowest_mean(time[begin:end], sign * force[begin:end], window))
        begin = end - OVERLAP
    return float(found)


def never_leaves_contact(position: ArrayLike, force: Array, in_contact: Flags) -> bool:
    """Whether the force still follows the position below the contact threshold, as it does nowhere in free air."""
    (place, _) = columns_of(position, force)
    above = _slope(place, force, in_contact)
    below = _slope(place, force, ~in_contact)
    return above > 0.0 and below > REST_SLOPE * above


def _slope(position: Array, force: Array, chosen: Flags) -> float:
    """Least-squares slope of force over position [N/m] at the chosen samples, 0 where their position does not vary."""
    if np.count_nonzero(chosen) < 3:
        return 0.0
    middle, level = position.mean(where=chosen), force.mean(where=chosen)
    products = squares = 0.0
    for begin in range(0, position.size, BLOCK):
        part = slice(begin, begin + BLOCK)
        centred = position[part][chosen[part]] - middle
        products += float((centred * (force[part][chosen[part]] - level)).sum())
        squares += float((centred**2).sum())
    varies = position.max(where=chosen, initial=-np.inf) > position.min(where=chosen, initial=np.inf)
    return products / squares if varies else 0.0


def columns_of(*columns: ArrayLike) -> tuple[Array, ...]:
    """Columns as arrays of one shape (n,); `InputError` where they have others or are no numbers."""
    arrays = tuple(numbers_of("a column", column) for column in columns)
    shapes = {array.shape for array in arrays}
    if len(shapes) > 1 or arrays[0].ndim != 1:
        raise InputError(f"columns of shapes {', '.join(str(array.shape) for array in arrays)}: all must be (n,)")
    return arrays


def median_period(clock: Array) -> float:
    """Median sample period [s], 0 for a single sample."""
    return float(np.median(np.diff(clock))) if clock.size > 1 else 0.0
