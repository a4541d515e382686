"""The contact map for a loop: one compiled call each, with what the material remembers as plain numbers.

A call into compiled code takes 0.3 us whatever it does, and each array that is made of a tuple for it as much again.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.models import contact_map_work as work
from foretouch.models.contact_map_kernel import Memory, advanced
from foretouch.models.contact_map_layout import MEMORY
from foretouch.models.contact_model import ContactState

__all__ = ["UNTOUCHED", "advance", "exit_work", "local_slopes", "memory_of"]

Array = NDArray[np.float64]

UNTOUCHED: ContactState = (math.nan,) * MEMORY
"""What a material remembers before the first sample."""

_slopes, _exit_work = work.slopes_of, work.work_of


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
