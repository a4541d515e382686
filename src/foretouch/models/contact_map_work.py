"""What a renderer asks of a contact map beside its force, compiled: local slopes, and the work of the way out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.models.contact_map_kernel import Memory, force_at, moved, rate_of
from foretouch.models.contact_map_layout import ORIGIN
from foretouch.models.contact_model import EXIT_SPEED, SLICE_BEYOND, SLICES, SLICES_BEYOND, SPEED_STEP

__all__ = ["slopes_of", "work_of"]

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
