r"""Recursive least squares of one map, compiled, in the weights that were reached.

A weight is reached when a sample's splines are not zero there. For a weight n that was not reached, the samples carry
no information except through the reached weights v of the same part (the elastic part, or one feature: parts are
independent before the first sample), so

.. math::
    w_n = c^T w_v, \quad P_{nj} = c^T P_{vj}, \quad P_{nn} = d + c^T P_{vv} c, \quad
        c = Q_{vv}^{-1} Q_{vn}, \quad d = Q_{nn} - Q_{nv} c

with Q the prior. That holds at any time and under any history, so the covariance is kept for reached weights alone, and
grows by a row where one more is reached: the cost of a sample goes with the square of the visited depth and not with
the number of knots. The Cholesky factor of Q among the reached grows with it, so c costs two triangular solutions.

All of that is for the coarse map. One step of the hand may span many knots of the fine map: it is reached in full at
once, and its rows are its weights.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined
from foretouch.core.records import Record
from foretouch.identification.contact_map.prior import elastic_prior, feature_prior
from foretouch.models.contact_map.kernel import cubic
from foretouch.models.contact_map.layout import FINE_FROM, FINE_TO, GRIDS, LARGEST_FEATURES, Grid

Array = NDArray[np.float64]
Field = NDArray[Any]

ACTIVE = 4 * (1 + LARGEST_FEATURES)  # Largest number of weights whose splines are not zero at a sample


SIZE = max(grid.size for grid in GRIDS)
KNOTS = max(grid.knots for grid in GRIDS)
"""Room for the weights of a map, and for those of one of its parts."""


class Part(Record):
    """The elastic part of a map, or its features, all of which have the same prior and reach the same knots."""

    begin: int  # first weight
    copies: int  # 1, or number of features
    knots: int  # number of weights of each
    prior: Annotated[Field, float, (KNOTS, KNOTS)]  # covariance of these
    factor: Annotated[Field, float, (KNOTS, KNOTS)]  # Cholesky factor of the prior among the knots that were reached
    order: Annotated[Field, int, KNOTS]  # the knots, in the order of reaching
    count: int  # of them
    first: int  # all knots from this
    end: int  # to this are reached


class Regression(Record):
    """State of the regression of a map besides the weights themselves; its arrays have room for the larger map."""

    whole: int  # 1 where all weights are reached from the beginning
    covariance: Annotated[Field, float, (SIZE, SIZE)]  # P of the reached weights, in the first rows
    rows: int  # number of reached weights
    weight_at: Annotated[Field, int, SIZE]  # weight of each row
    row_of: Annotated[Field, int, SIZE]  # row of each weight, -1 for one not reached
    parts: Annotated[Field, Part, 2]
    gain: Annotated[Field, float, SIZE]  # scratch
    share: Annotated[Field, float, SIZE]  # scratch: c of a new knot, or a row of the prior
    regressor: Annotated[Field, float, ACTIVE]  # splines of the newest sample
    active: Annotated[Field, int, ACTIVE]  # and their rows
    traced: int  # 1 where a mean was given before the first sample
    trace: Annotated[Field, float, SIZE]  # what is left of it in each weight


def begin_regression(regression: Regression, kind: int) -> None:
    """Set the priors of a new regression of the coarse (0) or the fine map (1), and forget."""
    grid, (elastic, feature) = GRIDS[kind], regression.parts
    regression.whole = kind
    elastic.copies, elastic.knots = 1, grid.knots
    elastic.prior[: grid.knots, : grid.knots] = elastic_prior(kind)
    feature.begin, feature.copies, feature.knots = grid.knots, grid.features, grid.feature_knots
    feature.prior[: grid.feature_knots, : grid.feature_knots] = feature_prior(kind)
    if kind == 1:
        regression.rows = grid.size
        regression.weight_at[: grid.size] = regression.row_of[: grid.size] = np.arange(grid.size)
    forget(regression)


@compiled(error_model="numpy")
def forget(regression: Regression) -> None:
    """Begin again without samples."""
    regression.traced = 0
    if regression.whole == 0:
        regression.rows = regression.parts[0].count = regression.parts[1].count = 0
        regression.row_of[:] = -1
        regression.trace[:] = 0.0
        return
    covariance = regression.covariance
    for i in range(regression.rows):
        for k in range(regression.rows):
            covariance[i, k] = 0.0
    for p in range(2):
        part = regression.parts[p]
        for copy in range(part.copies):
            begin = part.begin + copy * part.knots
            for i in range(part.knots):  # a slice of an array into another takes seconds to compile
                for k in range(part.knots):
                    covariance[begin + i, begin + k] = part.prior[i, k]


@compiled(error_model="numpy")
def conditional(part: Part, share: Array, knot: int) -> float:
    """Write c of a knot and return d; the factor and the order grow by this knot."""
    prior, factor, order, count = part.prior, part.factor, part.order, part.count
    rest = prior[knot, knot]
    for i in range(count):
        value = prior[knot, order[i]]
        for k in range(i):
            value -= factor[i, k] * factor[count, k]
        value /= factor[i, i]
        factor[count, i] = value
        rest -= value * value
    rest = max(rest, 0.0)
    order[count] = knot
    factor[count, count] = math.sqrt(rest)
    for i in range(count):
        share[i] = factor[count, i]
    for i in range(count - 1, -1, -1):
        share[i] /= factor[i, i]
        for k in range(i):
            share[k] -= factor[i, k] * share[i]
    return float(rest)


@compiled(error_model="numpy")
def append(weights: Array, regression: Regression, begin: int, part: Part, rest: float) -> None:
    """Add the row of a part's newest knot; the part's weights begin at an index."""
    covariance, new, fraction, row_of = regression.covariance, regression.gain, regression.share, regression.row_of
    order, count, rows = part.order, part.count, regression.rows
    new[:rows] = 0.0
    value = trace = 0.0
    for i in range(count):
        c, known = fraction[i], begin + order[i]
        row = row_of[known]
        value += c * weights[known]
        trace += c * regression.trace[known]
        for k in range(rows):
            new[k] += c * covariance[row, k]
    for i in range(count):
        rest += fraction[i] * new[row_of[begin + order[i]]]
    for k in range(rows):
        covariance[rows, k] = new[k]
        covariance[k, rows] = new[k]
    weight = begin + order[count]
    covariance[rows, rows] = rest
    weights[weight] = value
    regression.trace[weight] = trace
    regression.weight_at[rows] = weight
    row_of[weight] = rows
    regression.rows = rows + 1


@compiled(error_model="numpy")
def reach_knot(weights: Array, regression: Regression, part: Part, knot: int) -> None:
    """Reach one more knot of a part."""
    rest = conditional(part, regression.share[:], knot)
    for copy in range(part.copies):
        append(weights, regression, part.begin + copy * part.knots, part, rest)
    part.count += 1


@compiled(error_model="numpy")
def reach(weights: Array, regression: Regression, knot: int, feature_knot: int) -> None:
    """Reach four knots from each of these on, of the elastic part and the features, and all between them and others."""
    for p in range(2):
        part, first = regression.parts[p], knot if p == 0 else feature_knot
        if part.count == 0:
            part.first = part.end = first
        while part.end < first + 4:
            reach_knot(weights, regression, part, part.end)
            part.end += 1
        while part.first > first:
            part.first -= 1
            reach_knot(weights, regression, part, part.first)


@inlined
def look(regression: Regression, grid: Grid, position: float, values: Array) -> int:
    """Write splines and rows of a sample, which are reached, and return their number."""
    regressor, active, row_of = regression.regressor, regression.active, regression.row_of
    knot, a, b, c, d = cubic(position, grid.spacing, grid.below, grid.knots)
    first, p, q, r, s = cubic(position, grid.feature_spacing, grid.feature_below, grid.feature_knots)
    regressor[0], regressor[1], regressor[2], regressor[3] = a, b, c, d
    for j in range(4):
        active[j] = row_of[knot + j]
    at = 4
    first += grid.knots
    for f in range(grid.features):
        value = values[f]
        regressor[at], regressor[at + 1] = p * value, q * value
        regressor[at + 2], regressor[at + 3] = r * value, s * value
        for j in range(4):
            active[at + j] = row_of[first + j]
        at += 4
        first += grid.feature_knots
    return at


@inlined
def in_fine_reach(position: float) -> bool:
    """Whether the fine map has knots at a position [m from its place]."""
    return FINE_FROM <= position <= FINE_TO


@inlined
def learn_rows(weights: Array, regression: Regression, count: int, force: float) -> float:
    """Learn one sample of which `look` was called by recursive least squares; returns the error before [N].

    The new covariance P - P h h' P / (h' P h + r) is symmetric to rounding as it is computed; the error is NaN where
    the old one was not a covariance.
    """
    covariance, rows, weight_at = regression.covariance, regression.rows, regression.weight_at
    gain, regressor, active = regression.gain, regression.regressor, regression.active
    error, variance = force, 1.0
    for k in range(rows):
        gain[k] = 0.0
    for a in range(0, count, 4):
        one, two, three, four = active[a], active[a + 1], active[a + 2], active[a + 3]
        g, h, i, j = regressor[a], regressor[a + 1], regressor[a + 2], regressor[a + 3]
        error = error - g * weights[weight_at[one]] - h * weights[weight_at[two]]
        error = error - i * weights[weight_at[three]] - j * weights[weight_at[four]]
        for k in range(rows):
            value = gain[k] + g * covariance[one, k] + h * covariance[two, k]
            gain[k] = value + i * covariance[three, k] + j * covariance[four, k]
    for a in range(count):
        variance += regressor[a] * gain[active[a]]
    if not variance >= 1.0:  # the covariance is lost to rounding
        return math.nan
    for i in range(rows):
        weight = gain[i] / variance
        weights[weight_at[i]] += weight * error
        for k in range(rows):
            covariance[i, k] -= weight * gain[k]
    return error


@compiled(error_model="numpy")
def weigh(regression: Regression, part: Part, begin: int, mean: Array) -> None:
    """Write the inverse of the prior times a mean, for one part, in the order of its rows, into `gain`."""
    factor, order, count, row_of = part.factor, part.order, part.count, regression.row_of
    share, weighed = regression.share, regression.gain
    for i in range(count):
        value = mean[begin + order[i]]
        for k in range(i):
            value -= factor[i, k] * share[k]
        share[i] = value / factor[i, i]
    for i in range(count - 1, -1, -1):
        value = share[i]
        for k in range(i + 1, count):
            value -= factor[k, i] * share[k]
        share[i] = value / factor[i, i]
        weighed[row_of[begin + order[i]]] = share[i]


@compiled(error_model="numpy")
def expect_mean(regression: Regression, mean: Array) -> None:
    r"""Write what is left of a prior mean m in the weights after the samples so far, :math:`t = P Q^{-1} m`."""
    trace, covariance, weighed = regression.trace, regression.covariance, regression.gain
    for p in range(2):
        part = regression.parts[p]
        for copy in range(part.copies):
            weigh(regression, part, part.begin + copy * part.knots, mean)
    for i in range(regression.rows):
        value = 0.0
        for k in range(regression.rows):
            value += covariance[i, k] * weighed[k]
        trace[regression.weight_at[i]] = value
    regression.traced = 1


@compiled(error_model="numpy")
def overwrite_mean(regression: Regression, count: int) -> None:
    """Take from what is left of a prior mean what the sample that `learn_rows` has just learnt says: t - K h' t."""
    trace, gain, regressor, active = regression.trace, regression.gain, regression.regressor, regression.active
    weight_at, left, variance = regression.weight_at, 0.0, 1.0
    for a in range(count):
        left += regressor[a] * trace[weight_at[active[a]]]
        variance += regressor[a] * gain[active[a]]
    for i in range(regression.rows):
        trace[weight_at[i]] -= gain[i] / variance * left


