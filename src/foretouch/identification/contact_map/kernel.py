"""One sample for the whole bank of experts, and whole recordings of raw samples, compiled.

What the bank does and why is told by `foretouch.identification.ContactMapBank`. A recording is one compiled loop, in
which each sample is conditioned, compared with the model before it and learnt from: what `Learner.update` does, in its
order and with the same functions; the residual is that of `identify`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.conditioning.kernel import clear, condition, is_full, lose_surface, take_lagged
from foretouch.identification.conditioning.layout import OFFSET, SURFACE
from foretouch.identification.contact_map.learning import ALARM_FROM, CHANGED, FAILED, PERIOD, learn, restart
from foretouch.identification.contact_map.regression import regression
from foretouch.identification.contact_map.scores import (
    ABSENT,
    BEGIN_COARSE,
    BEGIN_FINE,
    BEGIN_FLAT,
    BEGIN_LAW,
    BEGIN_MEMORY,
    BEGIN_NOTES,
    BEGIN_RATES,
    BEGIN_SETTINGS,
    BEGIN_TIMES,
    BEGIN_VALUES,
    BEGUN,
    CHANGES,
    CONTACT,
    FIRST_DOUBT,
    HORIZON,
    LEARNT_AT,
    MOMENTS,
    PATIENCE,
    SPREAD,
    TIME,
    TOUCHED,
    UPDATES,
)
from foretouch.identification.exact.belief import law_numbers
from foretouch.identification.exact.belief import move_surface as move_law
from foretouch.identification.exact.kernel import take as take_law
from foretouch.identification.exact.law import COVARIANCE, NOTES, REFERENCE, THETA, UNKNOWNS
from foretouch.models.contact_map.kernel import rates, remember, step
from foretouch.models.contact_map.layout import (
    DOUBT,
    DOUBTS,
    EXPERTS,
    FELT,
    LARGEST_FORCE,
    LAW,
    LAW_SURFACE,
    MEMORY,
    ORIGIN,
    SIZE,
    ZERO,
)
from foretouch.models.contact_map.wire import sensible, transfer
from foretouch.models.contact_model import LARGEST_DEPTH, LARGEST_SPEED

Array = NDArray[np.float64]

_compiled = compiled(error_model="numpy")
_inlined = compiled(error_model="numpy", forceinline=True)

FEWEST_UPDATES = 8
"""No force is rendered from fewer samples."""

LARGEST_SHIFT, LARGEST_SHIFT_IN_YOUTH, YOUTH = 9e-3, 1e-3, 0.3
"""A surface that is found further than this [m] from where the map began is out of its reach: the map begins anew; at
less in its first time in contact [s], for then the first contact was none and little is lost."""

FREE_AIR, UNUSABLE, WAITING, LEARNT, LEARNT_IN_AIR, OTHER, GONE, RESTARTED = range(8)
"""What a sample did: all from LEARNT on have changed the model. OTHER is a material that has become another one, and
GONE one that is no longer there."""


def _begin(state: Array) -> None:
    """Begin a map where the surface is now."""
    flat, notes = state[BEGIN_FLAT:BEGIN_MEMORY], state[BEGIN_NOTES:BEGIN_RATES]
    restart(flat, regression(state[BEGIN_COARSE:BEGIN_FINE], 0), regression(state[BEGIN_FINE:], 1), notes)
    flat[ORIGIN] = flat[ZERO] = flat[FELT] = 0.0
    flat[DOUBT : DOUBT + DOUBTS] = 0.0
    flat[DOUBT + 1] = FIRST_DOUBT**2
    notes[MOMENTS:SPREAD] = 0.0
    notes[SPREAD] = 1.0
    notes[LEARNT_AT] = -math.inf
    state[BEGIN_MEMORY:BEGIN_NOTES] = math.nan
    notes[BEGUN] = notes[UPDATES]


begin: Callable[[Array], None] = _compiled(_begin)


def _reset(state: Array) -> None:
    """Forget all samples; what was set stays, and how many changes there were."""
    notes = state[BEGIN_NOTES:BEGIN_RATES]
    horizon, changes = notes[HORIZON], notes[CHANGES]
    state[BEGIN_FLAT : BEGIN_NOTES + ABSENT] = 0.0
    state[BEGIN_NOTES + ABSENT + EXPERTS : BEGIN_SETTINGS] = 0.0
    notes[HORIZON], notes[CHANGES] = horizon, changes
    notes[PATIENCE], notes[TIME] = ALARM_FROM, math.nan
    begin(state)


reset: Callable[[Array], None] = _compiled(_reset)


def _move_surface(state: Array, change: float) -> None:
    """Depths count from a surface that is deeper by a change [m] from now on; the map stays where it is."""
    if not math.isfinite(change):
        return
    law, flat = state[BEGIN_LAW:BEGIN_SETTINGS], state[BEGIN_FLAT:BEGIN_MEMORY]
    covariance = law[COVARIANCE:NOTES].reshape((UNKNOWNS, UNKNOWNS))
    move_law(law[THETA:COVARIANCE], covariance, law[NOTES:], state[BEGIN_SETTINGS:BEGIN_TIMES], change)
    flat[ORIGIN] -= change
    flat[LAW_SURFACE] += change
    young = state[BEGIN_NOTES + CONTACT] < YOUTH
    if abs(flat[ORIGIN]) > (LARGEST_SHIFT_IN_YOUTH if young else LARGEST_SHIFT):
        begin(state)


move_surface: Callable[[Array, float], None] = _compiled(_move_surface)


def _move_offset(state: Array, change: float) -> None:
    """Forces count from an offset that is larger by a change [N] from now on; the map keeps what the sensor said."""
    if math.isfinite(change):
        state[BEGIN_FLAT + ZERO] += change


move_offset: Callable[[Array, float], None] = _compiled(_move_offset)


def _take(state: Array, time: float, depth: float, velocity: float, force: float, in_contact: bool) -> int:
    """One sample, in place; returns what it did.

    Args:
        state: All that is remembered, shape (TOTAL,) of `contact_map.scores`.
        time: [s].
        depth: Below the surface [m], NaN before that is known.
        velocity: [m/s].
        force: Less the offset [N].
        in_contact: The conditioner's judgement.
    """
    law = state[BEGIN_LAW:BEGIN_SETTINGS]
    settings = state[BEGIN_SETTINGS:BEGIN_TIMES]
    if in_contact:
        take_law(law, settings, time, depth, velocity, force)
    if not (abs(depth) <= LARGEST_DEPTH and abs(velocity) <= LARGEST_SPEED and abs(force) <= LARGEST_FORCE):
        return FREE_AIR if math.isnan(depth) else UNUSABLE
    notes = state[BEGIN_NOTES:BEGIN_RATES]
    if in_contact:
        notes[TOUCHED] = 1.0
    if notes[TOUCHED] == 0.0:  # the map counts from the first contact
        return FREE_AIR
    before = notes[TIME]
    if not time > before and not math.isnan(before):
        return UNUSABLE
    shares = state[BEGIN_RATES:BEGIN_VALUES]
    rates(0.0 if math.isnan(before) else time - before, shares)
    notes[TIME] = time
    flat = state[BEGIN_FLAT:BEGIN_MEMORY]
    place = depth - flat[ORIGIN]
    remember(state[BEGIN_MEMORY:BEGIN_NOTES], place, shares)
    if time - notes[LEARNT_AT] < PERIOD - 1e-7:
        return WAITING
    theta, memory = law[THETA:COVARIANCE], law[NOTES:]
    if law_numbers(theta, memory, settings, flat[LAW : LAW + 4]):
        flat[LAW_SURFACE] = theta[4] * memory[REFERENCE]
    code = learn(state, time, place, velocity, force, in_contact)
    if code == FAILED:
        reset(state)
        return RESTARTED
    notes[UPDATES] += 1.0
    if code != CHANGED:
        return LEARNT if in_contact else LEARNT_IN_AIR
    notes[CHANGES] += 1.0
    if in_contact:
        return OTHER
    # The material is gone, and nobody knows how far: all waits for the next touch.
    law[:] = 0.0
    flat[LAW : LAW + 4] = 0.0
    flat[LAW_SURFACE] = 0.0
    begin(state)
    notes[TOUCHED] = 0.0
    return GONE


take: Callable[[Array, float, float, float, float, bool], int] = _compiled(_take)


def _run(
    state: Array,
    time: Array,
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    codes: NDArray[np.int8],
) -> None:
    """`take` for one sample after the other; the codes are written."""
    for i in range(time.size):
        codes[i] = take(state, time[i], depth[i], velocity[i], force[i], in_contact[i])


run: Callable[[Array, Array, Array, Array, Array, NDArray[np.bool_], NDArray[np.int8]], None] = _compiled(_run)


RawColumns = tuple[NDArray[np.bool_], Array, Array]

BEFORE = 0  # time of the newest sample [s], NaN before the first; then its depth, velocity, force, and 1 in contact
STALE = 5  # 1 where the model is to be made anew before it is asked
KNOWN = 6  # 1 where there is a model
DEVIATION = 7  # standard deviation of the force at the last sample that has a residual [N]
SCRATCH = 8  # what the material remembers
MODEL = SCRATCH + MEMORY  # the map as it crosses the network: rounded to 32 bits, and the law's numbers
SHORT = MODEL + SIZE  # and packed
RAW_SIZE = SHORT + SIZE


def make_notes(before: float) -> Array:
    """What a run remembers beside the learner, before its first block.

    Args:
        before: Time of the newest sample that was learnt from already [s], NaN where there is none.
    """
    notes = np.zeros(RAW_SIZE)
    notes[BEFORE], notes[STALE], notes[DEVIATION] = before, 1.0, math.nan
    return notes


def _adopt(flat: Array, model: Array, short: Array) -> bool:
    """The map as it is after `pack` and `unpack`; False where no model can be made of it.

    Args:
        flat: As it was learnt.
        model: Written, shape (SIZE,).
        short: Scratch, shape (SIZE,).
    """
    for k in range(SIZE):
        model[k] = float(np.float32(flat[k]))
    for k in range(LAW, LAW + 4):
        if not 0.0 <= flat[k] < math.inf:
            return False
        model[k] = 0.0
    if not sensible(short[: transfer(model, short, False)]):
        return False
    for k in range(LAW, LAW + 4):
        model[k] = flat[k]
    return True


adopt = compiled(error_model="numpy")(_adopt)


def _expect(notes: Array, state: Array, depth: float, velocity: float, period: float) -> float:
    """Force of the model at a sample, `foretouch.models.advance` from the state before it [N]; NaN without a model.

    Args:
        notes: Of the run.
        state: Of the bank, before it takes the sample.
        depth: Below the surface that was known before [m].
        velocity: [m/s].
        period: Since the sample before [s].
    """
    model = notes[MODEL:SHORT]
    if notes[STALE] != 0.0:
        known = state[BEGIN_NOTES + UPDATES] - state[BEGIN_NOTES + BEGUN] >= FEWEST_UPDATES
        notes[KNOWN] = 1.0 if known and adopt(state[BEGIN_FLAT:BEGIN_MEMORY], model, notes[SHORT:]) else 0.0
        notes[STALE] = 0.0
    if notes[KNOWN] == 0.0:
        return math.nan
    memory = notes[SCRATCH:MODEL]
    for k in range(MEMORY):
        memory[k] = state[BEGIN_MEMORY + k]
        if not math.isfinite(memory[k]):
            memory[:] = math.nan
            break
    depth = -LARGEST_DEPTH if math.isnan(depth) else min(max(depth, -LARGEST_DEPTH), LARGEST_DEPTH)
    velocity = 0.0 if math.isnan(velocity) else min(max(velocity, -LARGEST_SPEED), LARGEST_SPEED)
    force, notes[DEVIATION] = step(model, memory, depth, velocity, period)
    return float(force)


expect = compiled(error_model="numpy")(_expect)


def _run_raw(
    state: Array,
    conditioner: Array,
    lag: Array,
    notes: Array,
    rows: Array,
    measured: bool,
    in_contact: NDArray[np.bool_],
    forces: Array,
    residual: Array,
) -> tuple[int, int]:
    """One block of samples; see `ContactMapBank.run_raw`. Returns how many were taken and what the last one did."""
    code = 0
    for i in range(rows.shape[1]):
        time, position, raw = rows[0, i], rows[1, i], rows[2, i]
        surface, offset, before = conditioner[SURFACE], conditioner[OFFSET], notes[BEFORE]
        depth, velocity, force, touching = condition(conditioner, time, position, raw, rows[3, i], measured)
        in_contact[i], forces[i], residual[i] = touching, force, math.nan
        if touching:
            residual[i] = force - expect(notes, state, position - surface, velocity, time - before)
        moved = conditioner[SURFACE] - surface
        if abs(moved) > 0.0:  # not where one of them is unknown
            move_surface(state, moved)
            notes[STALE] = 1.0
        if conditioner[OFFSET] != offset:
            move_offset(state, conditioner[OFFSET] - offset)
            notes[STALE] = 1.0
        code = take(state, time, depth, velocity, force, touching)
        if code >= LEARNT:
            notes[STALE] = 1.0
        if code in (OTHER, GONE):
            if not touching:
                lose_surface(conditioner)
            clear(lag)
        if touching:
            take_lagged(lag, depth + conditioner[SURFACE], velocity, raw, time - before)
        notes[BEFORE], notes[BEFORE + 1], notes[BEFORE + 2], notes[BEFORE + 3] = time, depth, velocity, force
        notes[BEFORE + 4] = 1.0 if touching else 0.0
        if is_full(conditioner):
            return i + 1, code
    return rows.shape[1], code


run_raw: Callable[[Array, Array, Array, Array, Array, bool, NDArray[np.bool_], Array, Array], tuple[int, int]] = (
    compiled(error_model="numpy")(_run_raw)
)
