"""One step of learning the field of materials, compiled; equations: `foretouch.identification.MaterialFieldLearner`.

Unknowns are forces at the reference depth and speed [N]: a node's three numbers, and their covariance [N^2].
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import Kernel, compiled, kernel
from foretouch.core.records import Record
from foretouch.identification.conditioning.conditioner import clear, take_lagged
from foretouch.identification.conditioning.kernel import Memory, condition, is_full
from foretouch.models.material_field import FIELD_DEPTH, LARGEST_LAW, MOST_NODES
from foretouch.models.material_field_kernel import CORNERS, NUMBERS, cell_of
from foretouch.quantities.pose import Vector

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Nodes = NDArray[np.void]

UNKNOWNS = 3  # Number of unknowns of a node
MEAN = MOST_NODES  # Row of the mean law
OUTLIER = 9.0  # Ratio of a squared innovation to its variance beyond which it weighs less

REFERENCE_DEPTH, REFERENCE_SPEED = 5e-3, 0.05
"""Depth [m] and speed [m/s] at which the unknowns are forces [N], so that all are of one magnitude."""

SCALES = np.array([1.0 / REFERENCE_DEPTH, 1.0 / REFERENCE_DEPTH**2, 1.0 / (REFERENCE_DEPTH * REFERENCE_SPEED)])
"""Factors that convert the unknowns to a, b and c."""

FORCE_NOISE, SHARE_NOISE = 0.05, 0.15
"""Standard deviation of a force: constant [N], and the fraction of it that the law misses. Errors of successive samples
are correlated, at edges that the lattice cannot follow above all, so both are larger than a sensor's noise."""

FORGETTING, MEAN_FORGETTING = 2e-3, 5e-5
"""Fraction of the information on a node, and on the mean law, that one more sample there forgets."""

SPREAD, FREEDOM = 1.0, 0.2
"""Standard deviation of a node from the mean law, relative to its force: common to its unknowns, and of each alone."""

TOGETHER = 0.9  # Correlation of the common deviation of nodes that begin together
LEAST_WEIGHT = 1e-3  # Least weight for which a node is made
LARGEST_UNKNOWN = 1e7  # Largest valid estimate of an unknown [N]
FEWEST_UPDATES = 20  # Fewest samples from which a force is rendered
CHANGED_SPREAD = 4.0  # Factor on the standard deviation of a node whose material has changed, relative to a new one

DEPTH_STEP, WAY_STEP = 2e-5, 1e-4
"""Least change of depth [m] or of position [m] from the last sample for a sample to carry new information."""

MEAN_UPDATES = 300
"""Number of samples after which nodes are made, unless the mean law is more certain than they will be before: its own
uncertainty would otherwise be taken for differences between positions."""

LARGEST_DEPTH, LARGEST_SPEED, LARGEST_FORCE = 0.1, 5.0, 1e4
"""Largest depth [m], speed [m/s] and force [N] of a sample; others are left out."""

MISFIT_RATE, LARGEST_RATIO = 0.02, 9.0
"""Rate and largest value of the running mean of squared innovations over their expectation, which scales the noise."""

SURPRISING, SURPRISE_RATE, SURPRISE_LIMIT = 16.0, 0.05, 0.8
"""Squared innovation over its variance that is an outlier, rate of their running mean, and the mean of a change."""

FREE_AIR, UNUSABLE, HELD, LEARNT, CHANGED, RESTART = range(6)
"""Result of a sample: all from LEARNT on have changed the model. After RESTART all is to be forgotten."""


class Node(Record):
    """What was learnt at a position."""

    theta: Annotated[NDArray[Any], float, UNKNOWNS]  # the unknowns
    covariance: Annotated[NDArray[Any], float, (UNKNOWNS, UNKNOWNS)]  # of the node by itself
    limit: float  # of the trace of the covariance