@compiled(error_model="numpy")
def fit(weights: Array, regression: Regression, grid: Grid, position: float, values: Array, force: float) -> float:
    """Learn one sample and return the error before [N]; inf, and nothing learnt, beyond the knots of the fine map.

    Args:
        weights: Weights of the map.
        regression: State of their regression.
        grid: Knots of the map.
        position: Position from their origin [m].
        values: Features of the sample.
        force: Measured force, plus what the map gives without contact [N].
    """
    if regression.whole == 0:
        knot = cubic(position, grid.spacing, grid.below, grid.knots)[0]
        feature_knot = cubic(position, grid.feature_spacing, grid.feature_below, grid.feature_knots)[0]
        reach(weights, regression, knot, feature_knot)
    elif not in_fine_reach(position):
        return math.inf
    count = look(regression, grid, position, values)
    error = learn_rows(weights, regression, count, force)
    if regression.traced > 0:
        overwrite_mean(regression, count)
    return float(error)


@compiled(error_model="numpy")
def fade(regression: Regression, share: float) -> None:
    """Move the covariance back towards the prior by a fraction."""
    covariance, rows, weight_at = regression.covariance, regression.rows, regression.weight_at
    parts, before = regression.parts, regression.share
    for i in range(rows):
        weight = weight_at[i]
        part = parts[0 if weight < parts[1].begin else 1]
        inside = (weight - part.begin) % part.knots
        begin = weight - inside
        for k in range(rows):
            other = weight_at[k] - begin
            before[k] = part.prior[inside, other] if 0 <= other < part.knots else 0.0
        for k in range(rows):
            covariance[i, k] += share * (before[k] - covariance[i, k])
