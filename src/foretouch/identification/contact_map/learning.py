"""One step of learning a contact map, compiled; method and reasons: `foretouch.identification.ContactMap`."""

from __future__ import annotations

import math

import numpy as np

from foretouch.core.compiling import compiled, inlined
from foretouch.identification.contact_map.regression import (
    fade,
    fit_coarse,
    fit_fine,
    forget_coarse,
    forget_fine,
    in_fine_reach,
)
from foretouch.identification.contact_map.scores import CONTACT_SHARE, allot, score
from foretouch.identification.contact_map.state import RING, Bank
from foretouch.models.contact_map.kernel import features
from foretouch.models.contact_map.layout import COARSE, FINE, SIZE

PERIOD = 0.004  # Least time between two samples that are learnt [s]
LONGEST_PERIOD = 0.1  # Largest period between samples [s]; a longer pause counts as this

LEARNT, CHANGED, FAILED = range(3)
"""Result of a step."""

FADING = 1.0 / 3000.0
"""Fraction by which the covariance goes back towards the prior in each second in contact [1/s]: what was learnt long
ago can be learnt again."""

RING_PERIOD = 0.02  # Time between two snapshots of the map [s]

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


@compiled(error_model="numpy")
def restart(bank: Bank) -> None:
    """Forget the maps, their scores and the visited range; the law and the uncertainty stay."""
    learnt, notes = bank.map[0], bank.notes[0]
    learnt.coarse.ranges[:], learnt.coarse.weights[:] = 0.0, 0.0
    learnt.fine.ranges[:], learnt.fine.weights[:] = 0.0, 0.0
    learnt.law_speed = 0.0
    learnt.lowest, learnt.reached = math.inf, -math.inf
    forget_coarse(bank.coarse)
    forget_fine(bank.fine)
    notes.peak = notes.contact = notes.scored = notes.faded = notes.in_a_row = 0.0
    notes.scores[:], notes.alarms[:] = 0.0, 0.0
    notes.snapshots = 0


@inlined
def score_late(bank: Bank, time: float, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """Score the newest snapshot that is old enough on a sample, where the position had been visited by then."""
    # The ring is short enough for a linear search.
    age, newest = 0, bank.notes[0].snapshots
    kept = min(newest, RING)
    while age < kept and bank.times[(newest - 1 - age) % RING] > time - bank.horizon + 1e-7:
        age += 1
    index = (newest - 1 - age) % RING
    if age < kept and bank.contacts[index] >= SCORED_FROM and sample[0] <= bank.ring[index].reached:
        score(bank, bank.ring[index], sample, contact, period)


@inlined
def widen(bank: Bank, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """Update the visited range, the peak force and the ranges of the features with this sample."""
    position, velocity, force = sample
    learnt, notes, values = bank.map[0], bank.notes[0], bank.values
    if contact:
        notes.contact += period
        notes.faded += period
        # A spike is no peak: two samples in a row must have this force.
        notes.peak = max(notes.peak, min(force, notes.before))
        learnt.felt = max(learnt.felt, notes.peak)
        learnt.law_speed = max(learnt.law_speed, abs(velocity))
    learnt.lowest, learnt.reached = min(learnt.lowest, position), max(learnt.reached, position)
    coarse, fine = learnt.coarse.ranges, learnt.fine.ranges
    for f in range(COARSE.features):
        coarse[f, 0], coarse[f, 1] = min(coarse[f, 0], values[f]), max(coarse[f, 1], values[f])
    for f in range(FINE.features):
        fine[f, 0], fine[f, 1] = min(fine[f, 0], values[f]), max(fine[f, 1], values[f])
    notes.before = force


@inlined
def has_changed(bank: Bank, force: float, contact: bool, period: float, errors: tuple[float, float]) -> bool:
    """Whether for some time no map has explained the force, by the errors of the coarse and the fine one [N]."""
    notes, (coarse_error, fine_error) = bank.notes[0], errors
    # Where a force was expected and none is measured, the material may have gone.
    if not (contact or force - coarse_error > CONTACT_SHARE * notes.peak):
        return False
    alarms, rate = notes.alarms, 1.0 - math.exp(-period / ALARM_TIME)
    alarms[0] += rate * (coarse_error**2 - alarms[0])
    if math.isfinite(fine_error):
        alarms[1] += rate * (fine_error**2 - alarms[1])
    else:
        alarms[1] = alarms[0]
    limit = (ALARM_SHARE * notes.peak) ** 2
    wrong = min(coarse_error**2, fine_error**2) > limit
    notes.in_a_row = notes.in_a_row + period if wrong else 0.0
    unexplained = min(alarms[0], alarms[1]) > limit
    # A sample or two that the sensor lost are no change; a force that vanishes needs longer to be confirmed.
    unexplained = unexplained and notes.in_a_row >= (ALARM_ROW if contact else ALARM_TIME)
    return bool(unexplained and notes.contact > notes.patience)


@inlined
def snap(bank: Bank, time: float) -> None:
    """Keep a snapshot of the map, to be scored later."""
    notes = bank.notes[0]
    if time - notes.snapped_at >= RING_PERIOD - 1e-7 or notes.snapshots == 0:
        notes.snapped_at = time
        index = notes.snapshots % RING
        numbers, ring = bank.map.view(np.float64), bank.ring.view(np.float64)
        for k in range(SIZE):  # a slice of an array into another takes seconds to compile
            ring[index * SIZE + k] = numbers[k]
        bank.contacts[index], bank.times[index] = notes.contact, time
        notes.snapshots += 1


@inlined
def learn(bank: Bank, time: float, position: float, velocity: float, force: float, contact: bool) -> int:
    """Learn one sample, in place; return the result."""
    learnt, notes, values = bank.map[0], bank.notes[0], bank.values[:]
    period = time - notes.learnt_at
    period = PERIOD if math.isinf(period) else min(period, LONGEST_PERIOD)
    notes.learnt_at = time
    features(bank.memory, position, velocity, values)
    sample = (position, velocity, force)
    if notes.snapshots > 0:
        score_late(bank, time, sample, contact, period)
    visited = position <= learnt.reached
    widen(bank, sample, contact, period)

    code, raw = LEARNT, force + learnt.zero
    coarse_weights, fine_weights = learnt.coarse.weights[:], learnt.fine.weights[:]
    coarse_error = fit_coarse(coarse_weights, bank.coarse, position, values, raw)
    fine_error = math.inf
    if in_fine_reach(position):
        fine_error = fit_fine(fine_weights, bank.fine, position, values, raw)
    if has_changed(bank, force, contact, period, (coarse_error, fine_error)) and visited:
        code = CHANGED
        # Repeated changes are no change of the material: no map of this kind explains the force.
        again = notes.contact < 4.0 * notes.patience
        notes.patience = min(2.0 * notes.patience, LONGEST_PATIENCE) if again else ALARM_FROM
        restart(bank)
        notes.peak = max(force, 0.0)
        learnt.lowest = learnt.reached = position
        fit_coarse(coarse_weights, bank.coarse, position, values, raw)
        fit_fine(fine_weights, bank.fine, position, values, raw)
    if notes.faded >= 1.0:
        notes.faded = 0.0
        fade(bank.coarse, FADING)
        fade(bank.fine, FADING)
    allot(bank)
    snap(bank, time)

    spoilt = math.isnan(coarse_error) or math.isnan(fine_error)
    odd, numbers = 0, bank.map.view(np.float64)
    for k in range(SIZE):  # element by element, for a sum would wait for each number before the next
        odd += 0 if abs(numbers[k]) <= LARGEST else 1
    return FAILED if spoilt or odd > 0 else code