class FieldState(Record):
    """What a `foretouch.identification.MaterialFieldLearner` remembers.

    The mean law is the last of the nodes, so that the row of an unknown node, -1, is its own.
    """

    spacing: float  # h [m]
    point: Annotated[Array, float, 3]  # that is touched [m]
    updates: int  # samples learnt from
    count: int  # of nodes
    nodes: Annotated[NDArray[Any], Node, MOST_NODES + 1]
    codes: Annotated[NDArray[Any], int, MOST_NODES]  # their packed keys, together for the search
    touched: Annotated[NDArray[Any], int, MOST_NODES]  # number of the newest sample at each
    cell: int = -1  # packed key of the first node about the newest sample
    at: Annotated[NDArray[Any], int, CORNERS]  # rows of the nodes about it, below zero none
    weights: Annotated[NDArray[Any], float, CORNERS]  # and their weights
    joint: Annotated[NDArray[Any], float, (CORNERS * UNKNOWNS, CORNERS * UNKNOWNS)]  # and their covariance
    last: Annotated[NDArray[Any], float, 4]  # depth and point of the newest sample learnt [m]
    misfit: float = 1.0  # running mean of squared innovations over their expectation
    surprise: float  # running fraction of outliers


@compiled
def carry_over(nodes: Nodes, before: Ints, after: Ints, joint: Array) -> Array:
    """Joint covariance of the nodes about a new place: what is known of each, and of two that were together before.

    `joint`, of shape (3 m, 3 m), is of the nodes `before` and becomes one of `after`; below zero there is none.
    """
    count = after.shape[0]
    out, old = np.zeros((UNKNOWNS * count, UNKNOWNS * count)), np.full(count, -1, np.int64)
    for n in range(count):
        for m in range(before.shape[0]):
            if before[m] == after[n] >= 0:
                old[n] = m
    for k in range(out.shape[0]):
        n, i = k // UNKNOWNS, k % UNKNOWNS
        for other in range(out.shape[0]):
            m, j = other // UNKNOWNS, other % UNKNOWNS
            if n == m and after[n] >= 0:
                out[k, other] = nodes[after[n]].covariance[i, j]
            elif n != m and old[n] >= 0 and old[m] >= 0:
                out[k, other] = joint[UNKNOWNS * old[n] + i, UNKNOWNS * old[m] + j]
    return out


@compiled
def _forget(joint: Array, at: Ints, weights: Array, nodes: Nodes, share: float) -> None:
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
def _update_covariance(joint: Array, h: Array, ph: Array, gain: Array, noise: float) -> None:
    """P <- (I - K h') P (I - K h')' + r K K', in products of a matrix and a vector; kept symmetric."""
    size = h.shape[0]
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
    nodes: Nodes, at: Ints, weights: Array, joint: Array, regressor: Vector, force: float, noise: float, share: float
) -> float:
    """One sample for the nodes about it, which are written, and its innovation's square over its variance.

    They are `at`, below zero none, with `weights`, of shape (m,), and `joint` covariance, symmetric, of shape
    (3 m, 3 m); the regressor is that of one node of weight 1, noise the force's variance [N^2], and the share that of
    the information on a node of weight 1 which is forgotten.
    """
    size = joint.shape[0]
    _forget(joint, at, weights, nodes, share)
    h, ph, predicted, expected = np.zeros(size), np.zeros(size), 0.0, noise
    for n in range(at.shape[0]):
        if at[n] >= 0:
            for i in range(UNKNOWNS):
                h[UNKNOWNS * n + i] = weights[n] * regressor[i]
                predicted += weights[n] * regressor[i] * nodes[at[n]].theta[i]
    for i in range(size):
        for j in range(size):
            ph[i] += joint[i, j] * h[j]
        expected += h[i] * ph[i]
    error = force - predicted
    ratio = error * error / expected
    if ratio > OUTLIER:
        noise += error * error / OUTLIER - expected
        expected = error * error / OUTLIER
    gain = ph / expected
    _update_covariance(joint, h, ph, gain, noise)
    for k in range(size):
        n, i = k // UNKNOWNS, k % UNKNOWNS
        if at[n] >= 0:
            node = nodes[at[n]]
            node.theta[i] += gain[k] * error
            for j in range(UNKNOWNS):
                node.covariance[i, j] = joint[k, UNKNOWNS * n + j]
    return float(ratio)


