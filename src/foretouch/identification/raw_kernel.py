"""Raw samples conditioned, learnt from by the bank, and compared with the model before each: one compiled loop.

What is done with a sample is what `Learner.update` does, in its order and with the same functions; the residual is that
of `identify`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.conditioning_kernel import condition, is_full, lose_surface
from foretouch.identification.conditioning_layout import OFFSET, SURFACE
from foretouch.identification.contact_map_notes import (
    BEGIN_FLAT,
    BEGIN_MEMORY,
    BEGIN_NOTES,
    BEGUN,
    UPDATES,
)
from foretouch.identification.contact_map_step import (
    FEWEST_UPDATES,
    GONE,
    LEARNT,
    OTHER,
    move_offset,
    move_surface,
    take,
)
from foretouch.identification.sensor_lag_kernel import clear, take_lagged
from foretouch.models.contact_map_kernel import step
from foretouch.models.contact_map_layout import LAW, MEMORY, SIZE
from foretouch.models.contact_map_wire import sensible, transfer
from foretouch.models.contact_model import LARGEST_DEPTH, LARGEST_SPEED

__all__ = ["BEFORE", "DEVIATION", "STALE", "RawColumns", "make_notes", "run_raw"]

Array = NDArray[np.float64]
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
    """The map as it is after `contact_map_wire.pack` and `unpack`; False where no model can be made of it.

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
