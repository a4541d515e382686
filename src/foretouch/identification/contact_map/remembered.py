r"""A contact map from before as prior mean of the one that is learnt: `foretouch.identification.ContactMap.recall`.

With a prior mean m instead of 0, recursive least squares gives the weights w + t, where w are those that are learnt
without it, and

.. math:: t = P Q^{-1} m, \quad t \leftarrow t - K h^T t

with the prior covariance Q, and P and K of that moment, for none of them depends on a force. So the map without memory
is learnt as ever, t is kept beside it from the time on at which it is known where m belongs, and both maps are compared
on every sample. The fine map has no m of its own, but takes over t of the coarse one where it begins: what was mostly
fine is not recalled.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined, scratch, squared
from foretouch.identification.conditioning.kernel import PEAK_SHARE
from foretouch.identification.contact_map.learning import copy_map, refine, snapshot_at
from foretouch.identification.contact_map.regression import expect_mean, reach
from foretouch.identification.contact_map.state import DROPPED, EARLY, RING, Bank
from foretouch.identification.exact.belief import LEARNING_TIME, YOUNG
from foretouch.models.contact_map.kernel import blend, cubic, experts
from foretouch.models.contact_map.layout import CLEAR, COARSE, EXPERTS, FINE, STUCK, Map
from foretouch.models.contact_model import LARGEST_DEPTH

Array = NDArray[np.float64]

CONTRADICTED = PEAK_SHARE * PEAK_SHARE * YOUNG
"""Cumulative sum, relative to the square of the peak, with which a map from before is dropped [s]: late predictions
that are wrong with it and right without it by half as much as those that show a change, for as long."""

REFINEMENTS = 6  # Halvings of the step of a place

MOST_VALUES = COARSE.knots + 2  # Values from which the weights of the longest spline are made


@compiled(error_model="numpy")
def shift_part(weights: Array, begin: int, knots: int, spacing: float, below: int, change: float) -> None:
    """Move a cubic spline on even knots inwards by a change [m]; exact for cubics (de Boor and Fix 1973)."""
    values = scratch(np.float64, MOST_VALUES)
    for k in range(knots + 2):
        first, a, b, c, d = cubic((k - below - 2) * spacing - change, spacing, below, knots)
        values[k] = blend(weights, begin + first, a, b, c, d)
    for k in range(knots):
        weights[begin + k] = (8.0 * values[k + 1] - values[k] - values[k + 2]) / 6.0


@compiled(error_model="numpy")
def shift(learnt: Map, change: float) -> None:
    """Move a map inwards by a change [m]."""
    coarse = learnt.coarse.weights[:]
    shift_part(coarse, 0, COARSE.knots, COARSE.spacing, COARSE.below, change)
    for f in range(COARSE.features):
        begin = COARSE.knots + f * COARSE.feature_knots
        shift_part(coarse, begin, COARSE.feature_knots, COARSE.feature_spacing, COARSE.feature_below, change)
    learnt.lowest += change
    learnt.reached += change
    learnt.law_reached += change
    learnt.place += change
    learnt.touch += change
    learnt.catch += change
    learnt.hold += change
    learnt.law_surface -= change


@inlined
def misfit(bank: Bank, change: float) -> float:
    """Mean squared error of the map from before on the first samples, were it moved inwards by a change [m]."""
    kept, total = bank.remembered, 0.0
    for i in range(kept.count):
        one = kept.first[i]
        force = experts(kept.given[0], one.values, one.position - change, one.velocity, 1.0, True)[3]
        total += squared(force - one.force)
    return total / kept.count


@compiled(error_model="numpy")
def best_change(bank: Bank) -> float:
    """How far inwards the map from before has to be moved to fit the first samples best [m]."""
    given, first = bank.remembered.given[0], bank.remembered.first[0]
    step = 0.25 * COARSE.spacing
    change, best = 0.0, misfit(bank, 0.0)
    for k in range(1, int((given.reached - given.lowest) / step)):
        error = misfit(bank, first.position - given.lowest - k * step)
        if error < best:
            change, best = first.position - given.lowest - k * step, error
    for _ in range(REFINEMENTS):
        step *= 0.5
        for side in (-step, step):
            error = misfit(bank, change + side)
            if error < best:
                change, best = change + side, error
                break
    return change


@compiled(error_model="numpy")
def drop(bank: Bank) -> None:
    """From now on the map is what is learnt without the one from before."""
    bank.remembered.state = DROPPED
    bank.coarse.traced = bank.fine.traced = 0


@compiled(error_model="numpy")
def recall(bank: Bank, time: float) -> None:
    """Give the map from before as the mean, where it fits the first samples best; drop it where it does not."""
    kept, coarse, change = bank.remembered, bank.coarse, best_change(bank)
    if kept.given[0].shares[2] > 0.5 or misfit(bank, change) > squared(CLEAR * bank.notes[0].peak):
        drop(bank)
        return
    kept.since, kept.against = time, 0.0
    copy_map(kept.given, kept.placed, 0)
    given = kept.placed[0]
    shift(given, change)
    for position in (given.lowest, given.reached):
        knot = cubic(position, COARSE.spacing, COARSE.below, COARSE.knots)[0]
        feature = cubic(position, COARSE.feature_spacing, COARSE.feature_below, COARSE.feature_knots)[0]
        reach(bank.map[0].coarse.weights[:], coarse, knot, feature)
    expect_mean(coarse, given.coarse.weights[:])
    refine(coarse.trace[:], bank.fine.trace[:], bank.map[0].place)
    bank.fine.traced = 1


@compiled(error_model="numpy")
def show(bank: Bank) -> None:
    """Write the map with what is left of the one from before."""
    learnt, given, shown = bank.map[0], bank.remembered.placed[0], bank.remembered.shown[0]
    copy_map(bank.map, bank.remembered.shown, 0)
    for k in range(COARSE.size):
        shown.coarse.weights[k] += bank.coarse.trace[k]
    for k in range(FINE.size):
        shown.fine.weights[k] += bank.fine.trace[k]
    shown.lowest, shown.reached = min(learnt.lowest, given.lowest), max(learnt.reached, given.reached)
    shown.felt, shown.law_speed = max(learnt.felt, given.felt), max(learnt.law_speed, given.law_speed)
    shown.law_reached = max(learnt.law_reached, given.law_reached)
    for f in range(COARSE.features):
        shown.coarse.ranges[f, 0] = min(learnt.coarse.ranges[f, 0], given.coarse.ranges[f, 0])
        shown.coarse.ranges[f, 1] = max(learnt.coarse.ranges[f, 1], given.coarse.ranges[f, 1])
    if not learnt.touch > -LARGEST_DEPTH:
        shown.touch, shown.touch_way, shown.touch_force = given.touch, given.touch_way, given.touch_force
    if not learnt.pull > 0.0:
        shown.pull, shown.catch, shown.hold = given.pull, given.catch, given.hold
    if bank.notes[0].contact < LEARNING_TIME:  # the weights of the experts are not known yet
        for k in range(4):
            shown.law[k] = given.law[k]
        shown.law_surface = given.law_surface - learnt.origin
        for k in range(EXPERTS):
            shown.shares[k] = given.shares[k]


@compiled(error_model="numpy")
def judge(bank: Bank, time: float, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """Compare late predictions with and without the map from before on a sample, and drop it where it does harm.

    The cumulative sum is that of Page (1954): how much worse the squared errors are, but never below 0, so that what
    was good before does not outweigh what is wrong now. Before there are predictions so late, the map from before
    itself is compared, and allowed `CLEAR` of the peak.

    Args:
        bank: The state; its `values` are the features of the sample.
        time: Of the sample [s].
        sample: Position from the origin [m], velocity [m/s], force [N].
        contact: The conditioner's judgement.
        period: Time since the previous sample [s].
    """
    position, velocity, force = sample
    kept, notes = bank.remembered, bank.notes[0]
    index = snapshot_at(bank, time - bank.horizon)
    if index >= 0 and bank.times[index] >= kept.since:
        known = experts(kept.ring[index], bank.values, position, velocity, bank.memory[STUCK], True)[3]
        without = experts(bank.ring[index], bank.values, position, velocity, bank.memory[STUCK], True)[3]
        allowed = squared(without - force)
        counts = contact or max(known, without) > PEAK_SHARE * notes.peak
    else:
        known = experts(kept.placed[0], bank.values, position, velocity, bank.memory[STUCK], True)[3]
        allowed = squared(CLEAR * notes.peak)
        counts = contact
    if counts:
        kept.against = max(kept.against + period * (squared(known - force) - allowed), 0.0)
    if kept.against > CONTRADICTED * notes.peak * notes.peak:
        drop(bank)


@compiled(error_model="numpy")
def attend(bank: Bank, time: float, sample: tuple[float, float, float], contact: bool, period: float) -> None:
    """What a sample that was learnt means for the map from before; as `judge`."""
    kept = bank.remembered
    if bank.coarse.traced > 0:
        judge(bank, time, sample, contact, period)
    elif contact and kept.count < EARLY:
        early = kept.first[kept.count]
        early.position, early.velocity, early.force = sample
        for k in range(bank.values.size):
            early.values[k] = bank.values[k]
        kept.count += 1
        if bank.notes[0].contact >= YOUNG:
            recall(bank, time)
    if bank.coarse.traced == 0:
        return
    show(bank)
    notes = bank.notes[0]
    if notes.snapped_at == time:
        copy_map(kept.shown, kept.ring, (notes.snapshots - 1) % RING)


def from_the_surface(maps: NDArray[np.void]) -> NDArray[np.void]:
    """The same map with positions that count from the published surface, and forces from none.

    Args:
        maps: An array of one map; left as it is.
    """
    result = maps.copy()
    learnt = result[0]
    learnt.coarse.weights[: COARSE.knots] -= learnt.zero
    learnt.fine.weights[: FINE.knots] -= learnt.zero
    origin = float(learnt.origin)
    shift(learnt, origin)
    learnt.law_surface += origin
    learnt.origin = learnt.zero = 0.0
    return result