@compiled
def laws_of(nodes: Nodes, at: Ints, out: Array) -> None:
    """Laws of nodes in SI units: none negative, each bound met by the rest that fits best with it.

    Rows of `out`, of shape (m, 4): a, b, c, bounded as those of a field, and the standard deviation of a + 2 b x at
    the depth x of a field's uncertainty.
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
            out[row, i] = min(max(law[i] * SCALES[i], 0.0), LARGEST_LAW[i])
        g, h = SCALES[0], 2.0 * FIELD_DEPTH * SCALES[1]
        variance = g * g * p[0, 0] + 2.0 * g * h * p[0, 1] + h * h * p[1, 1]
        out[row, 3] = max(variance, 0.0) ** 0.5


@compiled
def prior_of(state: FieldState) -> tuple[Array, Array]:
    """Mean m of the unknowns of a node that has not been touched, and its covariance.

    That is s^2 m m' + (f F)^2 diag(1, 1, f^2), with the common spread s and the freedom f of each, relative to the
    force F = m_1 + m_2, which is the noise at least.
    """
    mean = np.maximum(state.nodes[MEAN].theta[:], 0.0)
    own, spread = FREEDOM * max(mean[0] + mean[1], FORCE_NOISE), SPREAD * SPREAD * np.outer(mean, mean)
    for i, alone in enumerate((own, own, own * FREEDOM)):
        spread[i, i] += alone * alone
    return mean, spread


@compiled
def find(state: FieldState, point: Vector, about: Ints, at: Ints, weights: Array) -> None:
    """Find the packed keys of the nodes about a point [m], their rows, -1 where there is none, and their weights."""
    cell_of(point[0], point[1], point[2], state.spacing, about, weights)
    at[:] = -1
    for row in range(state.count):
        if about[0] <= state.codes[row] <= about[CORNERS - 1]:  # they ascend
            for corner in range(CORNERS):
                if state.codes[row] == about[corner]:
                    at[corner] = row


@compiled
def _begin(state: FieldState, begun: NDArray[np.bool_], before: Ints, factor: float) -> None:
    """Begin nodes from the mean law, with a factor on their deviation, where there were others `before`.

    Those that begin together are correlated: they are likely to be all stiffer than the mean, or all softer.
    """
    mean, spread = prior_of(state)
    spread *= factor * factor
    for corner in range(CORNERS):
        if begun[corner]:
            node = state.nodes[state.at[corner]]
            node.limit = np.trace(spread)
            node.theta[:], node.covariance[:, :] = mean, spread
    joint = carry_over(state.nodes[:], before, state.at[:], state.joint[:])
    common = TOGETHER * (factor * SPREAD * (factor * SPREAD))
    for k in range(joint.shape[0]):
        for m in range(joint.shape[0]):
            one, other = k // UNKNOWNS, m // UNKNOWNS
            tied = one != other and begun[one] and begun[other]
            state.joint[k, m] = common * (mean[k % UNKNOWNS] * mean[m % UNKNOWNS]) if tied else joint[k, m]


@compiled
def _come_to(state: FieldState, point: Vector) -> None:
    """Find the nodes about a point; missing ones are made, and those that were hardly touched begin again.

    The first are made when the mean law is certain enough. A new one takes the room of that touched longest ago where
    there is no other.
    """
    mean, limit, updates = state.nodes[MEAN], np.trace(prior_of(state)[1]), state.updates
    known = updates >= FEWEST_UPDATES and np.trace(mean.covariance) < FREEDOM * FREEDOM * limit
    if state.count == 0 and not (known or updates >= MEAN_UPDATES):
        return
    about, before, begun = np.empty(CORNERS, np.int64), state.at[:].copy(), np.zeros(CORNERS, np.bool_)
    at, weights = state.at[:], state.weights[:]
    find(state, point, about, at, weights)
    changed, state.cell = about[0] != state.cell, about[0]
    for corner in range(CORNERS):
        if at[corner] >= 0:
            state.touched[at[corner]] = updates  # at once, so that none of them makes room
    for corner in range(CORNERS):
        node = at[corner]
        if node < 0 and weights[corner] > LEAST_WEIGHT:
            node = at[corner] = state.count if state.count < MOST_NODES else int(np.argmin(state.touched[:]))
            state.codes[node], state.touched[node], begun[corner] = about[corner], updates, True
            state.count = max(state.count, node + 1)
        elif node >= 0 and np.trace(state.nodes[node].covariance) > limit:
            begun[corner] = not (before == node).any()
        changed = changed or begun[corner]
    if changed:
        _begin(state, begun, before, 1.0)


@compiled
def _judge(state: FieldState, ratio: float) -> int:
    """Whether the material at the point is unchanged, by a squared innovation over its variance."""
    before, raised = state.misfit, max(state.misfit, 1.0)
    state.misfit += MISFIT_RATE * ((LARGEST_RATIO if ratio > LARGEST_RATIO else ratio) * raised - before)
    state.surprise += SURPRISE_RATE * ((1.0 if ratio * raised > SURPRISING else 0.0) - state.surprise)
    if state.surprise < SURPRISE_LIMIT:
        return LEARNT
    state.surprise, state.misfit = 0.0, 1.0
    _begin(state, state.at[:] >= 0, np.full(CORNERS, -1, np.int64), CHANGED_SPREAD)
    return CHANGED


@kernel("(FieldState[::1], f8, f8, f8, b1)")
def take(states: NDArray[np.void], depth: float, velocity: float, force: float, in_contact: bool) -> int:
    """One sample at the touched point; what was done."""
    state, missed = states[0], SHARE_NOISE * min(abs(force), LARGEST_FORCE)
    if not in_contact:
        return FREE_AIR
    if not (0.0 < depth <= LARGEST_DEPTH and abs(velocity) <= LARGEST_SPEED and abs(force) <= LARGEST_FORCE):
        return UNUSABLE
    last, nodes, point = state.last, state.nodes[:], (state.point[0], state.point[1], state.point[2])
    x, y, z = point[0] - last[1], point[1] - last[2], point[2] - last[3]
    if abs(depth - last[0]) < DEPTH_STEP and x * x + y * y + z * z < WAY_STEP * WAY_STEP:
        return HELD
    last[0], last[1], last[2], last[3] = depth, point[0], point[1], point[2]
    weight, mean, noise = depth / REFERENCE_DEPTH, nodes[MEAN], FORCE_NOISE * FORCE_NOISE + missed * missed
    regressor = (weight, weight * weight, weight * velocity / REFERENCE_SPEED)
    learn(nodes, np.full(1, MEAN), np.ones(1), mean.covariance, regressor, force, noise, MEAN_FORGETTING)
    state.updates += 1
    if not abs(mean.theta[0]) + abs(mean.theta[1]) < LARGEST_UNKNOWN:
        return RESTART
    _come_to(state, point)
    if state.count == 0:
        return LEARNT
    noise *= max(state.misfit, 1.0)
    ratio = learn(nodes, state.at[:], state.weights[:], state.joint[:], regressor, force, noise, FORGETTING)
    return _judge(state, ratio)


_take = take.function


@compiled(error_model="numpy")
def learn_raw(
    fields: NDArray[np.void], conditioner: Memory, learnings: NDArray[np.void], raw: Vector
) -> tuple[int, bool]:
    """`foretouch.identification.contact_map.kernel.learn_raw` for a field's state."""
    newest, lag, state, time = learnings[0].newest[0], learnings[0].lag, conditioner[0][0], raw[0]
    surface, offset, touched, before = state.surface, state.offset, state.in_contact, newest.time
    depth, velocity, force, touching = condition(conditioner, time, raw[1], raw[2], 0.0, False)
    newest.time, newest.depth, newest.velocity, newest.force, newest.in_contact = time, depth, velocity, force, touching
    code = _take(fields, depth, velocity, force, touching)
    if code == CHANGED:
        clear(lag)
    if touching:
        take_lagged(lag, depth + state.surface, velocity, raw[2], time - before)
    told = abs(state.surface - surface) > 0.0 or state.offset != offset or state.in_contact != touched
    return code, bool(told or is_full(conditioner))


@kernel("(FieldState[::1],)")
def has_law(states: NDArray[np.void]) -> bool:
    """Whether there are samples enough, and a force follows from the law of some node about the point."""
    about, at, weights = np.empty(CORNERS, np.int64), np.empty(CORNERS, np.int64), np.empty(CORNERS)
    point = states[0].point
    find(states[0], (point[0], point[1], point[2]), about, at, weights)
    laws = np.empty((CORNERS, NUMBERS))
    laws_of(states[0].nodes[:], at, laws)
    return bool(states[0].updates >= FEWEST_UPDATES and (weights * (laws[:, 0] + laws[:, 1]) > 0.0).any())


FIND = Kernel(find, "(FieldState, UniTuple(f8, 3), i8[::1], i8[::1], f8[::1])")
LAWS_OF = Kernel(laws_of, "(Node[::1], i8[::1], f8[:, ::1])")
PRIOR_OF = Kernel(prior_of, "(FieldState,)")
"""What is asked for where the law, its errors or the field are."""
