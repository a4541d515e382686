"""One step of learning the field of materials, compiled; the equations are in `material_field`.

Unknowns are forces at the reference depth and speed [N]: a node's three numbers, and their covariance [N^2].
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["UNKNOWNS", "laws_of", "learn"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

UNKNOWNS = 3
"""Of a node."""

OUTLIER = 9.0
"""Squared innovations beyond this many variances weigh less."""


def _expected(covariance: Array, h: Array, gain: Array) -> float:
    """P h, written, and h' P h."""
    total = 0.0
    for i in range(UNKNOWNS):
        value = 0.0
        for j in range(UNKNOWNS):
            value += covariance[i, j] * h[j]
        gain[i] = value
        total += h[i] * value
    return total


_spread: Callable[[Array, Array, Array], float] = njit(cache=True)(_expected)


def _joseph(covariance: Array, h: Array, gain: Array, rest: float, limit: float) -> None:
    """P <- (I - K h') P (I - K h')' + r K K', kept symmetric and its trace below a limit."""
    left = np.empty((UNKNOWNS, UNKNOWNS))
    for i in range(UNKNOWNS):
        for j in range(UNKNOWNS):
            left[i, j] = covariance[i, j]
            for k in range(UNKNOWNS):
                left[i, j] -= gain[i] * h[k] * covariance[k, j]
    trace = 0.0
    for i in range(UNKNOWNS):
        for j in range(i + 1):
            value = left[i, j] + rest * gain[i] * gain[j]
            for k in range(UNKNOWNS):
                value -= left[i, k] * h[k] * gain[j]
            covariance[i, j] = covariance[j, i] = value
        trace += covariance[i, i]
    if trace > limit:
        scale = limit / trace
        for i in range(UNKNOWNS):
            for j in range(UNKNOWNS):
                covariance[i, j] *= scale


_update_covariance: Callable[[Array, Array, Array, float, float], None] = njit(cache=True)(_joseph)


def _learn(
    theta: Array,
    covariance: Array,
    limits: Array,
    at: Ints,
    weights: Array,
    regressor: tuple[float, float, float],
    force: float,
    noise: float,
    forgetting: float,
) -> float:
    """One sample for the nodes about it.

    Args:
        theta: Of all nodes, of shape (n, 3); written.
        covariance: Of shape (n, 3, 3); written.
        limits: Of the traces, of shape (n,).
        at: Which nodes are about the sample; below zero none.
        weights: Of these.
        regressor: Of one node of weight 1.
        force: Felt [N].
        noise: Its variance [N^2].
        forgetting: Share of what is known that one sample at a node forgets.

    Returns:
        The innovation's square over its variance.
    """
    count = at.shape[0]
    gains = np.empty((count, UNKNOWNS))
    own = np.empty(count)
    h = np.empty(UNKNOWNS)
    predicted, expected = 0.0, noise
    for n in range(count):
        node = at[n]
        if node < 0:
            continue
        trace = covariance[node, 0, 0] + covariance[node, 1, 1] + covariance[node, 2, 2]
        growth = 1.0 + forgetting * weights[n]
        for i in range(UNKNOWNS):
            h[i] = weights[n] * regressor[i]
            predicted += h[i] * theta[node, i]
            if trace * growth < limits[node]:
                for j in range(UNKNOWNS):
                    covariance[node, i, j] *= growth
        own[n] = _spread(covariance[node], h, gains[n])
        expected += own[n]
    error = force - predicted
    ratio = error * error / expected
    if ratio > OUTLIER:
        expected = error * error / OUTLIER
    for n in range(count):
        node = at[n]
        if node < 0:
            continue
        for i in range(UNKNOWNS):
            h[i] = weights[n] * regressor[i]
            gains[n, i] /= expected
            theta[node, i] += gains[n, i] * error
        _update_covariance(covariance[node], h, gains[n], expected - own[n], limits[node])
    return ratio


learn: Callable[[Array, Array, Array, Ints, Array, tuple[float, float, float], float, float, float], float] = njit(
    cache=True
)(_learn)
"""See `_learn`."""


def _laws_of(
    theta: Array, covariance: Array, at: Ints, scales: Array, depth: float, largest: Array, out: Array
) -> None:
    """Laws of nodes in SI units: none negative, each bound met by the rest that fits best with it.

    Args:
        theta: Of all nodes, of shape (n, 3).
        covariance: Of shape (n, 3, 3).
        at: Which nodes, of shape (m,).
        scales: What turns unknowns into a, b, c, of shape (3,).
        depth: At which local stiffness is meant [m].
        largest: Of a, b, c, of shape (3,).
        out: a, b, c and the standard deviation of a + 2 b depth, of shape (m, 4), written.
    """
    law = np.empty(UNKNOWNS)
    for row in range(at.shape[0]):
        node = at[row]
        p = covariance[node]
        law[:] = theta[node]
        for i in (2, 1, 0):
            if law[i] < 0.0 and p[i, i] > 0.0:
                share = law[i] / p[i, i]
                for j in range(UNKNOWNS):
                    law[j] -= p[j, i] * share
        for i in range(UNKNOWNS):
            out[row, i] = min(max(law[i] * scales[i], 0.0), largest[i])
        g, h = scales[0], 2.0 * depth * scales[1]
        variance = g * g * p[0, 0] + 2.0 * g * h * p[0, 1] + h * h * p[1, 1]
        out[row, 3] = max(variance, 0.0) ** 0.5


laws_of: Callable[[Array, Array, Ints, Array, float, Array, Array], None] = njit(cache=True)(_laws_of)
"""See `_laws_of`."""
