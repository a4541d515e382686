"""One sample for the whole bank of experts, and whole recordings of raw samples, compiled.

What the bank does and why is told by `foretouch.identification.ContactMap`. A recording is one compiled loop, in
which each sample is conditioned, compared with the model before it and learnt from: what `Learner.update` does, in its
order and with the same functions; the residual is that of `identify`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.conditioning.kernel import Memory, clear, condition, is_full, lose_surface, take_lagged
from foretouch.identification.contact_map import scores as at
from foretouch.identification.contact_map.learning import ALARM_FROM, CHANGED, FAILED, PERIOD, learn, restart
from foretouch.identification.contact_map.regression import regression
from foretouch.identification.contact_map.scores import FIRST_UNCERTAINTY
from foretouch.identification.exact.belief import law_numbers
from foretouch.identification.exact.belief import move_surface as move_law
from foretouch.identification.exact.kernel import take as take_law
from foretouch.identification.exact.law import COVARIANCE, NOTES, REFERENCE, THETA, UNKNOWNS
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.kernel import rates, remember, step
from foretouch.models.contact_map.wire import sensible, transfer
from foretouch.models.contact_model import LARGEST_DEPTH, LARGEST_SPEED

Array = NDArray[np.float64]


FEWEST_UPDATES = 8
"""Least number of samples from which a force is rendered."""

LARGEST_SHIFT, LARGEST_SHIFT_IN_YOUTH, YOUTH = 9e-3, 1e-3, 0.3
"""Largest shift of the surface from where the map began [m], after which the map begins anew; a smaller one in its
first time in contact [s], for then the first contact was false and little is lost."""

FREE_AIR, UNUSABLE, WAITING, LEARNT, LEARNT_IN_AIR, OTHER, GONE, RESTARTED = range(8)
"""Result of a sample: all from LEARNT on have changed the model. OTHER is a material that has changed, and GONE one
that is no longer there."""


@compiled(error_model="numpy")
def begin(state: Array) -> None:
    """Begin a map where the surface is now."""
    flat, notes = state[at.BEGIN_FLAT : at.BEGIN_MEMORY], state[at.BEGIN_NOTES : at.BEGIN_RATES]
    restart(flat, regression(state[at.BEGIN_COARSE : at.BEGIN_FINE], 0), regression(state[at.BEGIN_FINE :], 1), notes)
    flat[layout.ORIGIN] = flat[layout.ZERO] = flat[layout.FELT] = 0.0
    flat[layout.UNCERTAINTY : layout.UNCERTAINTY + layout.UNCERTAINTIES] = 0.0
    flat[layout.UNCERTAINTY + 1] = FIRST_UNCERTAINTY**2
    notes[at.MOMENTS : at.SPREAD] = 0.0
    notes[at.SPREAD] = 1.0
    notes[at.LEARNT_AT] = -math.inf
    state[at.BEGIN_MEMORY : at.BEGIN_NOTES] = math.nan
    notes[at.BEGUN] = notes[at.UPDATES]


@compiled(error_model="numpy")
def reset(state: Array) -> None:
    """Forget all samples; what was set stays, and how many changes there were."""
    notes = state[at.BEGIN_NOTES : at.BEGIN_RATES]
    horizon, changes = notes[at.HORIZON], notes[at.CHANGES]
    state[at.BEGIN_FLAT : at.BEGIN_NOTES + at.ABSENT] = 0.0
    state[at.BEGIN_NOTES + at.ABSENT + layout.EXPERTS : at.BEGIN_SETTINGS] = 0.0
    notes[at.HORIZON], notes[at.CHANGES] = horizon, changes
    notes[at.PATIENCE], notes[at.TIME] = ALARM_FROM, math.nan
    begin(state)


@compiled(error_model="numpy")
def move_surface(state: Array, change: float) -> None:
    """Depths count from a surface that is deeper by a change [m] from now on; the map stays where it is."""
    if not math.isfinite(change):
        return
    law, flat = state[at.BEGIN_LAW : at.BEGIN_SETTINGS], state[at.BEGIN_FLAT : at.BEGIN_MEMORY]
    covariance = law[COVARIANCE:NOTES].reshape((UNKNOWNS, UNKNOWNS))
    move_law(law[THETA:COVARIANCE], covariance, law[NOTES:], state[at.BEGIN_SETTINGS : at.BEGIN_TIMES], change)
    flat[layout.ORIGIN] -= change
    flat[layout.LAW_SURFACE] += change
    young = state[at.BEGIN_NOTES + at.CONTACT] < YOUTH
    if abs(flat[layout.ORIGIN]) > (LARGEST_SHIFT_IN_YOUTH if young else LARGEST_SHIFT):
        begin(state)


@compiled(error_model="numpy")
def move_offset(state: Array, change: float) -> None:
    """Forces count from an offset that is larger by a change [N] from now on; the map keeps what the sensor said."""
    if math.isfinite(change):
        state[at.BEGIN_FLAT + layout.ZERO] += change


@compiled(error_model="numpy")
def take(state: Array, time: float, depth: float, velocity: float, force: float, in_contact: bool) -> int:
    """Process one sample, in place; returns its result.

    Args:
        state: All that is remembered, shape (TOTAL,) of `contact_map.scores`.
        time: [s].
        depth: Below the surface [m], NaN before that is known.
        velocity: [m/s].
        force: Less the offset [N].
        in_contact: The conditioner's judgement.
    """
    law = state[at.BEGIN_LAW : at.BEGIN_SETTINGS]
    settings = state[at.BEGIN_SETTINGS : at.BEGIN_TIMES]
    if in_contact:
        take_law(law, settings, time, depth, velocity, force)
    if not (abs(depth) <= LARGEST_DEPTH and abs(velocity) <= LARGEST_SPEED and abs(force) <= layout.LARGEST_FORCE):
        return FREE_AIR if math.isnan(depth) else UNUSABLE
    notes = state[at.BEGIN_NOTES : at.BEGIN_RATES]
    if in_contact:
        notes[at.TOUCHED] = 1.0
    if notes[at.TOUCHED] == 0.0:  # the map counts from the first contact
        return FREE_AIR
    before = notes[at.TIME]
    if not time > before and not math.isnan(before):
        return UNUSABLE
    shares = state[at.BEGIN_RATES : at.BEGIN_VALUES]
    rates(0.0 if math.isnan(before) else time - before, shares)
    notes[at.TIME] = time
    flat = state[at.BEGIN_FLAT : at.BEGIN_MEMORY]
    place = depth - flat[layout.ORIGIN]
    remember(state[at.BEGIN_MEMORY : at.BEGIN_NOTES], place, shares)
    if time - notes[at.LEARNT_AT] < PERIOD - 1e-7:
        return WAITING
    theta, memory = law[THETA:COVARIANCE], law[NOTES:]
    if law_numbers(theta, memory, settings, flat[layout.LAW : layout.LAW + 4]):
        flat[layout.LAW_SURFACE] = theta[4] * memory[REFERENCE]
    code = learn(state, time, place, velocity, force, in_contact)
    if code == FAILED:
        reset(state)
        return RESTARTED
    notes[at.UPDATES] += 1.0
    if code != CHANGED:
        return LEARNT if in_contact else LEARNT_IN_AIR
    notes[at.CHANGES] += 1.0
    if in_contact:
        return OTHER
    # The material is gone, and nobody knows how far: all waits for the next touch.
    law[:] = 0.0
    flat[layout.LAW : layout.LAW + 4] = 0.0
    flat[layout.LAW_SURFACE] = 0.0
    begin(state)
    notes[at.TOUCHED] = 0.0
    return GONE


@compiled(error_model="numpy")
def run(
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


RawColumns = tuple[NDArray[np.bool_], Array, Array]

BEFORE = 0  # time of the newest sample [s], NaN before the first; then its depth, velocity, force, and 1 in contact
STALE = 5  # 1 where the model is to be made anew before it is asked
KNOWN = 6  # 1 where there is a model
DEVIATION = 7  # standard deviation of the force at the last sample that has a residual [N]
SCRATCH = 8  # what the material remembers
MODEL = SCRATCH + layout.MEMORY  # the map as it crosses the network: rounded to 32 bits, and the law's numbers
SHORT = MODEL + layout.SIZE  # and packed
RAW_SIZE = SHORT + layout.SIZE


def make_notes(before: float) -> Array:
    """What a run remembers beside the learner, before its first block.

    Args:
        before: Time of the newest sample that was learnt from already [s], NaN where there is none.
    """
    notes = np.zeros(RAW_SIZE)
    notes[BEFORE], notes[STALE], notes[DEVIATION] = before, 1.0, math.nan
    return notes


@compiled(error_model="numpy")
def adopt(flat: Array, model: Array, short: Array) -> bool:
    """The map as it is after `pack` and `unpack`; False where no model can be made of it.

    Args:
        flat: As it was learnt.
        model: Written, shape (SIZE,).
        short: Scratch, shape (SIZE,).
    """
    for k in range(layout.SIZE):
        model[k] = float(np.float32(flat[k]))
    for k in range(layout.LAW, layout.LAW + 4):
        if not 0.0 <= flat[k] < math.inf:
            return False
        model[k] = 0.0
    if not sensible(short[: transfer(model, short, False)]):
        return False
    for k in range(layout.LAW, layout.LAW + 4):
        model[k] = flat[k]
    return True


@compiled(error_model="numpy")
def expect(notes: Array, state: Array, depth: float, velocity: float, period: float) -> float:
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
        known = state[at.BEGIN_NOTES + at.UPDATES] - state[at.BEGIN_NOTES + at.BEGUN] >= FEWEST_UPDATES
        notes[KNOWN] = 1.0 if known and adopt(state[at.BEGIN_FLAT : at.BEGIN_MEMORY], model, notes[SHORT:]) else 0.0
        notes[STALE] = 0.0
    if notes[KNOWN] == 0.0:
        return math.nan
    memory = notes[SCRATCH:MODEL]
    for k in range(layout.MEMORY):
        memory[k] = state[at.BEGIN_MEMORY + k]
        if not math.isfinite(memory[k]):
            memory[:] = math.nan
            break
    depth = -LARGEST_DEPTH if math.isnan(depth) else min(max(depth, -LARGEST_DEPTH), LARGEST_DEPTH)
    velocity = 0.0 if math.isnan(velocity) else min(max(velocity, -LARGEST_SPEED), LARGEST_SPEED)
    force, notes[DEVIATION] = step(model, memory, depth, velocity, period)
    return float(force)


@compiled(error_model="numpy")
def run_raw(
    state: Array,
    conditioner: Memory,
    lag: NDArray[np.void],
    notes: Array,
    rows: Array,
    measured: bool,
    in_contact: NDArray[np.bool_],
    forces: Array,
    residual: Array,
) -> tuple[int, int]:
    """One block of samples; see `ContactMap.run_raw`. Returns how many were taken and what the last one did."""
    code, conditioned = 0, conditioner[0][0]
    for i in range(rows.shape[1]):
        time, position, raw = rows[0, i], rows[1, i], rows[2, i]
        surface, offset, before = conditioned.surface, conditioned.offset, notes[BEFORE]
        depth, velocity, force, touching = condition(conditioner, time, position, raw, rows[3, i], measured)
        in_contact[i], forces[i], residual[i] = touching, force, math.nan
        if touching:
            residual[i] = force - expect(notes, state, position - surface, velocity, time - before)
        moved = conditioned.surface - surface
        if abs(moved) > 0.0:  # not where one of them is unknown
            move_surface(state, moved)
            notes[STALE] = 1.0
        if conditioned.offset != offset:
            move_offset(state, conditioned.offset - offset)
            notes[STALE] = 1.0
        code = take(state, time, depth, velocity, force, touching)
        if code >= LEARNT:
            notes[STALE] = 1.0
        if code in (OTHER, GONE):
            if not touching:
                lose_surface(conditioner)
            clear(lag)
        if touching:
            take_lagged(lag, depth + conditioned.surface, velocity, raw, time - before)
        notes[BEFORE], notes[BEFORE + 1], notes[BEFORE + 2], notes[BEFORE + 3] = time, depth, velocity, force
        notes[BEFORE + 4] = 1.0 if touching else 0.0
        if is_full(conditioner):
            return i + 1, code
    return rows.shape[1], code
