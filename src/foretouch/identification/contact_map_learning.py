"""One step of learning a contact map, compiled; what it does and why is in `contact_map`."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foretouch.models.contact_map_kernel import (
    ABOVE,
    BELOW,
    COARSE,
    COARSENESS,
    DOUBT,
    DOUBTS,
    EXPERTS,
    FELT,
    FINE,
    LARGEST_FEATURES,
    LAW,
    LAW_SPEED,
    LENGTHS,
    LOWEST,
    ORIGIN,
    REACHED,
    SHARES,
    SPEED,
    ZERO,
    doubt,
    features,
    judge,
    locate,
)

__all__ = ["CHANGED", "FAILED", "LEARNT", "NOTES", "PERIOD", "RING", "TOO_SOON", "learn", "prior", "restart"]

Array = NDArray[np.float64]

PERIOD = 0.004
"""Between two samples that are learnt from [s]."""

LONGEST_PERIOD = 0.1
"""A longer pause between samples counts as this [s]."""

TOO_SOON, LEARNT, CHANGED, FAILED = range(4)
"""What a step did."""

# --- prior and noise; only their ratio matters, so force has no unit here ---------------------------------------------

NOISE = 0.3
LEVEL, SLOPE, CURVATURE = 1.5, 0.5, 0.6
"""Elastic part at the origin, its slope there, and the density of the noise that is its curvature; per knot."""
FEATURE_SIZE, FEATURE_REACH = 0.4, 6.0
"""Standard deviation of a feature's part, and over how many knots of the elastic part it resembles itself."""
FADING = 1.0 / 3000.0
"""Each second in contact the covariance goes so far back towards the prior: what was learnt long ago can be learnt
again."""

# --- notes: what is remembered from step to step beside the map -------------------------------------------------------

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
NOTES = 31

RING = 128
RING_PERIOD = 0.02
"""Snapshots of the map that are kept to be scored on what came later, and the time between two [s]."""

SCORE_TIME = 1.0
"""Scores fade in so much time in contact [s]."""
SCORED_FROM = 0.1
"""What was learnt in less time in contact is not scored: it says nothing of what can be learnt [s]."""
FIRST_ERRORS = (0.1, 0.2, 0.3)
"""Relative error of law, coarse and fine map that is assumed at first, for ..."""
FIRST_TIME = 0.1
"""... so much time in contact [s]."""
PENALTIES = (1.2, 1.0, 1.0)
"""An expert's error counts so many times: the law has to be clearly better than the map, for it is right nowhere where
it is not right everywhere."""
SHARPNESS = 8.0
"""Shares go with this power of the inverse error."""
LEAST_SHARE = 1e-3
FINE_DEPTH, COARSE_DEPTH = 4e-4, 3e-4
"""Deeper than the first the fine map, and nearer than the second the coarse map counts for less [m]."""

ALARM_SHARE = 0.25
ALARM_TIME = 0.05
ALARM_ROW = 0.01
ALARM_FROM, LONGEST_PATIENCE = 0.5, 8.0
"""A change: over about 0.05 s, and for the last 0.01 s without a pause (0.05 s where nothing is felt), no map explains
the force to a quarter of its peak, after half a second of contact; twice as long after a change that came in less than
four times as much, up to 8 s."""

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


def prior(kind: int) -> Array:
    """Covariance of a map's weights before the first sample, in the order of the flat array.

    The elastic part is a doubly integrated white noise from the origin both ways, that is a cubic smoothing spline
    (Wahba 1990); each feature's part a Gaussian process with a squared-exponential covariance.
    """
    start = COARSE if kind == 0 else FINE
    _, first, knots, _, coarse, count, end = start
    places = np.arange(knots) - BELOW[kind] - 1.0
    size = np.abs(places)
    near, far = np.minimum.outer(size, size), np.maximum.outer(size, size)
    same_side = np.sign(places)[:, None] == np.sign(places)[None, :]
    covariance = np.zeros((end - first, end - first))
    covariance[:knots, :knots] = (
        CURVATURE**2 * np.where(same_side, near * near * (3.0 * far - near) / 6.0, 0.0)
        + LEVEL**2
        + SLOPE**2 * np.outer(places, places)
    )
    distance = COARSENESS * np.subtract.outer(np.arange(coarse), np.arange(coarse)) / FEATURE_REACH
    part = FEATURE_SIZE**2 * np.exp(-0.5 * distance**2) + 1e-9 * np.eye(coarse)
    for feature in range(count):
        begin = knots + feature * coarse
        covariance[begin : begin + coarse, begin : begin + coarse] = part
    return covariance


_LAYOUTS = np.array([COARSE, FINE])
_COARSE_LENGTH, _FINE_LENGTH = LENGTHS


