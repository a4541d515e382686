"""Compiled step of the layered contact law; the equations are in `layered_contact`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

__all__ = ["layered_step"]

Array = NDArray[np.float64]
State = tuple[float, float, float, float]

TOLERANCE = 1e-7  # last step of Newton's method [N], relative beyond 1 N: it leaves the square of that
LARGEST_COUNT = 60  # of steps; two or three are usual


def _solve_force(depth: float, force: float, shifts: State, table: Array) -> float:
    """F [N] at which all is pressed in by `depth`, 0 where it lies deeper by itself; begins at a force before.

    `shifts` are p + g o of the layers, then the compliance of the base.
    """
    base = shifts[3]
    for _ in range(LARGEST_COUNT):
        missing, slope = depth - base * force, base
        for i in range(3):
            stress = force + shifts[i]
            thickness, halving = table[i, 0], table[i, 1]
            missing -= thickness * (1.0 - halving / stress)
            slope += thickness * halving / (stress * stress)
        change = missing / slope
        if force + change <= 0.0:  # from far beyond, or free; from 0 on the way is monotonic
            if force == 0.0:
                return 0.0
            force = 0.0
        else:
            force += change
            if abs(change) <= TOLERANCE * (1.0 + force):
                break
    return force


solve_force = compiled(_solve_force)


def _layered_step(state: State, depth: float, h: float, compliance: float, table: Array) -> State:
    """New force [N] and new g o of the three layers [N]; a row of the table is a layer: h, p, g, tau."""
    force = state[0]
    first = state[1] - math.expm1(-h / table[0, 3]) * (table[0, 2] * (force + state[1]) - state[1])
    second = state[2] - math.expm1(-h / table[1, 3]) * (table[1, 2] * (force + state[2]) - state[2])
    third = state[3] - math.expm1(-h / table[2, 3]) * (table[2, 2] * (force + state[3]) - state[3])
    if depth > 0.0:
        shifts = (table[0, 1] + first, table[1, 1] + second, table[2, 1] + third, compliance)
        return solve_force(depth, force, shifts, table), first, second, third
    return 0.0, first, second, third


layered_step = compiled(_layered_step)
