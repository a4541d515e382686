"""One step of learning a contact map, compiled; method and reasons: `foretouch.identification.ContactMap`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined
from foretouch.identification.contact_map import scores as at
from foretouch.identification.contact_map.regression import MapRegression, fade, fit, forget, in_fine_reach, regression
from foretouch.identification.contact_map.scores import CONTACT_SHARE, allot, score
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.kernel import features

Array = NDArray[np.float64]


PERIOD = 0.004
"""Least time between two samples that are learnt [s]."""

LONGEST_PERIOD = 0.1
"""Largest period between samples [s]; a longer pause counts as this."""

LEARNT, CHANGED, FAILED = range(3)
"""Result of a step."""

FADING = 1.0 / 3000.0
"""Fraction by which the covariance goes back towards the prior in each second in contact [1/s]: what was learnt long
ago can be learnt again."""

RING_PERIOD = 0.02
"""Time between two snapshots of the map [s]."""

SCORED_FROM = 0.1
"""Least time in contact [s] after which a snapshot is scored: an earlier one does not show what can be learnt."""

ALARM_SHARE = 0.25
ALARM_TIME = 0.05
ALARM_ROW = 0.01
ALARM_FROM, LONGEST_PATIENCE = 0.5, 8.0
"""Time in contact [s] before a change can be detected, and its largest value. A change is detected where no map
explains the force to a quarter of its peak, over about 0.05 s and for the last 0.01 s without a pause (0.05 s where no
force is measured). The time doubles after a change that came within less than four times of it, up to the largest."""

LARGEST = 1.7976931348623157e308

_LAYOUTS = np.array([layout.COARSE, layout.FINE])
_COARSE_WEIGHTS, _COARSE_END = layout.COARSE[1], layout.COARSE[-1]
_FINE_WEIGHTS, _FINE_END = layout.FINE[1], layout.FINE[-1]
_FIRST_RANGE = layout.COARSE[0]


@compiled(error_model="numpy")
def restart(flat: Array, coarse: MapRegression, fine: MapRegression, notes: Array) -> None:
    """Forget the maps, their scores and the visited range; the law and the uncertainty stay."""
    flat[_FIRST_RANGE:] = 0.0
    flat[layout.LAW_SPEED] = 0.0
    flat[layout.LOWEST], flat[layout.REACHED] = math.inf, -math.inf
    forget(coarse)
    forget(fine)
    notes[at.PEAK] = notes[at.CONTACT] = notes[at.SCORED] = notes[at.FADED] = 0.0
    notes[at.SCORES : at.SCORES + layout.EXPERTS] = 0.0
    notes[at.ALARMS : at.ALARMS + 2] = 0.0
    notes[at.IN_A_ROW] = 0.0
    notes[at.SNAPSHOTS] = 0.0


@inlined
def score_late(
    flat: Array,
    notes: Array,
    times: Array,
    ring: Array,
    values: Array,
    forces: Array,
    sample: tuple[float, ...],
    period: float,
) -> None:
    """Score the newest snapshot that is old enough on a sample, where the position had been visited by then.

    Args:
        flat: The map.
        notes: Notes on the map.
        times: Times of the snapshots [s], shape (RING,).
        ring: The snapshots, each with its time in contact, shape (RING, SIZE + 1).
        values: Features of the sample.
        forces: Scratch of shape (EXPERTS,).
        sample: Time [s], position from the origin [m], velocity [m/s], force [N], and 1 in contact.
        period: Time since the previous sample [s].
    """
    time, place, velocity, force, contact = sample
    # The ring is short enough for a linear search.
    age, newest = 0, int(notes[at.SNAPSHOTS])
    kept = min(newest, at.RING)
    while age < kept and times[(newest - 1 - age) % at.RING] > time - notes[at.HORIZON] + 1e-7:
        age += 1
    snapshot = ring[(newest - 1 - age) % at.RING]
    if age < kept and snapshot[layout.SIZE] >= SCORED_FROM and place <= snapshot[layout.REACHED]:
        score(flat, snapshot[: layout.SIZE], values, place, velocity, force, contact > 0.0, period, notes, forces)


@inlined
def widen(
    flat: Array, notes: Array, values: Array, place: float, velocity: float, force: float, contact: bool, period: float
) -> None:
    """Update the visited range, the peak force and the ranges of the features with this sample."""
    if contact:
        notes[at.CONTACT] += period
        notes[at.FADED] += period
        # A spike is no peak: two samples in a row must have this force.
        notes[at.PEAK] = max(notes[at.PEAK], min(force, notes[at.BEFORE]))
        flat[layout.FELT] = max(flat[layout.FELT], notes[at.PEAK])
        flat[layout.LAW_SPEED] = max(flat[layout.LAW_SPEED], abs(velocity))
    flat[layout.LOWEST], flat[layout.REACHED] = min(flat[layout.LOWEST], place), max(flat[layout.REACHED], place)
    for kind in range(2):
        ranges = _LAYOUTS[kind, 0]
        for f in range(_LAYOUTS[kind, 5]):
            flat[ranges + 2 * f] = min(flat[ranges + 2 * f], values[f])
            flat[ranges + 2 * f + 1] = max(flat[ranges + 2 * f + 1], values[f])
    notes[at.BEFORE] = force


@inlined
def has_changed(
    notes: Array, force: float, contact: bool, period: float, coarse_error: float, fine_error: float
) -> bool:
    """Whether for some time no map has explained the force."""
    # Where a force was expected and none is measured, the material may have gone.
    if not (contact or force - coarse_error > CONTACT_SHARE * notes[at.PEAK]):
        return False
    rate = 1.0 - math.exp(-period / ALARM_TIME)
    notes[at.ALARMS] += rate * (coarse_error**2 - notes[at.ALARMS])
    if math.isfinite(fine_error):
        notes[at.ALARMS + 1] += rate * (fine_error**2 - notes[at.ALARMS + 1])
    else:
        notes[at.ALARMS + 1] = notes[at.ALARMS]
    limit = (ALARM_SHARE * notes[at.PEAK]) ** 2
    wrong = min(coarse_error**2, fine_error**2) > limit
    notes[at.IN_A_ROW] = notes[at.IN_A_ROW] + period if wrong else 0.0
    unexplained = min(notes[at.ALARMS], notes[at.ALARMS + 1]) > limit
    # A sample or two that the sensor lost are no change; a force that vanishes needs longer to be confirmed.
    unexplained = unexplained and notes[at.IN_A_ROW] >= (ALARM_ROW if contact else ALARM_TIME)
    return bool(unexplained and notes[at.CONTACT] > notes[at.PATIENCE])


@inlined
def snap(flat: Array, notes: Array, times: Array, ring: Array, time: float) -> None:
    """Keep a snapshot of the map, to be scored later."""
    if time - notes[at.SNAPPED_AT] >= RING_PERIOD - 1e-7 or notes[at.SNAPSHOTS] == 0.0:
        notes[at.SNAPPED_AT] = time
        index = int(notes[at.SNAPSHOTS]) % at.RING
        for k in range(layout.SIZE):  # a slice of an array into another takes seconds to compile
            ring[index, k] = flat[k]
        ring[index, layout.SIZE], times[index] = notes[at.CONTACT], time
        notes[at.SNAPSHOTS] += 1.0


@inlined
def learn(state: Array, time: float, place: float, velocity: float, force: float, contact: bool) -> int:
    """Learn one sample, in place; return the result.

    Args:
        state: State of the learner, up to and with this sample's motion (`contact_map.scores`).
        time: Time of the sample [s].
        place: Position from the origin [m].
        velocity: Velocity [m/s].
        force: Force less the offset [N].
        contact: The conditioner's judgement.
    """
    flat, notes = state[at.BEGIN_FLAT : at.BEGIN_MEMORY], state[at.BEGIN_NOTES : at.BEGIN_RATES]
    times = state[at.BEGIN_TIMES : at.BEGIN_RING]
    ring = state[at.BEGIN_RING : at.BEGIN_COARSE].reshape((at.RING, layout.SIZE + 1))
    coarse = regression(state[at.BEGIN_COARSE : at.BEGIN_FINE], 0)
    begin_forces = at.BEGIN_VALUES + layout.LARGEST_FEATURES
    values, forces = state[at.BEGIN_VALUES : begin_forces], state[begin_forces : begin_forces + layout.EXPERTS]
    period = time - notes[at.LEARNT_AT]
    period = PERIOD if math.isinf(period) else min(period, LONGEST_PERIOD)
    notes[at.LEARNT_AT] = time
    features(state[at.BEGIN_MEMORY : at.BEGIN_NOTES], place, velocity, values)
    if notes[at.SNAPSHOTS] > 0.0:
        sample = (time, place, velocity, force, 1.0 if contact else 0.0)
        score_late(flat, notes, times, ring, values, forces, sample, period)
    visited = place <= flat[layout.REACHED]
    widen(flat, notes, values, place, velocity, force, contact, period)

    code = LEARNT
    coarse_weights, fine_weights = flat[_COARSE_WEIGHTS:_COARSE_END], flat[_FINE_WEIGHTS:_FINE_END]
    coarse_error = fit(coarse_weights, coarse, place, values, force + flat[layout.ZERO])
    fine_error = math.inf
    if in_fine_reach(place):
        fine_error = fit(fine_weights, regression(state[at.BEGIN_FINE :], 1), place, values, force + flat[layout.ZERO])
    if has_changed(notes, force, contact, period, coarse_error, fine_error) and visited:
        code = CHANGED
        # Repeated changes are no change of the material: no map of this kind explains the force.
        again = notes[at.CONTACT] < 4.0 * notes[at.PATIENCE]
        notes[at.PATIENCE] = min(2.0 * notes[at.PATIENCE], LONGEST_PATIENCE) if again else ALARM_FROM
        fine = regression(state[at.BEGIN_FINE :], 1)
        restart(flat, coarse, fine, notes)
        notes[at.PEAK] = max(force, 0.0)
        flat[layout.LOWEST] = flat[layout.REACHED] = place
        fit(coarse_weights, coarse, place, values, force + flat[layout.ZERO])
        fit(fine_weights, fine, place, values, force + flat[layout.ZERO])
    if notes[at.FADED] >= 1.0:
        notes[at.FADED] = 0.0
        fade(coarse, FADING)
        fade(regression(state[at.BEGIN_FINE :], 1), FADING)
    allot(flat, notes)
    snap(flat, notes, times, ring, time)

    spoilt = math.isnan(coarse_error) or math.isnan(fine_error)
    odd = 0
    for k in range(flat.size):  # element by element, for a sum would wait for each number before the next
        odd += 0 if abs(flat[k]) <= LARGEST else 1
    return FAILED if spoilt or odd > 0 else code
