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
from foretouch.identification.contact_map.prior import elastic_prior, feature_prior, prior
from foretouch.models.contact_map.kernel import cubic
from foretouch.models.contact_map.layout import COARSE, FINE, FINE_FROM, FINE_TO, LARGEST_FEATURES, Grid

Array = NDArray[np.float64]
Field = NDArray[Any]

ACTIVE = 4 * (1 + LARGEST_FEATURES)  # Largest number of weights whose splines are not zero at a sample


class Elastic(Record):
    """Knots of the coarse map's elastic part that were reached."""

    factor: Annotated[Field, float, (COARSE.knots, COARSE.knots)]  # Cholesky factor of the prior among them
    order: Annotated[Field, int, COARSE.knots]  # the knots, in the order of reaching
    count: int  # of them
    first: int  # all knots from this
    end: int  # to this are reached


class Feature(Record):
    """The same of each of its features, all of which reach the same knots."""

    factor: Annotated[Field, float, (COARSE.feature_knots, COARSE.feature_knots)]
    order: Annotated[Field, int, COARSE.feature_knots]
    count: int
    first: int
    end: int


class CoarseRegression(Record):
    """State of the regression of the coarse map besides the weights themselves."""

    covariance: Annotated[Field, float, (COARSE.size, COARSE.size)]  # P of the reached weights, in the first rows
    rows: int  # number of reached weights
    weight_at: Annotated[Field, int, COARSE.size]  # weight of each row
    row_of: Annotated[Field, int, COARSE.size]  # row of each weight, -1 for one not reached
    elastic_prior: Annotated[Field, float, (COARSE.knots, COARSE.knots)]
    feature_prior: Annotated[Field, float, (COARSE.feature_knots, COARSE.feature_knots)]
    elastic: Elastic
    feature: Feature
    gain: Annotated[Field, float, COARSE.size]  # scratch
    share: Annotated[Field, float, COARSE.size]  # scratch: c of a new knot, or a row of the prior
    regressor: Annotated[Field, float, ACTIVE]  # splines of the newest sample
    active: Annotated[Field, int, ACTIVE]  # and their rows
    traced: int  # 1 where a mean was given before the first sample
    trace: Annotated[Field, float, COARSE.size]  # what is left of it in each weight


class FineRegression(Record):
    """The same of the fine map."""

    covariance: Annotated[Field, float, (FINE.size, FINE.size)]
    rows: int
    weight_at: Annotated[Field, int, FINE.size]
    row_of: Annotated[Field, int, FINE.size]
    elastic_prior: Annotated[Field, float, (FINE.knots, FINE.knots)]
    feature_prior: Annotated[Field, float, (FINE.feature_knots, FINE.feature_knots)]
    gain: Annotated[Field, float, FINE.size]
    share: Annotated[Field, float, FINE.size]
    regressor: Annotated[Field, float, ACTIVE]
    active: Annotated[Field, int, ACTIVE]
    traced: int
    trace: Annotated[Field, float, FINE.size]


def begin_regressions(coarse: CoarseRegression, fine: FineRegression) -> None:
    """Set the priors of new regressions, and forget."""
    coarse.elastic_prior[:], coarse.feature_prior[:] = elastic_prior(0), feature_prior(0)
    fine.elastic_prior[:], fine.feature_prior[:] = elastic_prior(1), feature_prior(1)
    fine.rows = FINE.size
    fine.weight_at[:] = fine.row_of[:] = np.arange(FINE.size)
    forget_coarse(coarse)
    forget_fine(fine)


@compiled
def forget_coarse(regression: CoarseRegression) -> None:
    """Begin again without samples."""
    regression.rows = regression.elastic.count = regression.feature.count = regression.traced = 0
    regression.row_of[:] = -1
    regression.trace[:] = 0.0


@compiled
def forget_fine(regression: FineRegression) -> None:
    """Begin again without samples."""
    covariance, elastic, feature = regression.covariance, regression.elastic_prior, regression.feature_prior
    covariance[:] = 0.0
    regression.traced = 0
    for i in range(FINE.knots):  # a slice of an array into another takes seconds to compile
        for j in range(FINE.knots):
            covariance[i, j] = elastic[i, j]
    for f in range(FINE.features):
        begin = FINE.knots + f * FINE.feature_knots
        for i in range(FINE.feature_knots):
            for j in range(FINE.feature_knots):
                covariance[begin + i, begin + j] = feature[i, j]


@compiled(error_model="numpy")
def conditional(prior: Array, part: Elastic | Feature, share: Array, knot: int) -> float:
    """Write c of a knot and return d; the factor and the order grow by this knot."""
    factor, order, count = part.factor, part.order, part.count
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
def append(weights: Array, regression: CoarseRegression, begin: int, part: Elastic | Feature, rest: float) -> None:
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
def reach_elastic(weights: Array, regression: CoarseRegression, knot: int) -> None:
    """Reach one more knot of the elastic part."""
    part = regression.elastic
    rest = conditional(regression.elastic_prior[:], part, regression.share[:], knot)
    append(weights, regression, 0, part, rest)
    part.count += 1


@compiled(error_model="numpy")
def reach_feature(weights: Array, regression: CoarseRegression, knot: int) -> None:
    """Reach one more knot of every feature."""
    part = regression.feature
    rest = conditional(regression.feature_prior[:], part, regression.share[:], knot)
    for f in range(COARSE.features):
        append(weights, regression, COARSE.knots + f * COARSE.feature_knots, part, rest)
    part.count += 1


