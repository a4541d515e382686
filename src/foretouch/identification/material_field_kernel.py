"""One step of learning the field of materials, compiled; equations: `foretouch.identification.MaterialFieldLearner`.

Unknowns are forces at the reference depth and speed [N]: a node's three numbers, and their covariance [N^2].
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.core.records import Record

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

UNKNOWNS = 3  # Number of unknowns of a node
OUTLIER = 9.0  # Ratio of a squared innovation to its variance beyond which it weighs less


class Node(Record):
    """What was learnt at a position."""

    theta: Annotated[NDArray[Any], float, UNKNOWNS]  # the unknowns
    covariance: Annotated[NDArray[Any], float, (UNKNOWNS, UNKNOWNS)]  # of the node by itself
    limit: float  # of the trace of the covariance
    code: int  # packed key
    touched: int  # number of the newest sample there


@compiled
def carry_over(nodes: NDArray[np.void], before: Ints, after: Ints, joint: Array) -> Array:
    """Joint covariance of the nodes about a new place: what is known of each, and of two that were together before.

    `joint`, of shape (3 m, 3 m), is of the nodes `before` and becomes one of `after`; below zero there is none.
    """
    count = after.shape[0]
    out = np.zeros((UNKNOWNS * count, UNKNOWNS * count))
    old = np.full(count, -1, np.int64)
    for n in range(count):
        if after[n] < 0:
            continue
        for m in range(before.shape[0]):
            if before[m] == after[n]:
                old[n] = m
        for i in range(UNKNOWNS):
            for j in range(UNKNOWNS):
                out[UNKNOWNS * n + i, UNKNOWNS * n + j] = nodes[after[n]].covariance[i, j]
    for n in range(count):
        for m in range(count):
            if n == m or old[n] < 0 or old[m] < 0:
                continue
            for i in range(UNKNOWNS):
                for j in range(UNKNOWNS):
                    out[UNKNOWNS * n + i, UNKNOWNS * m + j] = joint[UNKNOWNS * old[n] + i, UNKNOWNS * old[m] + j]
    return out


@compiled
def _forget(joint: Array, at: Ints, weights: Array, nodes: NDArray[np.void], share: float) -> None:
    """Enlarge the covariance of each node by a fraction times its weight, as far as its limit allows."""
    for n in range(at.shape[0]):
        k = UNKNOWNS * n
        if at[n] < 0 or joint[k, k] + joint[k + 1, k + 1] + joint[k + 2, k + 2] >= nodes[at[n]].limit:
            continue
        growth = 1.0 + 0.5 * share * weights[n]
        for i in range(k, k + UNKNOWNS):
            for j in range(joint.shape[0]):
                joint[i, j] *= growth
                joint[j, i] *= growth


@compiled
def _update_covariance(joint: Array, h: Array, gain: Array, noise: float) -> None:
    """P <- (I - K h') P (I - K h')' + r K K', in products of a matrix and a vector; kept symmetric."""
    size = h.shape[0]
    ph = np.zeros(size)
    for k in range(size):
        for j in range(size):
            ph[j] += h[k] * joint[k, j]
    for i in range(size):
        along = 0.0
        for j in range(size):
            joint[i, j] -= gain[i] * ph[j]
            along += joint[i, j] * h[j]
        rest = noise * gain[i] - along
        for j in range(size):
            joint[i, j] += rest * gain[j]
    for i in range(size):
        for j in range(i):
            joint[j, i] = joint[i, j]


@compiled
def learn(
    nodes: NDArray[np.void],
    at: Ints,
    weights: Array,
    joint: Array,
    regressor: tuple[float, float, float],
    force: float,
    noise: float,
    forgetting: float,
) -> float:
    """One sample for the nodes about it, which are written.

    They are `at`, below zero none, with `weights`, of shape (m,), and `joint` covariance, of shape (3 m, 3 m); the
    regressor is that of one node of weight 1, and noise the force's variance [N^2].

    Returns:
        The innovation's square over its variance.
    """
    size = joint.shape[0]
    _forget(joint, at, weights, nodes, forgetting)
    h, gain = np.zeros(size), np.zeros(size)
    predicted, expected = 0.0, noise
    for n in range(at.shape[0]):
        if at[n] < 0:
            continue
        for i in range(UNKNOWNS):
            h[UNKNOWNS * n + i] = weights[n] * regressor[i]
            predicted += weights[n] * regressor[i] * nodes[at[n]].theta[i]
    for i in range(size):
        for j in range(size):
            gain[i] += joint[i, j] * h[j]
        expected += h[i] * gain[i]
    error = force - predicted
    ratio = error * error / expected
    if ratio > OUTLIER:
        noise += error * error / OUTLIER - expected
        expected = error * error / OUTLIER
    for i in range(size):
        gain[i] /= expected
    _update_covariance(joint, h, gain, noise)
    for n in range(at.shape[0]):
        if at[n] < 0:
            continue
        node = nodes[at[n]]
        for i in range(UNKNOWNS):
            node.theta[i] += gain[UNKNOWNS * n + i] * error
            for j in range(UNKNOWNS):
                node.covariance[i, j] = joint[UNKNOWNS * n + i, UNKNOWNS * n + j]
    return ratio


@compiled
def laws_of(nodes: NDArray[np.void], at: Ints, scales: Array, depth: float, largest: Array, out: Array) -> None:
    """Laws of nodes in SI units: none negative, each bound met by the rest that fits best with it.

    Rows of `out`, of shape (m, 4): a, b, c, at most `largest`, and the standard deviation of a + 2 b depth.
    """
    law = np.empty(UNKNOWNS)
    for row in range(at.shape[0]):
        node = nodes[at[row]]
        p = node.covariance
        law[:] = node.theta
        for i in (2, 1, 0):
            if law[i] < 0.0 and p[i, i] > 0.0:
                weight = law[i] / p[i, i]
                for j in range(UNKNOWNS):
                    law[j] -= p[j, i] * weight
        for i in range(UNKNOWNS):
            out[row, i] = min(max(law[i] * scales[i], 0.0), largest[i])
        g, h = scales[0], 2.0 * depth * scales[1]
        variance = g * g * p[0, 0] + 2.0 * g * h * p[0, 1] + h * h * p[1, 1]
        out[row, 3] = max(variance, 0.0) ** 0.5