def _fit(flat: Array, covariance: Array, kind: int, place: float, values: Array, force: float) -> float:
    """Recursive least squares: one sample into a map; returns the error before [N], inf where the map does not reach.

    The new covariance P - P h h' P / (h' P h + r) is symmetric to rounding as it is computed; the error is NaN where
    the old one was none.
    """
    length = _COARSE_LENGTH if kind == 0 else _FINE_LENGTH
    below = BELOW[0] if kind == 0 else BELOW[1]
    above = ABOVE[0] if kind == 0 else ABOVE[1]
    if kind == 1 and not -below * length <= place <= above * length:
        return math.inf
    _, begin, knots, _, coarse, count, end = _LAYOUTS[kind]
    size = end - begin
    indices, regressor = np.empty(4 * (1 + LARGEST_FEATURES), np.int64), np.empty(4 * (1 + LARGEST_FEATURES))
    splines = np.empty(4)
    first = locate(place, length, below, knots, splines)
    for j in range(4):
        indices[j], regressor[j] = first + j, splines[j]
    first = knots + locate(place, COARSENESS * length, -(-below // COARSENESS), coarse, splines)
    active = 4
    for f in range(count):
        for j in range(4):
            indices[active], regressor[active] = first + f * coarse + j, splines[j] * values[f]
            active += 1
    gain, error = np.zeros(size), force
    for a in range(active):
        row, h = indices[a], regressor[a]
        error -= h * flat[begin + row]
        for k in range(size):
            gain[k] += h * covariance[row, k]
    variance = NOISE * NOISE
    for a in range(active):
        variance += regressor[a] * gain[indices[a]]
    if not variance >= NOISE * NOISE:  # rounding has spoilt the covariance
        return math.nan
    for i in range(size):
        share = gain[i] / variance
        flat[begin + i] += share * error
        for k in range(size):
            covariance[i, k] -= share * gain[k]
    return error


fit: Callable[[Array, Array, int, float, Array, float], float] = njit(cache=True)(_fit)


def _restart(flat: Array, coarse: Array, fine: Array, coarse_prior: Array, fine_prior: Array, notes: Array) -> None:
    """Forget the maps, their scores and what was visited; the law and the doubt stay."""
    flat[COARSE[0] :] = 0.0
    flat[LAW_SPEED] = 0.0
    flat[LOWEST], flat[REACHED] = math.inf, -math.inf
    coarse[:] = coarse_prior
    fine[:] = fine_prior
    notes[PEAK] = notes[CONTACT] = notes[SCORED] = notes[FADED] = 0.0
    notes[SCORES : SCORES + EXPERTS] = 0.0
    notes[ALARMS : ALARMS + 2] = 0.0
    notes[IN_A_ROW] = 0.0
    notes[SNAPSHOTS] = 0.0


restart: Callable[[Array, Array, Array, Array, Array, Array], None] = njit(cache=True)(_restart)


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
) -> None:
    """What an older map says of this sample, expert by expert; errors feed the shares and the doubt."""
    forces = np.empty(EXPERTS)
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
    notes[SPREAD] *= math.exp(SPREAD_RATE * ((1.0 if squared > variance else 0.0) - OUTSIDE))
    notes[SPREAD] = min(max(notes[SPREAD], 0.1), 10.0)
    shapes = np.array((1.0, mixed * mixed, (velocity / SPEED) ** 2))
    least = max((LEAST_DOUBT * notes[PEAK]) ** 2, 1e-12)
    scale = max(variance / notes[SPREAD] ** 2, least)
    weight = 1.0 / (scale * scale)  # so that each counts by what it tells
    for i in range(DOUBTS):
        notes[TARGETS + i] = notes[TARGETS + i] * fading + weight * shapes[i] * squared
        for j in range(DOUBTS):
            k = MOMENTS + DOUBTS * i + j
            notes[k] = notes[k] * fading + weight * shapes[i] * shapes[j]
    # None may be negative, or more than the peak: descent along one after the other, from where it stood.
    for _ in range(3):
        for i in range(DOUBTS):
            row = MOMENTS + DOUBTS * i
            if notes[row + i] > 0.0:
                rest = notes[TARGETS + i]
                for j in range(DOUBTS):
                    if j != i:
                        rest -= notes[row + j] * flat[DOUBT + j] / notes[SPREAD] ** 2
                largest = 1.0 if i == 1 else notes[PEAK] ** 2
                flat[DOUBT + i] = min(notes[SPREAD] ** 2 * max(rest / notes[row + i], 0.0), largest)
    flat[DOUBT] = max(flat[DOUBT], least)


score: Callable[[Array, Array, Array, float, float, float, bool, float, Array], None] = njit(cache=True)(_score)


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
        share = 0.0 if unknown else (squared * penalty**2 + 1e-12) ** (-0.5 * SHARPNESS)
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


allot: Callable[[Array, Array], None] = njit(cache=True)(_share)


def _learn(
    flat: Array,
    memory: Array,
    coarse: Array,
    fine: Array,
    coarse_prior: Array,
    fine_prior: Array,
    ring: Array,
    notes: Array,
    time: float,
    place: float,
    velocity: float,
    force: float,
    contact: bool,
    horizon: float,
) -> int:
    """One sample, in place; returns what was done.

    Args:
        flat: The map, as it crosses the network.
        memory: Up to and with this sample.
        coarse: Covariance of the coarse map's weights.
        fine: The same of the fine map.
        coarse_prior: Covariance at the beginning.
        fine_prior: The same.
        ring: Snapshots of `flat`, shape (RING, SIZE + 2); the last columns are their time in contact and their time.
        notes: Of length NOTES.
        time: [s].
        place: From the origin [m].
        velocity: [m/s].
        force: Less the offset [N].
        contact: The conditioner's judgement.
        horizon: How late a prediction is that is scored [s].
    """
    period = time - notes[LEARNT_AT]
    if period < PERIOD - 1e-7:
        return TOO_SOON
    period = PERIOD if math.isinf(period) else min(period, LONGEST_PERIOD)
    notes[LEARNT_AT] = time
    values = np.empty(LARGEST_FEATURES)
    features(memory, place, velocity, values)

    if notes[SNAPSHOTS] > 0.0:
        # The newest snapshot that is old enough; the ring is short enough to be walked.
        age, newest = 0, int(notes[SNAPSHOTS])
        while age < min(newest, RING) and ring[(newest - 1 - age) % RING, -1] > time - horizon + 1e-7:
            age += 1
        snapshot = ring[(newest - 1 - age) % RING]
        if age < min(newest, RING) and snapshot[-2] >= SCORED_FROM and place <= snapshot[REACHED]:
            score(flat, snapshot[:-2], values, place, velocity, force, contact, period, notes)

    visited = place <= flat[REACHED]
    if contact:
        notes[CONTACT] += period
        notes[FADED] += period
        # A spike is no peak: two samples in a row have felt it.
        notes[PEAK] = max(notes[PEAK], min(force, notes[BEFORE]))
        flat[FELT] = max(flat[FELT], notes[PEAK])
        flat[LAW_SPEED] = max(flat[LAW_SPEED], abs(velocity))
    flat[LOWEST], flat[REACHED] = min(flat[LOWEST], place), max(flat[REACHED], place)
    for kind in range(2):
        ranges = _LAYOUTS[kind, 0]
        for f in range(_LAYOUTS[kind, 5]):
            flat[ranges + 2 * f] = min(flat[ranges + 2 * f], values[f])
            flat[ranges + 2 * f + 1] = max(flat[ranges + 2 * f + 1], values[f])

    notes[BEFORE] = force

    code = LEARNT
    coarse_error = fit(flat, coarse, 0, place, values, force + flat[ZERO])
    fine_error = fit(flat, fine, 1, place, values, force + flat[ZERO])
    # Where a force was expected and none is felt, the material may have gone.
    if contact or force - coarse_error > CONTACT_SHARE * notes[PEAK]:
        rate = 1.0 - math.exp(-period / ALARM_TIME)
        notes[ALARMS] += rate * (coarse_error**2 - notes[ALARMS])
        if math.isfinite(fine_error):
            notes[ALARMS + 1] += rate * (fine_error**2 - notes[ALARMS + 1])
        else:
            notes[ALARMS + 1] = notes[ALARMS]
        limit = (ALARM_SHARE * notes[PEAK]) ** 2
        wrong = min(coarse_error**2, fine_error**2) > limit
        notes[IN_A_ROW] = notes[IN_A_ROW] + period if wrong else 0.0
        unexplained = min(notes[ALARMS], notes[ALARMS + 1]) > limit
        # A sample or two that the sensor lost are no change; and that nothing is felt needs longer to be believed.
        unexplained = unexplained and notes[IN_A_ROW] >= (ALARM_ROW if contact else ALARM_TIME)
        if unexplained and visited and notes[CONTACT] > notes[PATIENCE]:
            code = CHANGED
            # What changes again and again is no change: it is something that no map of this kind explains.
            again = notes[CONTACT] < 4.0 * notes[PATIENCE]
            notes[PATIENCE] = min(2.0 * notes[PATIENCE], LONGEST_PATIENCE) if again else ALARM_FROM
            restart(flat, coarse, fine, coarse_prior, fine_prior, notes)
            notes[PEAK] = max(force, 0.0)
            flat[LOWEST] = flat[REACHED] = place
            fit(flat, coarse, 0, place, values, force + flat[ZERO])
            fit(flat, fine, 1, place, values, force + flat[ZERO])
    if notes[FADED] >= 1.0:
        notes[FADED] = 0.0
        coarse += FADING * (coarse_prior - coarse)
        fine += FADING * (fine_prior - fine)

    allot(flat, notes)
    if time - notes[SNAPPED_AT] >= RING_PERIOD - 1e-7 or notes[SNAPSHOTS] == 0.0:
        notes[SNAPPED_AT] = time
        place_in_ring = int(notes[SNAPSHOTS]) % RING
        ring[place_in_ring, :-2] = flat
        ring[place_in_ring, -2] = notes[CONTACT]
        ring[place_in_ring, -1] = time
        notes[SNAPSHOTS] += 1.0
    total = 0.0
    for value in flat:
        total += value
    spoilt = math.isnan(coarse_error) or math.isnan(fine_error) or not math.isfinite(total)
    return FAILED if spoilt else code


learn: Callable[..., int] = njit(cache=True)(_learn)
