"""Compiled steps of contact laws; their equations: `foretouch.robot.materials.contacts`, and `spheres` beside it.

Springs and branches of the hysteretic law stand in one table, one row each, which keeps the call short: start a [m],
end b [m], force [N] or stiffness [N/m], and for branches slip force [N] and relaxation time [s].
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

Array = NDArray[np.float64]

BISECTIONS = 10  # the free surface is found to a thousandth of its range in one hysteretic_step


@compiled
def ramp(y: float, start: float, end: float) -> float:
    """R(y; a, b): 0 before the start, 1 after the end, straight between."""
    return min(1.0, max(0.0, (y - start) / (end - start)))


@compiled
def area(y: float, start: float, end: float) -> float:
    """Integral of the ramp from 0 to y [m]."""
    if y <= start:
        return 0.0
    if y >= end:
        return y - 0.5 * (start + end)
    return 0.5 * (y - start) * (y - start) / (end - start)


@compiled
def mean_ramp(before: float, after: float, start: float, end: float) -> float:
    """Mean of the ramp over the way from one deflection to the next."""
    way = after - before
    if abs(way) < 1e-9:
        return ramp(0.5 * (before + after), start, end)
    return (area(after, start, end) - area(before, start, end)) / way


@compiled
def load_branch(load: float, way: float, h: float, stiffness: float, slip: float, relaxation: float) -> float:
    """Load of a branch [N] after its ramp has passed on `way` [m] in h seconds."""
    load = (load + stiffness * way) / (1.0 + h / relaxation)
    return min(slip, max(-slip, load))


@compiled
def total_force(loads: Array, before: float, after: float, h: float, table: Array, springs: int) -> float:
    """Force of the whole material [N] if its surface moves from one deflection to the next."""
    force = 0.0
    for i in range(springs):
        force += table[i, 2] * ramp(after, table[i, 0], table[i, 1])
    for i in range(springs, table.shape[0]):
        lever = mean_ramp(before, after, table[i, 0], table[i, 1])
        way = lever * (after - before)
        force += lever * load_branch(loads[i - springs], way, h, table[i, 2], table[i, 3], table[i, 4])
    return force


@compiled
def press_hysteretic(values: Array, depth: float, h: float, table: Array, springs: int) -> float:
    """Force on the probe [N]; `values`, the deflection and then the branch loads, is written.

    The first `springs` rows of the table are springs, the others branches.
    """
    loads, before = values[1:], values[0]
    known = math.isfinite(depth)
    after = max(depth, 0.0) if known else before
    force = total_force(loads, before, after, h, table, springs)
    if force < 0.0 and after < before:
        low, high = after, before  # the material pulls at low: the surface stays behind the probe
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            if total_force(loads, before, middle, h, table, springs) < 0.0:
                low = middle
            else:
                high = middle
        after = high  # pushing, or not moved at all: either way no energy is made
        force = 0.0
    for i in range(springs, table.shape[0]):
        way = mean_ramp(before, after, table[i, 0], table[i, 1]) * (after - before)
        loads[i - springs] = load_branch(loads[i - springs], way, h, table[i, 2], table[i, 3], table[i, 4])
    values[0] = after
    return max(force, 0.0) if known and depth > 0.0 else 0.0


@compiled(allocates=True)
def hysteretic_step(state: tuple[float, ...], depth: float, h: float, table: Array, springs: int) -> Array:
    """New deflection, branch loads and, last, the force on the probe [N]: see `press_hysteretic`."""
    count = table.shape[0] - springs
    result = np.empty(count + 2)
    for i in range(count + 1):
        result[i] = state[i]
    result[count + 1] = press_hysteretic(result[: count + 1], depth, h, table, springs)
    return result


@compiled(allocates=True)
def branch_response(deflection: Array, h: float, start: float, end: float, slip: float, relaxation: float) -> Array:
    """Force per unit stiffness [m] of one branch along a path of deflections; `slip` is per unit stiffness too."""
    response = np.zeros(deflection.size)
    load = 0.0
    for k in range(1, deflection.size):
        before, after = deflection[k - 1], deflection[k]
        lever = mean_ramp(before, after, start, end)
        load = load_branch(load, lever * (after - before), h, 1.0, slip, relaxation)
        response[k] = lever * load
    return response


State = tuple[float, float, float, float]

TOLERANCE = 1e-7  # last step of Newton's method [N], relative beyond 1 N: it leaves the square of that
LARGEST_COUNT = 60  # of steps; two or three are usual


@compiled
def solve_force(depth: float, force: float, shifts: State, table: Array) -> float:
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


@compiled
def layered_step(state: State, depth: float, h: float, compliance: float, table: Array) -> State:
    """New force [N] and new g o of the three layers [N]; a row of the table is a layer: h, p, g, tau."""
    force = state[0]
    first = state[1] - math.expm1(-h / table[0, 3]) * (table[0, 2] * (force + state[1]) - state[1])
    second = state[2] - math.expm1(-h / table[1, 3]) * (table[1, 2] * (force + state[2]) - state[2])
    third = state[3] - math.expm1(-h / table[2, 3]) * (table[2, 2] * (force + state[3]) - state[3])
    if depth > 0.0:
        shifts = (table[0, 1] + first, table[1, 1] + second, table[2, 1] + third, compliance)
        return solve_force(depth, force, shifts, table), first, second, third
    return 0.0, first, second, third


@compiled(allocates=True)
def viscoelastic_step(values: Array, depth: float, h: float, rings: Array, relaxation: Array) -> float:
    """Force of a viscoelastic half-space on a sphere [N]; `values`, its state, is written.

    A row of `rings` is a ring: its depth [m] and stiffness [N/m]; one of `relaxation` a part: g and tau.
    """
    count, force = rings.shape[0], 0.0
    keep = np.exp(-h / relaxation[:, 1])
    for j in range(count):
        memory = 0.0
        for i in range(relaxation.shape[0]):
            at = (i + 1) * count + j
            values[at] = keep[i] * values[at] + (1.0 - keep[i]) * relaxation[i, 0] * values[j]
            memory += values[at]
        values[j] = max(memory, depth - rings[j, 0]) if depth > 0.0 else memory
        force += rings[j, 1] * (values[j] - memory)
    return force
