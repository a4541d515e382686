"""How the experts of a contact map share its force and how far it is to be doubted, and where their memory stands.

What and why is told by `foretouch.identification.ContactMapBank`. All that one compiled call needs stands in one array,
for each array that a call takes costs as much as a short step.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.contact_map.regression import regression_size
from foretouch.identification.exact.law import SETTINGS, STATE_SIZE
from foretouch.models.contact_map.kernel import doubt, judge
from foretouch.models.contact_map.layout import (
    DOUBT,
    DOUBTS,
    EXPERTS,
    LARGEST_FEATURES,
    LAW,
    MEMORY,
    ORIGIN,
    REACHED,
    SHARES,
    SIZE,
    SPEED,
)

# --- notes beside the map --------------------------------------------------------------------------------------------

LEARNT_AT = 0  # time of the newest sample learnt from [s]
PEAK = 1  # largest force since the beginning or the last change [N]
CONTACT = 2  # time in contact since then [s]
SCORES = 3  # sum of squared late errors of each expert, fading [N^2 s]
SCORED = 6  # time over which they were summed, fading [s]
ALARMS = 7  # mean squared errors at once of coarse and fine map [N^2]
MOMENTS = 9  # sums over late predictions, fading: products of what the doubt depends on, in pairs
TARGETS = 18  # and with the squared error
SPREAD = 21  # by how much the standard deviation from the moments is to be multiplied
FADED = 22  # time in contact since the covariance faded last [s]
SNAPSHOTS = 23  # taken so far
SNAPPED_AT = 24  # time of the newest [s]
ABSENT = 25  # for each expert 1 where it is not to be asked
PATIENCE = 28  # contact without a change before the next can be called [s]
IN_A_ROW = 29  # time for which no map explained the force [s]
BEFORE = 30  # force at the sample before [N]
HORIZON = 31  # how late a prediction is that is scored [s]
TIME = 32  # of the newest sample [s], NaN before the first
TOUCHED = 33  # 1 from the first contact on
UPDATES = 34  # samples learnt from since the last reset
BEGUN = 35  # how many they were when the map began
CHANGES = 36  # sudden changes since the last reset
NOTES = 37

RING = 128
"""Snapshots of the map that are kept to be scored on what came later."""

# --- the array: where each part begins -------------------------------------------------------------------------------

BEGIN_FLAT = 0  # the map, as it crosses the network
BEGIN_MEMORY = BEGIN_FLAT + SIZE  # what the material remembers
BEGIN_NOTES = BEGIN_MEMORY + MEMORY
BEGIN_RATES = BEGIN_NOTES + NOTES  # scratch: how far the averages go in one sample
BEGIN_VALUES = BEGIN_RATES + MEMORY  # scratch: the features, then what each expert says
BEGIN_LAW = BEGIN_VALUES + LARGEST_FEATURES + 3  # the exact estimator
BEGIN_SETTINGS = BEGIN_LAW + STATE_SIZE  # of that
BEGIN_TIMES = BEGIN_SETTINGS + len(SETTINGS)  # of the snapshots, together: they are walked
BEGIN_RING = BEGIN_TIMES + RING  # rows of SIZE + 1: a map and its time in contact
BEGIN_COARSE = BEGIN_RING + RING * (SIZE + 1)
BEGIN_FINE = BEGIN_COARSE + regression_size(0)
TOTAL = BEGIN_FINE + regression_size(1)


Array = NDArray[np.float64]

_compiled = compiled(error_model="numpy")
_inlined = compiled(error_model="numpy", forceinline=True)

SCORE_TIME = 1.0
"""Scores fade in so much time in contact [s]."""
FIRST_ERRORS = (0.1, 0.2, 0.3)
"""Relative error of law, coarse and fine map that is assumed at first, for ..."""
FIRST_TIME = 0.1
"""... so much time in contact [s]."""
PENALTIES = (1.2, 1.0, 1.0)
"""An expert's error counts so many times: the law has to be clearly better than the map, for it is right nowhere where
it is not right everywhere."""
SHARPNESS = 8.0
"""Shares go with this power of the inverse error, the fourth of its square."""
LEAST_SHARE = 1e-3
FINE_DEPTH, COARSE_DEPTH = 4e-4, 3e-4
"""Deeper than the first the fine map, and nearer than the second the coarse map counts for less [m]."""

CONTACT_SHARE = 0.05
"""Predictions above this share of the peak are scored out of contact too."""

DOUBT_TIME = 5.0
"""Late errors are remembered for so much time [s]."""
LEAST_DOUBT = 0.01
"""Least standard deviation, in the peak."""
FIRST_DOUBT = 0.25
"""Standard deviation of a force before anything is known of it, in that force."""
SPREAD_RATE = 0.01
OUTSIDE = 0.25
"""Share of errors beyond one standard deviation; less than a Gaussian's 0.32, for their tails are heavier, and two
standard deviations are to hold 95 % of them."""


_WIDER, _NARROWER = math.exp(SPREAD_RATE * (1.0 - OUTSIDE)), math.exp(-SPREAD_RATE * OUTSIDE)


def _score(
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
    """What an older map says of this sample, expert by expert; errors feed the shares and the doubt."""
    mixed = judge(snapshot, values, place, velocity, True, forces)
    if not (contact or mixed > CONTACT_SHARE * notes[PEAK]):
        return
    fading = math.exp(-period / SCORE_TIME)
    for k in range(EXPERTS):
        notes[SCORES + k] = notes[SCORES + k] * fading + period * (forces[k] - force) ** 2
    notes[SCORED] = notes[SCORED] * fading + period
    # The doubt: squared errors as a constant and shares of the force's and the speed's square, by least squares.
    fading = math.exp(-period / DOUBT_TIME)
    squared, variance = (mixed - force) ** 2, doubt(flat, mixed, velocity)
    spread = notes[SPREAD] * (_WIDER if squared > variance else _NARROWER)
    notes[SPREAD] = spread = min(max(spread, 0.1), 10.0)
    scale_of, peak = spread * spread, notes[PEAK]
    least = max((LEAST_DOUBT * peak) ** 2, 1e-12)
    scale = max(variance / scale_of, least)
    weight = 1.0 / (scale * scale)  # so that each counts by what it tells
    shapes = (1.0, mixed * mixed, (velocity / SPEED) ** 2)
    for i in range(DOUBTS):
        share = weight * shapes[i]
        notes[TARGETS + i] = notes[TARGETS + i] * fading + share * squared
        for j in range(DOUBTS):
            k = MOMENTS + DOUBTS * i + j
            notes[k] = notes[k] * fading + share * shapes[j]
    # None may be negative, or more than the peak: descent along one after the other, from where it stood.
    inverse = 1.0 / scale_of
    for _ in range(3):
        for i in range(DOUBTS):
            row = MOMENTS + DOUBTS * i
            if notes[row + i] > 0.0:
                rest = notes[TARGETS + i]
                for j in range(DOUBTS):
                    if j != i:
                        rest -= notes[row + j] * flat[DOUBT + j] * inverse
                largest = 1.0 if i == 1 else peak * peak
                flat[DOUBT + i] = min(scale_of * max(rest / notes[row + i], 0.0), largest)
    flat[DOUBT] = max(flat[DOUBT], least)


score: Callable[[Array, Array, Array, float, float, float, bool, float, Array, Array], None] = _inlined(_score)


def _share(flat: Array, notes: Array) -> None:
    """Shares of the experts from their scores, what is assumed at first, and what their knots can resolve."""
    first = max(FIRST_TIME * math.exp(-notes[CONTACT] / FIRST_TIME), 1e-9)  # for nothing may have been scored yet
    depth = max(flat[REACHED] + flat[ORIGIN], 1e-6)
    total = 0.0
    for k in range(EXPERTS):
        squared = (notes[SCORES + k] + first * (FIRST_ERRORS[k] * notes[PEAK]) ** 2) / (notes[SCORED] + first)
        penalty = PENALTIES[k]
        if k == 1:
            penalty *= max(1.0, COARSE_DEPTH / depth)
        elif k == 2:
            penalty *= max(1.0, depth / FINE_DEPTH)
        unknown = notes[ABSENT + k] > 0.0 or (k == 0 and not flat[LAW] > 0.0)
        fourth = (squared * penalty**2 + 1e-12) ** 2
        share = 0.0 if unknown else 1.0 / (fourth * fourth)
        flat[SHARES + k] = share
        total += share
    if not total > 0.0:  # only the law, and it is not known yet
        flat[SHARES + 1] = total = 1.0
    kept = 0.0
    for k in range(EXPERTS):
        flat[SHARES + k] = flat[SHARES + k] / total if flat[SHARES + k] > LEAST_SHARE * total else 0.0
        kept += flat[SHARES + k]
    for k in range(EXPERTS):
        flat[SHARES + k] /= kept


allot: Callable[[Array, Array], None] = _inlined(_share)
