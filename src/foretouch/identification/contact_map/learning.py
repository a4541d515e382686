"""One step of learning a contact map, compiled; method and reasons: `foretouch.identification.ContactMap`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined, squared
from foretouch.identification.conditioning.kernel import PEAK_TIME
from foretouch.identification.contact_map.regression import (
    fade,
    fit,
    forget,
    in_fine_reach,
)
from foretouch.identification.contact_map.scores import (
    LONGEST_HORIZON,
    RING_PERIOD,
    allot,
    score,
    set_doubt,
    watch,
)
from foretouch.identification.contact_map.state import LEVELS, RING, Bank, Notes
from foretouch.identification.exact.belief import DRIFT, FIRST_ERROR, LEARNING_TIME, YOUNG
from foretouch.models.contact_map.kernel import blend, cubic, features, law_force, mapped
from foretouch.models.contact_map.layout import (
    BEYOND,
    CLEAR,
    COARSE,
    FINE,
    FINE_TO,
    LETTING_GO,
    PLAYS,
    SIZE,
    STUCK,
    Map,
)
from foretouch.models.contact_model import LARGEST_DEPTH

Array = NDArray[np.float64]

PERIOD = 0.004  # Least time between two samples that are learnt [s]
LONGEST_PERIOD = 0.1  # Largest period between samples [s]; a longer pause counts as this

LEARNT, CHANGED, FAILED = range(3)
"""Result of a step."""

CHANGED_FROM = 4.0  # Time in contact [s] before a change can be detected

LONGEST_SPIKE = 2.0 * PEAK_TIME  # For how long an unexpected force is taken for one of the sensor's [s]

FINE_ALONE = 0.5
"""Least weight of the fine map, and largest ratio of its error to that of the coarse one, with which a sample that the
coarse one misses is learnt by the fine one alone: it would smear what is hard over what is soft above it."""

LARGEST = 1.7976931348623157e308


@compiled(error_model="numpy")
def refine(coarse: Array, fine: Array, place: float) -> None:
    """Write the weights of a fine map at a place [m from the origin] that has the force of a coarse one there."""
    for k in range(FINE.knots):  # a spline's weight is about the value in its middle
        position = place + (k - FINE.below - 1) * FINE.spacing
        first, a, b, c, d = cubic(position, COARSE.spacing, COARSE.below, COARSE.knots)
        fine[k] = blend(coarse, first, a, b, c, d)
    for k in range(FINE.feature_knots):
        position = place + (k - FINE.feature_below - 1) * FINE.feature_spacing
        first, a, b, c, d = cubic(position, COARSE.feature_spacing, COARSE.feature_below, COARSE.feature_knots)
        fine[FINE.knots + k] = blend(coarse, COARSE.knots + first, a, b, c, d)


@compiled(error_model="numpy")
def place_fine(bank: Bank, place: float) -> None:
    """Begin the fine map again, at a place [m from the origin] and with the force of the coarse one there."""
    learnt, notes = bank.map[0], bank.notes[0]
    learnt.place, learnt.fine.ranges[:] = place, 0.0
    refine(learnt.coarse.weights[:], learnt.fine.weights[:], place)
    forget(bank.fine)
    if bank.coarse.traced > 0:
        refine(bank.coarse.trace[:], bank.fine.trace[:], place)
        bank.fine.traced = 1
    assumed = RING_PERIOD * squared(FIRST_ERROR * notes.peak)
    # The fine map has to show that it is needed.
    notes.present.coarse, notes.present.fine, notes.present.time = 0.25 * assumed, assumed, RING_PERIOD


@inlined
def scale_part(weights: Array, zero: float, knots: int, factor: float) -> None:
    """Multiply the force of a map by a factor; `zero` is what it gives without contact."""
    for k in range(weights.size):
        raised = zero if k < knots else 0.0
        weights[k] = raised + factor * (weights[k] - raised)


@compiled(error_model="numpy")
def begin_changed(bank: Bank, index: int, position: float) -> None:
    """Begin anew around the map of this snapshot, scaled as the forces since have changed: all of it is a guess now."""
    learnt, notes, before = bank.map[0], bank.notes[0], bank.ring[index]
    factor = min(max(notes.wrong.product / max(notes.wrong.square, 1e-12), CLEAR), 1.0 / CLEAR)
    for k in range(COARSE.size):
        learnt.coarse.weights[k] = before.coarse.weights[k]
    for k in range(FINE.size):
        learnt.fine.weights[k] = before.fine.weights[k]
    scale_part(learnt.coarse.weights[:], learnt.zero, COARSE.knots, factor)
    if learnt.place == before.place:
        scale_part(learnt.fine.weights[:], learnt.zero, FINE.knots, factor)
    else:
        place_fine(bank, learnt.place)
    fade(bank.coarse, 1.0)
    fade(bank.fine, 1.0)
    learnt.felt = notes.peak = before.felt * factor
    learnt.touch_force *= factor
    learnt.pull *= factor
    notes.touch_unit *= factor
    begin_scores(bank)
    notes.lowest = learnt.law_reached = position


@compiled(error_model="numpy")
def begin_scores(bank: Bank) -> None:
    """Forget how well was predicted."""
    learnt, notes = bank.map[0], bank.notes[0]
    notes.contact = notes.scored = notes.faded = 0.0
    notes.wrong.time = notes.wrong.product = notes.wrong.square = 0.0
    notes.present.law = notes.present.law_time = 0.0
    notes.lowest, learnt.law_reached, learnt.law_speed = math.inf, -math.inf, 0.0
    notes.scores[:], notes.errors = 0.0, 0.0
    set_doubt(learnt, FIRST_ERROR, 0.0)
    notes.snapshots = 0


@compiled(error_model="numpy")
def restart(bank: Bank) -> None:
    """Forget the maps, their scores and the visited range; the law stays."""
    learnt, notes = bank.map[0], bank.notes[0]
    learnt.coarse.ranges[:], learnt.coarse.weights[:] = 0.0, 0.0
    learnt.lowest, learnt.reached = math.inf, -math.inf
    forget(bank.coarse)
    notes.peak = 0.0
    begin_scores(bank)
    notes.outermost[:], learnt.touch, learnt.touch_way = math.inf, -LARGEST_DEPTH, LARGEST_DEPTH
    notes.touch_unit, notes.entered = 0.0, 0
    learnt.pull = learnt.catch = learnt.hold = notes.stay.pull = 0.0
    place_fine(bank, 0.0)


@inlined
def snapshot_at(bank: Bank, time: float) -> int:
    """Index of the newest snapshot of a time [s] or before; -1 where there is none."""
    # The ring is short enough for a linear search.
    age, newest = 0, bank.notes[0].snapshots
    kept = min(newest, RING)
    while age < kept and bank.times[(newest - 1 - age) % RING] > time + 1e-7:
        age += 1
    return int((newest - 1 - age) % RING) if age < kept else -1


@inlined
def snapshot_before(bank: Bank, time: float, position: float) -> int:
    """`snapshot_at` a time, if a position was visited by then and the map was not `YOUNG`; else -1."""
    index = snapshot_at(bank, time)
    is_known = index >= 0 and bank.contacts[index] >= YOUNG
    return index if is_known and bank.ranges[index, 0] <= position <= bank.ranges[index, 1] else -1


@inlined
def score_late(bank: Bank, time: float, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """Watch a snapshot of long before, and score that of a delay before, on a sample."""
    # However short the delay is, what was learnt since a change does not hide it.
    index = snapshot_before(bank, time - max(bank.horizon, LONGEST_HORIZON), sample[0])
    if index >= 0:
        watch(bank, bank.ring[index], sample, contact, period)
    index = snapshot_before(bank, time - bank.horizon, sample[0])
    if index >= 0:
        score(bank, bank.ring[index], sample, contact, period)


@inlined
def level_of(ratio: float) -> int:
    """Exponent of the largest power of two up to a ratio of forces, 0 to `LEVELS` - 3: two more are looked at."""
    return min(max(math.frexp(ratio)[1] - 1, 0), LEVELS - 3) if ratio > 0.0 else 0


@inlined
def note_touch(learnt: Map, notes: Notes, position: float, force: float) -> None:
    """Note where a force in contact was felt, and where a `CLEAR` of the largest was felt outermost."""
    if notes.touch_unit == 0.0:
        notes.touch_unit = max(force / 16.0, 0.0)
    if not notes.touch_unit > 0.0:
        return
    while notes.peak > notes.touch_unit * 2.0 ** (LEVELS - 3):  # the first force was hardly one
        notes.touch_unit *= 2.0
        for k in range(LEVELS - 1):
            notes.outermost[k] = notes.outermost[k + 1]
        notes.outermost[LEVELS - 1] = math.inf
    for k in range(level_of(force / notes.touch_unit) + 1):
        notes.outermost[k] = min(notes.outermost[k], position)
    level = level_of(CLEAR * notes.peak / notes.touch_unit)
    # Where contact ends says less: foam is left deeper than it is touched.
    if notes.entered == 2 and math.isfinite(notes.outermost[level + 2]):
        learnt.touch, learnt.touch_force = notes.outermost[level], notes.touch_unit * 2.0**level
        learnt.touch_way = max(notes.outermost[level + 2] - learnt.touch, PLAYS[0])


@inlined
def note_pull(learnt: Map, notes: Notes, position: float, force: float, contact: bool) -> None:
    """Note how much pulls after a contact, and how far out, once it has let go further out.

    Args:
        learnt: Written.
        notes: Written.
        position: [m from the origin].
        force: The larger of the two newest ones [N].
        contact: The conditioner's judgement.
    """
    stay, least = notes.stay, max(CLEAR * notes.peak, 16.0 * notes.touch_unit)
    before, stay.place = stay.place, position
    if contact:
        stay.left, stay.pull = position, 0.0
        return
    if learnt.pull > 0.0 and -force > least and position > before:
        learnt.catch = max(min(learnt.catch, before), learnt.hold)
    if stay.left - position > LETTING_GO:
        stay.pull = 0.0
        return
    stay.pull = max(stay.pull, -force)
    if -force > 0.5 * stay.pull:
        stay.held = position
    gone = -force < CLEAR * stay.pull and position < stay.held - PLAYS[1]
    if gone and stay.pull > least:
        known = learnt.pull > 0.0
        learnt.hold = min(learnt.hold, stay.held) if known else stay.held
        learnt.catch = max(learnt.catch if known else 0.0, learnt.hold)
        learnt.pull, stay.pull = max(learnt.pull, stay.pull), 0.0


@inlined
def widen(bank: Bank, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """Update the visited range, the peak force and the ranges of the features with this sample."""
    position, velocity, force = sample
    learnt, notes, values = bank.map[0], bank.notes[0], bank.values
    if contact:
        notes.contact += period
        notes.faded += period
        # A spike is no peak: two samples in a row must have this force.
        notes.peak = max(notes.peak, min(force, notes.stay.force))
        learnt.felt = max(learnt.felt, notes.peak)
        note_touch(learnt, notes, position, min(force, notes.stay.force))
        learnt.law_speed = max(learnt.law_speed, abs(velocity))
    elif velocity > 0.0 and position > learnt.touch + learnt.touch_way and force < learnt.touch_force:
        # The material is no longer where it was touched.
        learnt.touch = position
        for k in range(LEVELS):
            notes.outermost[k] = max(notes.outermost[k], position)
    if notes.peak > 0.0:
        note_pull(learnt, notes, position, max(force, notes.stay.force), contact)
    learnt.lowest, learnt.reached = min(learnt.lowest, position), max(learnt.reached, position)
    notes.lowest, learnt.law_reached = min(notes.lowest, position), max(learnt.law_reached, position)
    coarse, fine = learnt.coarse.ranges, learnt.fine.ranges
    for f in range(COARSE.features):
        coarse[f, 0], coarse[f, 1] = min(coarse[f, 0], values[f]), max(coarse[f, 1], values[f])
    for f in range(FINE.features):
        fine[f, 0], fine[f, 1] = min(fine[f, 0], values[f]), max(fine[f, 1], values[f])
    notes.stay.force = force


@inlined
def copy_map(maps: NDArray[np.void], copies: NDArray[np.void], index: int) -> None:
    """Copy the map of an array of one to an index of another array."""
    numbers, written = maps.view(np.float64), copies.view(np.float64)
    for k in range(SIZE):  # a slice of an array into another takes seconds to compile
        written[index * SIZE + k] = numbers[k]


@inlined
def snap(bank: Bank, time: float) -> None:
    """Keep a snapshot of the map, to be scored later."""
    notes = bank.notes[0]
    if time - notes.snapped_at >= RING_PERIOD - 1e-7 or notes.snapshots == 0:
        notes.snapped_at = time
        index = notes.snapshots % RING
        copy_map(bank.map, bank.ring, index)
        bank.contacts[index], bank.times[index] = notes.contact, time
        bank.ranges[index, 0], bank.ranges[index, 1] = notes.lowest, bank.map[0].law_reached
        notes.snapshots += 1


@inlined
def note_present(bank: Bank, sample: tuple[float, float, float], period: float) -> bool:
    """Note the errors before a sample in contact is learnt; whether it is the fine map's alone."""
    position, velocity, force = sample
    learnt, notes, values = bank.map[0], bank.notes[0], bank.values[:]
    fading, law = math.exp(-period / LEARNING_TIME), law_force(learnt, position, velocity)
    present = notes.present
    present.law = fading * present.law + period * squared(law - force)
    present.law_time = fading * present.law_time + period
    place, raw = position - learnt.place, force + learnt.zero
    if not in_fine_reach(place) or bank.coarse.rows == 0:
        return False
    coarse = abs(mapped(learnt.coarse, COARSE, position, values) - raw)
    fine = abs(mapped(learnt.fine, FINE, place, values) - raw)
    most = notes.peak * notes.peak  # for a sensor may say anything once
    present.coarse += period * min(coarse * coarse, most)
    present.fine += period * min(fine * fine, most)
    present.time += period
    is_better = learnt.shares[2] > FINE_ALONE and fine < FINE_ALONE * coarse
    # What is deeper than the fine map reaches goes on from the coarse one.
    return bool(is_better and coarse > CLEAR * notes.peak and learnt.reached - learnt.place < FINE_TO - PLAYS[0])


