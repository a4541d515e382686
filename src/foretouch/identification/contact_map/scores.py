"""Weights of the experts of a contact map, its uncertainty, and the layout of its memory.

Method and reasons are given by `foretouch.identification.ContactMap`. All that one compiled call needs is in one array,
for each array that a call takes costs as much as a short step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import inlined
from foretouch.identification.contact_map.regression import regression_size
from foretouch.identification.exact.law import SETTINGS, STATE_SIZE
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.kernel import judge, uncertainty

# --- notes beside the map --------------------------------------------------------------------------------------------

LEARNT_AT = 0  # time of the newest sample learnt from [s]
PEAK = 1  # largest force since the beginning or the last change [N]
CONTACT = 2  # time in contact since the beginning or the last change [s]
SCORES = 3  # sum of squared late errors of each expert, fading [N^2 s]
SCORED = 6  # time over which they were summed, fading [s]
ALARMS = 7  # mean squared present errors of coarse and fine map [N^2]
MOMENTS = 9  # sums over late predictions, fading: products of what the uncertainty depends on, in pairs
TARGETS = 18  # and their products with the squared error
SPREAD = 21  # factor on the standard deviation from the moments
FADED = 22  # time in contact since the covariance faded last [s]
SNAPSHOTS = 23  # snapshots taken
SNAPPED_AT = 24  # time of the newest snapshot [s]
ABSENT = 25  # for each expert 1 where it is not used
PATIENCE = 28  # time in contact without a change before the next can be detected [s]
IN_A_ROW = 29  # time for which no map explained the force [s]
BEFORE = 30  # force at the previous sample [N]
HORIZON = 31  # delay of the predictions that are scored [s]
TIME = 32  # time of the newest sample [s], NaN before the first
TOUCHED = 33  # 1 from the first contact on
UPDATES = 34  # samples learnt from since the last reset
BEGUN = 35  # value of UPDATES when the map began
CHANGES = 36  # sudden changes since the last reset
NOTES = 37

RING = 128
"""Number of snapshots of the map that are kept to be scored on later samples."""

# --- the array: where each part begins -------------------------------------------------------------------------------

BEGIN_FLAT = 0  # the map, as it crosses the network
BEGIN_MEMORY = BEGIN_FLAT + layout.SIZE  # memory of the material
BEGIN_NOTES = BEGIN_MEMORY + layout.MEMORY
BEGIN_RATES = BEGIN_NOTES + NOTES  # scratch: fractions by which the averages move in one sample
BEGIN_VALUES = BEGIN_RATES + layout.MEMORY  # scratch: the features, then the force of each expert
BEGIN_LAW = BEGIN_VALUES + layout.LARGEST_FEATURES + 3  # the exact estimator
BEGIN_SETTINGS = BEGIN_LAW + STATE_SIZE  # settings of the exact estimator
BEGIN_TIMES = BEGIN_SETTINGS + len(SETTINGS)  # times of the snapshots, together for the search
BEGIN_RING = BEGIN_TIMES + RING  # rows of SIZE + 1: a map and its time in contact
BEGIN_COARSE = BEGIN_RING + RING * (layout.SIZE + 1)
BEGIN_FINE = BEGIN_COARSE + regression_size(0)
TOTAL = BEGIN_FINE + regression_size(1)


Array = NDArray[np.float64]


SCORE_TIME = 1.0
"""Time constant in contact with which scores fade [s]."""
FIRST_ERRORS = (0.1, 0.2, 0.3)
"""Relative errors of law, coarse and fine map that are assumed at first."""
FIRST_TIME = 0.1
"""Time in contact for which the assumed first errors count [s]."""
PENALTIES = (1.2, 1.0, 1.0)
"""Factors on the experts' errors: the law has to be clearly better than the map, for it is right nowhere where it is
not right everywhere."""
SHARPNESS = 8.0
"""Exponent of the inverse error in the weights, the fourth power of its square."""
LEAST_SHARE = 1e-3
FINE_DEPTH, COARSE_DEPTH = 4e-4, 3e-4
"""Depths [m] beyond which the fine map, and short of which the coarse map, has less weight."""

CONTACT_SHARE = 0.05
"""Fraction of the peak above which predictions are scored out of contact too."""

UNCERTAINTY_TIME = 5.0
"""Time constant with which late errors fade [s]."""
LEAST_UNCERTAINTY = 0.01
"""Least standard deviation, relative to the peak force."""
FIRST_UNCERTAINTY = 0.25
"""Standard deviation of a force before any is estimated, relative to the force."""
SPREAD_RATE = 0.01
OUTSIDE = 0.25
"""Fraction of errors beyond one standard deviation; less than a Gaussian's 0.32, for their tails are heavier, and two
standard deviations are to hold 95 % of them."""


_WIDER, _NARROWER = math.exp(SPREAD_RATE * (1.0 - OUTSIDE)), math.exp(-SPREAD_RATE * OUTSIDE)


@inlined
def score(
    flat: Array,
    snapshot: Array,
    values: Array,
    place: float,
    velocity: float,
    force: float,
    contact: bool,
    period: float,
    notes: Array,
    forces: Array,
) -> None:
    """Score an older map on this sample, expert by expert; the errors determine the weights and the uncertainty."""
    mixed = judge(snapshot, values, place, velocity, True, forces)
    if not (contact or mixed > CONTACT_SHARE * notes[PEAK]):
        return
    fading = math.exp(-period / SCORE_TIME)
    for k in range(layout.EXPERTS):
        notes[SCORES + k] = notes[SCORES + k] * fading + period * (forces[k] - force) ** 2
    notes[SCORED] = notes[SCORED] * fading + period
    # Uncertainty: squared errors as a constant and multiples of the squares of force and speed, by least squares.
    fading = math.exp(-period / UNCERTAINTY_TIME)
    squared, variance = (mixed - force) ** 2, uncertainty(flat, mixed, velocity)
    spread = notes[SPREAD] * (_WIDER if squared > variance else _NARROWER)
    notes[SPREAD] = spread = min(max(spread, 0.1), 10.0)
    scale_of, peak = spread * spread, notes[PEAK]
    least = max((LEAST_UNCERTAINTY * peak) ** 2, 1e-12)
    scale = max(variance / scale_of, least)
    weight = 1.0 / (scale * scale)  # so that each counts by its information
    shapes = (1.0, mixed * mixed, (velocity / layout.SPEED) ** 2)
    for i in range(layout.UNCERTAINTIES):
        share = weight * shapes[i]
        notes[TARGETS + i] = notes[TARGETS + i] * fading + share * squared
        for j in range(layout.UNCERTAINTIES):
            k = MOMENTS + layout.UNCERTAINTIES * i + j
            notes[k] = notes[k] * fading + share * shapes[j]
    # None may be negative, or more than the peak: coordinate descent from the former values.
    inverse = 1.0 / scale_of
    for _ in range(3):
        for i in range(layout.UNCERTAINTIES):
            row = MOMENTS + layout.UNCERTAINTIES * i
            if notes[row + i] > 0.0:
                rest = notes[TARGETS + i]
                for j in range(layout.UNCERTAINTIES):
                    if j != i:
                        rest -= notes[row + j] * flat[layout.UNCERTAINTY + j] * inverse
                largest = 1.0 if i == 1 else peak * peak
                flat[layout.UNCERTAINTY + i] = min(scale_of * max(rest / notes[row + i], 0.0), largest)
    flat[layout.UNCERTAINTY] = max(flat[layout.UNCERTAINTY], least)


@inlined
def allot(flat: Array, notes: Array) -> None:
    """Set the weights of the experts from their scores, the assumed first errors, and the resolution of their knots."""
    first = max(FIRST_TIME * math.exp(-notes[CONTACT] / FIRST_TIME), 1e-9)  # for nothing may have been scored yet
    depth = max(flat[layout.REACHED] + flat[layout.ORIGIN], 1e-6)
    total = 0.0
    for k in range(layout.EXPERTS):
        squared = (notes[SCORES + k] + first * (FIRST_ERRORS[k] * notes[PEAK]) ** 2) / (notes[SCORED] + first)
        penalty = PENALTIES[k]
        if k == 1:
            penalty *= max(1.0, COARSE_DEPTH / depth)
        elif k == 2:
            penalty *= max(1.0, depth / FINE_DEPTH)
        unknown = notes[ABSENT + k] > 0.0 or (k == 0 and not flat[layout.LAW] > 0.0)
        fourth = (squared * penalty**2 + 1e-12) ** 2
        share = 0.0 if unknown else 1.0 / (fourth * fourth)
        flat[layout.SHARES + k] = share
        total += share
    if not total > 0.0:  # only the law, and it is not known yet
        flat[layout.SHARES + 1] = total = 1.0
    kept = 0.0
    for k in range(layout.EXPERTS):
        share = flat[layout.SHARES + k]
        flat[layout.SHARES + k] = share / total if share > LEAST_SHARE * total else 0.0
        kept += flat[layout.SHARES + k]
    for k in range(layout.EXPERTS):
        flat[layout.SHARES + k] /= kept
