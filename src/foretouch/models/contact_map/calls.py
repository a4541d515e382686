"""The contact map for a loop: its step, its slopes and the work to leave contact, each one compiled call.

The memory of the material is passed as plain numbers: a call into compiled code takes 0.3 us in any case, and each
array made of a tuple for it as much again.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.models.contact_map.kernel import Memory, advanced, force_at, moved, rate_of
from foretouch.models.contact_map.layout import MEMORY, ORIGIN
from foretouch.models.contact_model import EXIT_SPEED, SLICE_BEYOND, SLICES, SLICES_BEYOND, SPEED_STEP, ContactState

Array = NDArray[np.float64]


@compiled
def slopes_of(flat: Array, memory: Memory, depth: float, velocity: float, reach: float) -> tuple[float, float]:
    """Local stiffness [N/m], that of the steeper side, and damping [N s/m]."""
    place = depth - flat[ORIGIN]
    here = force_at(flat, memory, place, velocity)
    deeper = force_at(flat, memory, place + reach, velocity)
    shallower = force_at(flat, memory, place - reach, velocity)
    faster = force_at(flat, memory, place, velocity + SPEED_STEP)
    slower = force_at(flat, memory, place, velocity - SPEED_STEP)
    return max(abs(deeper - here), abs(here - shallower)) / reach, (faster - slower) / (2.0 * SPEED_STEP)


@compiled
def work_of(flat: Array, memory: Memory, depth: float, offset: float, largest: float) -> tuple[float, float]:
    """Work of the force plus a constant, never below zero together, while leaving contact, without damping.

    Args:
        flat: The model.
        memory: Present memory.
        depth: Present depth [m].
        offset: The constant [N].
        largest: Bound on the force [N].

    Returns:
        The work [J], and the distance over which it is done [m].
    """
    place = depth - flat[ORIGIN]
    before = max(min(force_at(flat, memory, place, 0.0), largest) + offset, 0.0)
    energy = way = 0.0
    for beyond in (False, True):
        count = SLICES_BEYOND if beyond else SLICES
        length = SLICE_BEYOND if beyond else max(depth, 0.0) / SLICES
        if not length > 0.0:
            continue
        shares = rate_of(length / EXIT_SPEED)
        for _ in range(count):
            if beyond and not before > 0.0:
                break
            place -= length
            memory = moved(memory, place, shares)
            after = max(min(force_at(flat, memory, place, 0.0), largest) + offset, 0.0)
            energy += 0.5 * (before + after) * length
            way += length
            before = after
    return energy, way


UNTOUCHED: ContactState = (math.nan,) * MEMORY
"""Memory of a material before the first sample."""

_slopes, _leaving_work = slopes_of, work_of


@compiled
def memory_of(state: ContactState) -> Memory:
    """A state of `MEMORY` numbers; one with a number that is not finite counts as untouched."""
    for number in state:
        if not math.isfinite(number):
            return math.nan, math.nan, math.nan, math.nan, math.nan
    return state[0], state[1], state[2], state[3], state[4]


@compiled
def advance(
    flat: Array, state: ContactState, depth: float, velocity: float, period: float
) -> tuple[ContactState, float, float]:
    """`ContactMapModel.advance` of a state of `MEMORY` numbers."""
    return advanced(flat, memory_of(state), depth, velocity, period)


@compiled
def local_slopes(flat: Array, state: ContactState, depth: float, velocity: float, reach: float) -> tuple[float, float]:
    """`ContactMapModel.local_slopes` of a state of `MEMORY` numbers."""
    return _slopes(flat, memory_of(state), depth, velocity, reach)


@compiled
def leaving_work(flat: Array, state: ContactState, depth: float, offset: float, largest: float) -> tuple[float, float]:
    """`ContactMapModel.leaving_work` of a state of `MEMORY` numbers."""
    return _leaving_work(flat, memory_of(state), depth, offset, largest)
