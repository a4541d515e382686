"""One step of learning a contact map, compiled; what it does and why: `foretouch.identification.ContactMapBank`."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.contact_map.regression import MapRegression, fade, fit, forget, in_fine_reach, regression
from foretouch.identification.contact_map.scores import (
    ALARMS,
    BEFORE,
    BEGIN_COARSE,
    BEGIN_FINE,
    BEGIN_FLAT,
    BEGIN_MEMORY,
    BEGIN_NOTES,
    BEGIN_RATES,
    BEGIN_RING,
    BEGIN_TIMES,
    BEGIN_VALUES,
    CONTACT,
    CONTACT_SHARE,
    FADED,
    HORIZON,
    IN_A_ROW,
    LEARNT_AT,
    PATIENCE,
    PEAK,
    RING,
    SCORED,
    SCORES,
    SNAPPED_AT,
    SNAPSHOTS,
    allot,
    score,
)
from foretouch.models.contact_map.kernel import features
from foretouch.models.contact_map.layout import (
    COARSE,
    EXPERTS,
    FELT,
    FINE,
    LARGEST_FEATURES,
    LAW_SPEED,
    LOWEST,
    REACHED,
    SIZE,
    ZERO,
)

Array = NDArray[np.float64]

_compiled = compiled(error_model="numpy")
_inlined = compiled(error_model="numpy", forceinline=True)

PERIOD = 0.004
"""Between two samples that are learnt from [s]."""

LONGEST_PERIOD = 0.1
"""A longer pause between samples counts as this [s]."""

LEARNT, CHANGED, FAILED = range(3)
"""What a step did."""

FADING = 1.0 / 3000.0
"""Each second in contact the covariance goes so far back towards the prior: what was learnt long ago can be learnt
again."""

RING_PERIOD = 0.02
"""Time between two snapshots of the map [s]."""

SCORED_FROM = 0.1
"""What was learnt in less time in contact is not scored: it says nothing of what can be learnt [s]."""

ALARM_SHARE = 0.25
ALARM_TIME = 0.05
ALARM_ROW = 0.01
ALARM_FROM, LONGEST_PATIENCE = 0.5, 8.0
"""A change: over about 0.05 s, and for the last 0.01 s without a pause (0.05 s where nothing is felt), no map explains
the force to a quarter of its peak, after half a second of contact; twice as long after a change that came in less than
four times as much, up to 8 s."""

LARGEST = 1.7976931348623157e308

_LAYOUTS = np.array([COARSE, FINE])
_COARSE_WEIGHTS, _COARSE_END = COARSE[1], COARSE[-1]
_FINE_WEIGHTS, _FINE_END = FINE[1], FINE[-1]
_FIRST_RANGE = COARSE[0]


def _restart(flat: Array, coarse: MapRegression, fine: MapRegression, notes: Array) -> None:
    """Forget the maps, their scores and what was visited; the law and the doubt stay."""
    flat[_FIRST_RANGE:] = 0.0
    flat[LAW_SPEED] = 0.0
    flat[LOWEST], flat[REACHED] = math.inf, -math.inf
    forget(coarse)
    forget(fine)
    notes[PEAK] = notes[CONTACT] = notes[SCORED] = notes[FADED] = 0.0
    notes[SCORES : SCORES + EXPERTS] = 0.0
    notes[ALARMS : ALARMS + 2] = 0.0
    notes[IN_A_ROW] = 0.0
    notes[SNAPSHOTS] = 0.0


restart: Callable[[Array, MapRegression, MapRegression, Array], None] = _compiled(_restart)


def _score_late(
    flat: Array,
    notes: Array,
    times: Array,
    ring: Array,
    values: Array,
    forces: Array,
    sample: tuple[float, ...],
    period: float,
) -> None:
    """Score what the newest snapshot that is old enough says of a sample, where the place had been visited by then.

    Args:
        flat: The map.
        notes: Beside it.
        times: Of the snapshots [s], shape (RING,).
        ring: The snapshots, each with its time in contact, shape (RING, SIZE + 1).
        values: Features of the sample.
        forces: Scratch of shape (EXPERTS,).
        sample: Time [s], place from the origin [m], velocity [m/s], force [N], and 1 in contact.
        period: Since the sample before [s].
    """
    time, place, velocity, force, contact = sample
    # The ring is short enough to be walked.
    age, newest = 0, int(notes[SNAPSHOTS])
    kept = min(newest, RING)
    while age < kept and times[(newest - 1 - age) % RING] > time - notes[HORIZON] + 1e-7:
        age += 1
    snapshot = ring[(newest - 1 - age) % RING]
    if age < kept and snapshot[SIZE] >= SCORED_FROM and place <= snapshot[REACHED]:
        score(flat, snapshot[:SIZE], values, place, velocity, force, contact > 0.0, period, notes, forces)


score_late: Callable[[Array, Array, Array, Array, Array, Array, tuple[float, ...], float], None] = _inlined(_score_late)


def _widen(
    flat: Array, notes: Array, values: Array, place: float, velocity: float, force: float, contact: bool, period: float
) -> None:
    """What was visited, felt and seen of the features, with this sample."""
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


widen: Callable[[Array, Array, Array, float, float, float, bool, float], None] = _inlined(_widen)


def _has_changed(
    notes: Array, force: float, contact: bool, period: float, coarse_error: float, fine_error: float
) -> bool:
    """Whether for some time no map has explained the force."""
    # Where a force was expected and none is felt, the material may have gone.
    if not (contact or force - coarse_error > CONTACT_SHARE * notes[PEAK]):
        return False
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
    return bool(unexplained and notes[CONTACT] > notes[PATIENCE])


has_changed: Callable[[Array, float, bool, float, float, float], bool] = _inlined(_has_changed)


def _snap(flat: Array, notes: Array, times: Array, ring: Array, time: float) -> None:
    """Keep the map as it is, to be scored later."""
    if time - notes[SNAPPED_AT] >= RING_PERIOD - 1e-7 or notes[SNAPSHOTS] == 0.0:
        notes[SNAPPED_AT] = time
        index = int(notes[SNAPSHOTS]) % RING
        for k in range(SIZE):  # a slice of an array into another takes seconds to compile
            ring[index, k] = flat[k]
        ring[index, SIZE], times[index] = notes[CONTACT], time
        notes[SNAPSHOTS] += 1.0


snap: Callable[[Array, Array, Array, Array, float], None] = _inlined(_snap)


def _learn(state: Array, time: float, place: float, velocity: float, force: float, contact: bool) -> int:
    """One sample, in place; returns what was done.

    Args:
        state: All that is remembered, up to and with this sample's motion (`contact_map.scores`).
        time: [s].
        place: From the origin [m].
        velocity: [m/s].
        force: Less the offset [N].
        contact: The conditioner's judgement.
    """
    flat, notes = state[BEGIN_FLAT:BEGIN_MEMORY], state[BEGIN_NOTES:BEGIN_RATES]
    times, ring = state[BEGIN_TIMES:BEGIN_RING], state[BEGIN_RING:BEGIN_COARSE].reshape((RING, SIZE + 1))
    coarse = regression(state[BEGIN_COARSE:BEGIN_FINE], 0)
    values = state[BEGIN_VALUES : BEGIN_VALUES + LARGEST_FEATURES]
    forces = state[BEGIN_VALUES + LARGEST_FEATURES : BEGIN_VALUES + LARGEST_FEATURES + EXPERTS]
    period = time - notes[LEARNT_AT]
    period = PERIOD if math.isinf(period) else min(period, LONGEST_PERIOD)
    notes[LEARNT_AT] = time
    features(state[BEGIN_MEMORY:BEGIN_NOTES], place, velocity, values)
    if notes[SNAPSHOTS] > 0.0:
        sample = (time, place, velocity, force, 1.0 if contact else 0.0)
        score_late(flat, notes, times, ring, values, forces, sample, period)
    visited = place <= flat[REACHED]
    widen(flat, notes, values, place, velocity, force, contact, period)

    code = LEARNT
    coarse_weights, fine_weights = flat[_COARSE_WEIGHTS:_COARSE_END], flat[_FINE_WEIGHTS:_FINE_END]
    coarse_error = fit(coarse_weights, coarse, place, values, force + flat[ZERO])
    fine_error = math.inf
    if in_fine_reach(place):
        fine_error = fit(fine_weights, regression(state[BEGIN_FINE:], 1), place, values, force + flat[ZERO])
    if has_changed(notes, force, contact, period, coarse_error, fine_error) and visited:
        code = CHANGED
        # What changes again and again is no change: it is something that no map of this kind explains.
        again = notes[CONTACT] < 4.0 * notes[PATIENCE]
        notes[PATIENCE] = min(2.0 * notes[PATIENCE], LONGEST_PATIENCE) if again else ALARM_FROM
        fine = regression(state[BEGIN_FINE:], 1)
        restart(flat, coarse, fine, notes)
        notes[PEAK] = max(force, 0.0)
        flat[LOWEST] = flat[REACHED] = place
        fit(coarse_weights, coarse, place, values, force + flat[ZERO])
        fit(fine_weights, fine, place, values, force + flat[ZERO])
    if notes[FADED] >= 1.0:
        notes[FADED] = 0.0
        fade(coarse, FADING)
        fade(regression(state[BEGIN_FINE:], 1), FADING)
    allot(flat, notes)
    snap(flat, notes, times, ring, time)

    spoilt = math.isnan(coarse_error) or math.isnan(fine_error)
    odd = 0
    for k in range(flat.size):  # counted, for a sum would wait for each number before the next
        odd += 0 if abs(flat[k]) <= LARGEST else 1
    return FAILED if spoilt or odd > 0 else code


learn: Callable[[Array, float, float, float, float, bool], int] = _inlined(_learn)