@inlined
def learn(bank: Bank, time: float, position: float, velocity: float, force: float, contact: bool) -> int:
    """Learn one sample, in place; return the result."""
    learnt, notes, values = bank.map[0], bank.notes[0], bank.values[:]
    period = time - notes.learnt_at
    period = PERIOD if math.isinf(period) else min(period, LONGEST_PERIOD)
    notes.learnt_at = time
    features(bank.memory, position, velocity, values)
    sample, wrong_for = (position, velocity, force), notes.wrong.time
    if notes.snapshots > 0:
        score_late(bank, time, sample, contact, period)
    is_spike = wrong_for < notes.wrong.time <= LONGEST_SPIKE and force > BEYOND * notes.peak
    visited = position <= learnt.reached
    widen(bank, sample, contact, period)

    code, raw, spoilt = LEARNT, force + learnt.zero, False
    coarse_weights, fine_weights = learnt.coarse.weights[:], learnt.fine.weights[:]
    fines_alone = contact and note_present(bank, sample, period)
    # What sticks pulls only once it was touched: the maps learn how, not where nothing is touched yet.
    is_apart = learnt.pull > 0.0 and not contact and bank.memory[STUCK] == 0.0 and position < learnt.touch
    if not (is_spike or is_apart):
        if not fines_alone:
            error = fit(coarse_weights, bank.coarse, COARSE, position, values, raw)
            spoilt = math.isnan(error)
            if contact and abs(error) > CLEAR * notes.peak and not in_fine_reach(position - learnt.place):
                place_fine(bank, position)
        spoilt = math.isnan(fit(fine_weights, bank.fine, FINE, position - learnt.place, values, raw)) or spoilt
    if visited and notes.contact > CHANGED_FROM and notes.wrong.time >= YOUNG:
        index = snapshot_before(bank, time - max(bank.horizon, LONGEST_HORIZON), position)
        if index >= 0:
            code = CHANGED
            bank.changes += 1
            begin_changed(bank, index, position)
            fit(coarse_weights, bank.coarse, COARSE, position, values, raw)
            fit(fine_weights, bank.fine, FINE, position - learnt.place, values, raw)
    if notes.faded >= 1.0:
        notes.faded = 0.0
        fade(bank.coarse, DRIFT * DRIFT)
        fade(bank.fine, DRIFT * DRIFT)
    allot(bank)
    snap(bank, time)

    odd, numbers = 0, bank.map.view(np.float64)
    for k in range(SIZE):  # element by element, for a sum would wait for each number before the next
        odd += 0 if abs(numbers[k]) <= LARGEST else 1
    return FAILED if spoilt or odd > 0 else code
