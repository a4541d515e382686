"""What a renderer asks of a contact map beside its force, compiled: local slopes, and the work of the way out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foretouch.models.contact_map_kernel import force_at, rates, remember
from foretouch.models.contact_map_layout import LARGEST_FEATURES, ORIGIN, TIMES
from foretouch.models.contact_model import SPEED_STEP

__all__ = ["exit_work", "slopes"]

Array = NDArray[np.float64]
_N_TIMES = len(TIMES)


def _slopes(flat: Array, memory: Array, depth: float, velocity: float, reach: float) -> tuple[float, float]:
    """Local stiffness [N/m], the steeper side's size, and damping [N s/m], at a memory that stays as it is."""
    values = np.empty(LARGEST_FEATURES)
    place = depth - flat[ORIGIN]
    here = force_at(flat, memory, place, velocity, values)
    deeper = force_at(flat, memory, place + reach, velocity, values)
    shallower = force_at(flat, memory, place - reach, velocity, values)
    faster = force_at(flat, memory, place, velocity + SPEED_STEP, values)
    slower = force_at(flat, memory, place, velocity - SPEED_STEP, values)
    return max(abs(deeper - here), abs(here - shallower)) / reach, (faster - slower) / (2.0 * SPEED_STEP)


slopes: Callable[[Array, Array, float, float, float], tuple[float, float]] = njit(cache=True)(_slopes)


def _exit_work(
    flat: Array, memory: Array, depth: float, offset: float, largest: float, way_out: Array
) -> tuple[float, float]:
    """Work of the force and a constant beside it, never below zero together, on the way out, without damping.

    Args:
        flat: The model.
        memory: Of now; it is left as it is.
        depth: Of now [m].
        offset: The constant [N].
        largest: The force counts as no more than this [N].
        way_out: Slices to the surface, slices beyond it, length of one of the latter [m], speed [m/s] at which averages
            are left behind.

    Returns:
        The work [J], and the way on which there is any [m].
    """
    values, shares = np.empty(LARGEST_FEATURES), np.empty(_N_TIMES)
    moved = memory.copy()
    place = depth - flat[ORIGIN]
    before = max(min(force_at(flat, moved, place, 0.0, values), largest) + offset, 0.0)
    energy = way = 0.0
    for part in range(2):
        count = int(way_out[part])
        length = way_out[2] if part else max(depth, 0.0) / count
        if not length > 0.0:
            continue
        rates(length / way_out[3], shares)
        for _ in range(count):
            if part and not before > 0.0:
                break
            place -= length
            remember(moved, place, shares)
            after = max(min(force_at(flat, moved, place, 0.0, values), largest) + offset, 0.0)
            energy += 0.5 * (before + after) * length
            way += length
            before = after
    return energy, way


exit_work: Callable[[Array, Array, float, float, float, Array], tuple[float, float]] = njit(cache=True)(_exit_work)
