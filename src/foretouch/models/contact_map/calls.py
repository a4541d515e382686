"""The contact map for a loop: its step, its slopes and the work of the way out, each one compiled call.

What the material remembers goes in as plain numbers: a call into compiled code takes 0.3 us whatever it does, and each
array that is made of a tuple for it as much again.
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


def _slopes_of(flat: Array, memory: Memory, depth: float, velocity: float, reach: float) -> tuple[float, float]:
    """Local stiffness [N/m], the steeper side's size, and damping [N s/m]."""
    place = depth - flat[ORIGIN]
    here = force_at(flat, memory, place, velocity)
    deeper = force_at(flat, memory, place + reach, velocity)
    shallower = force_at(flat, memory, place - reach, velocity)
    faster = force_at(flat, memory, place, velocity + SPEED_STEP)
    slower = force_at(flat, memory, place, velocity - SPEED_STEP)
    return max(abs(deeper - here), abs(here - shallower)) / reach, (faster - slower) / (2.0 * SPEED_STEP)


slopes_of = compiled(_slopes_of)


def _work_of(flat: Array, memory: Memory, depth: float, offset: float, largest: float) -> tuple[float, float]:
    """Work of the force and a constant beside it, never below zero together, on the way out, without damping.

    Args:
        flat: The model.
        memory: Of now.
        depth: Of now [m].
        offset: The constant [N].
        largest: The force counts as no more than this [N].

    Returns:
        The work [J], and the way on which there is any [m].
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


work_of = compiled(_work_of)


UNTOUCHED: ContactState = (math.nan,) * MEMORY
"""What a material remembers before the first sample."""

_slopes, _exit_work = slopes_of, work_of


def _memory_of(state: ContactState) -> Memory:
    """A state of `MEMORY` numbers; one with a number that is not finite counts as untouched."""
    for number in state:
        if not math.isfinite(number):
            return math.nan, math.nan, math.nan, math.nan, math.nan
    return state[0], state[1], state[2], state[3], state[4]


memory_of = compiled(_memory_of)


def _advance(
    flat: Array, state: ContactState, depth: float, velocity: float, period: float
) -> tuple[ContactState, float, float]:
    """`ContactMap.advance` of a state of `MEMORY` numbers."""
    return advanced(flat, memory_of(state), depth, velocity, period)


advance = compiled(_advance)


def _local_slopes(flat: Array, state: ContactState, depth: float, velocity: float, reach: float) -> tuple[float, float]:
    """`ContactMap.local_slopes` of a state of `MEMORY` numbers."""
    return _slopes(flat, memory_of(state), depth, velocity, reach)


local_slopes = compiled(_local_slopes)


def _exit_work_of(flat: Array, state: ContactState, depth: float, offset: float, largest: float) -> tuple[float, float]:
    """`ContactMap.exit_work` of a state of `MEMORY` numbers."""
    return _exit_work(flat, memory_of(state), depth, offset, largest)


exit_work = compiled(_exit_work_of)
