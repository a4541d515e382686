"""One step of learning the scale of a material's force, place by place, compiled: see `ScaleFieldLearner`."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, kernel, scratch, squared
from foretouch.core.records import Record
from foretouch.identification.exact.belief import DRIFT
from foretouch.models.scale_field_kernel import LARGEST_LOG, REACH, SIDE, SPACING, SPREAD, TOUCHED, Scales, locate

Array = NDArray[np.float64]

ABOUT = 4  # Number of nodes along each side of the square about the probe of which the joint covariance is kept
WINDOW = ABOUT * ABOUT

LAW_ERROR = 0.025
"""Standard deviation of a force relative to what the law should be, beside the law's own: it is of the material as a
whole, and each place differs from that by more than a factor."""

FORCE_NOISE = 0.05  # Constant standard deviation of a force [N]

CORRELATION = 0.3
"""Time over which the errors of a law are alike [s]: forces in it count as one."""

LARGEST_ERROR = 3.0  # Largest relative error of a force that counts

FIRST_DEVIATION = 0.03  # Of the scale where it was touched first, which is 1: all others are relative to it


class ScaleState(Record):
    """What a `foretouch.identification.ScaleFieldLearner` remembers."""

    point: Annotated[Array, float, 2] = math.nan  # type: ignore[assignment]  # that is touched, from above [m]
    at: Annotated[NDArray[Any], int, 2] = -1  # type: ignore[assignment]  # first node of the square, -1 before it
    weights: Annotated[Array, float, WINDOW]  # of the square's nodes at the point
    joint: Annotated[Array, float, (WINDOW, WINDOW)]  # and their covariance
    updates: int  # samples learnt from
    scales: Scales
    changed: Annotated[NDArray[Any], int, (SIDE, SIDE)]  # number of the newest sample that changed each node, or 0
    count: int  # nodes that were changed
    nodes: Annotated[NDArray[Any], int, SIDE * SIDE]  # and their places in the lattice, in the order of the first time
    told: int  # how many of them were told in turn


@compiled(error_model="numpy")
def _prior(rows: int, columns: int) -> float:
    """Covariance of two nodes that are so many rows and columns apart, before anything is felt."""
    return SPREAD * SPREAD * math.exp(-math.hypot(rows, columns) * SPACING / REACH)


_ROWS, _COLUMNS = np.divmod(np.arange(WINDOW), ABOUT)
_APART = np.hypot(np.subtract.outer(_ROWS, _ROWS), np.subtract.outer(_COLUMNS, _COLUMNS))  # distances in the square

PRECISION = np.linalg.inv(SPREAD * SPREAD * np.exp(-SPACING / REACH * _APART))
"""Inverse of the prior covariance of a square's nodes."""