@compiled(error_model="numpy")
def reach(weights: Array, regression: CoarseRegression, knot: int, feature_knot: int) -> None:
    """Reach four knots from each of these on, of the elastic part and the features, and all between them and others."""
    elastic, feature = regression.elastic, regression.feature
    if regression.rows == 0:
        elastic.first = elastic.end = knot
        feature.first = feature.end = feature_knot
    while elastic.end < knot + 4:
        reach_elastic(weights, regression, elastic.end)
        elastic.end += 1
    while elastic.first > knot:
        elastic.first -= 1
        reach_elastic(weights, regression, elastic.first)
    while feature.end < feature_knot + 4:
        reach_feature(weights, regression, feature.end)
        feature.end += 1
    while feature.first > feature_knot:
        feature.first -= 1
        reach_feature(weights, regression, feature.first)


@inlined
def look(regression: CoarseRegression | FineRegression, grid: Grid, position: float, values: Array) -> int:
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
def learn_rows(weights: Array, regression: CoarseRegression | FineRegression, count: int, force: float) -> float:
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
def weigh(regression: CoarseRegression, part: Elastic | Feature, begin: int, mean: Array) -> None:
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
def expect_mean(regression: CoarseRegression, mean: Array) -> None:
    r"""Write what is left of a prior mean m in the weights after the samples so far, :math:`t = P Q^{-1} m`."""
    trace, covariance, weighed = regression.trace, regression.covariance, regression.gain
    weigh(regression, regression.elastic, 0, mean)
    for f in range(COARSE.features):
        weigh(regression, regression.feature, COARSE.knots + f * COARSE.feature_knots, mean)
    for i in range(regression.rows):
        value = 0.0
        for k in range(regression.rows):
            value += covariance[i, k] * weighed[k]
        trace[regression.weight_at[i]] = value
    regression.traced = 1


@compiled(error_model="numpy")
def overwrite_mean(regression: CoarseRegression | FineRegression, count: int) -> None:
    """Take from what is left of a prior mean what the sample that `learn_rows` has just learnt says: t - K h' t."""
    trace, gain, regressor, active = regression.trace, regression.gain, regression.regressor, regression.active
    weight_at, left, variance = regression.weight_at, 0.0, 1.0
    for a in range(count):
        left += regressor[a] * trace[weight_at[active[a]]]
        variance += regressor[a] * gain[active[a]]
    for i in range(regression.rows):
        trace[weight_at[i]] -= gain[i] / variance * left


@compiled(error_model="numpy")
def fit_coarse(weights: Array, regression: CoarseRegression, position: float, values: Array, force: float) -> float:
    """Learn one sample and return the error before [N].

    Args:
        weights: Weights of the map.
        regression: State of their regression.
        position: Position from the origin [m].
        values: Features of the sample.
        force: Measured force, plus what the map gives without contact [N].
    """
    elastic, feature = regression.elastic, regression.feature
    knot = cubic(position, COARSE.spacing, COARSE.below, COARSE.knots)[0]
    feature_knot = cubic(position, COARSE.feature_spacing, COARSE.feature_below, COARSE.feature_knots)[0]
    new = regression.rows == 0 or knot < elastic.first or knot + 4 > elastic.end
    if new or feature_knot < feature.first or feature_knot + 4 > feature.end:
        reach(weights, regression, knot, feature_knot)
    count = look(regression, COARSE, position, values)
    error = learn_rows(weights, regression, count, force)
    if regression.traced > 0:
        overwrite_mean(regression, count)
    return float(error)


@compiled(error_model="numpy")
def fit_fine(weights: Array, regression: FineRegression, position: float, values: Array, force: float) -> float:
    """The same with the fine map; inf outside its range."""
    if not in_fine_reach(position):
        return math.inf
    count = look(regression, FINE, position, values)
    error = learn_rows(weights, regression, count, force)
    if regression.traced > 0:
        overwrite_mean(regression, count)
    return float(error)


@compiled(error_model="numpy")
def fade(regression: CoarseRegression | FineRegression, share: float) -> None:
    """Move the covariance back towards the prior by a fraction."""
    covariance, rows, weight_at = regression.covariance, regression.rows, regression.weight_at
    elastic, feature, before = regression.elastic_prior[:], regression.feature_prior[:], regression.share
    knots, feature_knots = elastic.shape[0], feature.shape[0]
    for i in range(rows):
        weight = weight_at[i]
        inside = weight < knots
        begin = 0 if inside else knots + (weight - knots) // feature_knots * feature_knots
        length, prior = (knots, elastic) if inside else (feature_knots, feature)
        for k in range(rows):
            other = weight_at[k] - begin
            before[k] = prior[weight - begin, other] if 0 <= other < length else 0.0
        for k in range(rows):
            covariance[i, k] += share * (before[k] - covariance[i, k])


def whole_covariance(weights: Array, regressions: NDArray[np.void]) -> tuple[Array, Array]:
    """All weights of a map and their covariance, including those not reached, in the order of the map's weights.

    Args:
        weights: Weights of the map; left as they are.
        regressions: State of their regression, an array of one; left as it is.

    Returns:
        Shapes (n,) and (n, n).
    """
    weights = weights.copy()
    if regressions.dtype == FineRegression.layout:
        return weights, regressions[0].covariance.copy()
    regression = regressions.copy()[0]
    if not regression.rows:
        return weights, prior(0)
    for knot in (0, COARSE.knots - 4):
        reach(weights, regression, knot, int(regression.feature.first))
    for knot in (0, COARSE.feature_knots - 4):
        reach(weights, regression, 0, knot)
    return weights, regression.covariance[np.ix_(regression.row_of, regression.row_of)]