@compiled(error_model="numpy")
def _carry(rows: Array, left: Array, down: int, right: int) -> None:
    """Write rows that give the square's nodes from those of the square before, and the covariance of what is left open.

    The square has gone so many nodes down and right. Nodes of both are taken over; others follow from the prior.
    """
    across, new = scratch(np.float64, WINDOW, WINDOW), scratch(np.bool_, WINDOW)
    rows[:], left[:], across[:], new[:] = 0.0, 0.0, 0.0, False
    for n in range(WINDOW):
        i, j = n // ABOUT + down, n % ABOUT + right
        if 0 <= i < ABOUT and 0 <= j < ABOUT:
            rows[n, ABOUT * i + j] = 1.0
            continue
        new[n] = True
        for m in range(WINDOW):
            across[n, m] = _prior(i - m // ABOUT, j - m % ABOUT)
        for m in range(WINDOW):
            for k in range(WINDOW):
                rows[n, m] += across[n, k] * PRECISION[k, m]
    for n in range(WINDOW):
        for m in range(WINDOW):
            if new[n] and new[m]:
                left[n, m] = _prior(n // ABOUT - m // ABOUT, n % ABOUT - m % ABOUT)
                for k in range(WINDOW):
                    left[n, m] -= rows[n, k] * across[m, k]


@compiled(error_model="numpy")
def _go_to(state: ScaleState, i: int, j: int) -> None:
    """Move the square to the one whose first node this is.

    A node that is new in it follows from the others, unless it is known better from before; then what it has in common
    with others is forgotten.
    """
    scales, joint, first = state.scales, state.joint, state.at[0] < 0
    before, rows = scratch(np.float64, WINDOW), scratch(np.float64, WINDOW, WINDOW)
    for n in range(WINDOW):
        before[n] = 0.0 if first else scales.value[state.at[0] + n // ABOUT, state.at[1] + n % ABOUT]
        if first:
            for m in range(WINDOW):
                joint[n, m] = _prior(n // ABOUT - m // ABOUT, n % ABOUT - m % ABOUT)
    if not first:
        left, half = scratch(np.float64, WINDOW, WINDOW), scratch(np.float64, WINDOW, WINDOW)
        _carry(rows, left, i - state.at[0], j - state.at[1])
        half[:] = 0.0
        for n in range(WINDOW):
            for k in range(WINDOW):
                if rows[n, k] != 0.0:
                    for m in range(WINDOW):
                        half[n, m] += rows[n, k] * joint[k, m]
        for n in range(WINDOW):
            for m in range(n + 1):
                for k in range(WINDOW):
                    left[n, m] += half[n, k] * rows[m, k]
                joint[n, m] = joint[m, n] = left[n, m]
    state.at[0], state.at[1] = i, j
    for n in range(WINDOW):
        a, b = i + n // ABOUT, j + n % ABOUT
        if scales.variance[a, b] < joint[n, n]:
            joint[n, :] = 0.0
            joint[:, n] = 0.0
            joint[n, n] = scales.variance[a, b]
            continue
        if not first:
            scales.value[a, b] = 0.0
            for m in range(WINDOW):
                scales.value[a, b] += rows[n, m] * before[m]
        scales.variance[a, b] = joint[n, n]


@compiled(error_model="numpy")
def come(state: ScaleState) -> None:
    """Come to the point, with the square about it and its weights."""
    i, j, u, v = locate(state.point[0], state.point[1])
    if state.at[0] != i - 1 or state.at[1] != j - 1:
        _go_to(state, i - 1, j - 1)
    state.weights[:] = 0.0
    for a in range(2):
        for b in range(2):
            state.weights[ABOUT * (1 + a) + 1 + b] = (u if a else 1.0 - u) * (v if b else 1.0 - v)


@compiled(error_model="numpy")
def here(state: ScaleState) -> tuple[float, float]:
    """The logarithm of the scale at the point, and its variance."""
    value = variance = 0.0
    for n in range(WINDOW):
        if state.weights[n] > 0.0:
            value += state.weights[n] * state.scales.value[state.at[0] + n // ABOUT, state.at[1] + n % ABOUT]
            for m in range(WINDOW):
                variance += state.weights[n] * state.weights[m] * state.joint[n, m]
    return value, variance


@compiled(error_model="numpy")
def learn(state: ScaleState, error: float, noise: float, period: float) -> None:
    """Learn that the logarithm of the scale at the point is larger by an error, which has a variance.

    What is known of the nodes about it drifts, for a time [s].
    """
    joint, scales, along = state.joint, state.scales, scratch(np.float64, WINDOW)
    along[:] = 0.0
    for n in range(WINDOW):
        joint[n, n] = min(joint[n, n] + state.weights[n] * DRIFT * DRIFT * period, max(SPREAD * SPREAD, joint[n, n]))
    total = noise
    for n in range(WINDOW):
        for m in range(WINDOW):
            along[n] += joint[n, m] * state.weights[m]
        total += state.weights[n] * along[n]
    state.updates += 1
    for n in range(WINDOW):
        i, j = state.at[0] + n // ABOUT, state.at[1] + n % ABOUT
        value = scales.value[i, j] + along[n] * error / total
        scales.value[i, j] = min(max(value, -LARGEST_LOG), LARGEST_LOG)
        for m in range(n + 1):
            joint[n, m] -= along[n] * along[m] / total
            joint[m, n] = joint[n, m]
        scales.variance[i, j] = joint[n, n]
        if state.changed[i, j] == 0:
            state.nodes[state.count] = SIDE * i + j
            state.count += 1
        state.changed[i, j] = state.updates


@compiled(error_model="numpy")
def shared(state: ScaleState, felt: float, expected: float, deviation: float, period: float) -> float:
    """Learn from a force at the point; what is left of it for the law of the whole material [N].

    Args:
        state: Written; with a point.
        felt: Force [N].
        expected: That of the law where the scale is 1 [N]; NaN before there is a law.
        deviation: Its standard deviation [N].
        period: Time since the last sample [s].
    """
    first = state.at[0] < 0
    come(state)
    if first:
        learn(state, 0.0, FIRST_DEVIATION * FIRST_DEVIATION, 0.0)
    value, variance = here(state)
    scale = math.exp(value)
    if not (expected * min(scale, 1.0) > FORCE_NOISE and period > 0.0):
        return felt / scale  # where the law has no force, no scale of it can be felt
    law, noise = squared(LAW_ERROR) + squared(deviation / expected), squared(FORCE_NOISE / (scale * expected))
    error = min(max(felt / (scale * expected) - 1.0, -1.0), LARGEST_ERROR)
    learn(state, error, (law + noise) * max(CORRELATION / period, 1.0), period)
    left = felt / math.exp(here(state)[0])
    return expected + law / (law + variance) * (left - expected)


@kernel("(ScaleState[::1], i8, i8, i8[::1])", Scales)
def pick(states: NDArray[np.void], since: int, least: int, picked: NDArray[np.int64]) -> int:
    """Pick touched nodes to be told: those changed after a sample of this number, then others in turn, to so many.

    Returns:
        Number of nodes that were written to `picked`, as `ScaleState.nodes` has them.
    """
    state, found = states[0], 0
    for n in range(state.count - 1, -1, -1):
        i, j = state.nodes[n] // SIDE, state.nodes[n] % SIDE
        if found < picked.size and state.changed[i, j] > since and state.scales.variance[i, j] < TOUCHED:
            picked[found] = state.nodes[n]
            found += 1
    for _ in range(state.count):
        if found >= least:
            break
        state.told = (state.told + 1) % state.count
        i, j = state.nodes[state.told] // SIDE, state.nodes[state.told] % SIDE
        if state.changed[i, j] <= since and state.scales.variance[i, j] < TOUCHED:
            picked[found] = state.nodes[state.told]
            found += 1
    return found


@kernel("(ScaleState[::1], f8, f8, f8, f8)", Scales, error_model="numpy")
def take(states: NDArray[np.void], felt: float, expected: float, deviation: float, period: float) -> float:
    """`shared` with one of an array."""
    return shared(states[0], felt, expected, deviation, period)
