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
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined
from foretouch.identification.contact_map.prior import NOISE, elastic_prior, feature_prior
from foretouch.models.contact_map.kernel import cubic
from foretouch.models.contact_map.layout import ABOVE, BELOW, COARSE, COARSENESS, FINE, LARGEST_FEATURES, LENGTHS

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

REACHED_WEIGHTS, REACHED_ELASTIC, REACHED_FEATURE = range(3)
FROM_ELASTIC, TO_ELASTIC, FROM_FEATURE, TO_FEATURE = range(3, 7)
COUNTS = 7
"""Number of counts: reached weights of all, of the elastic part and of each feature, and ranges of knots (from, to)."""

_ACTIVE = 4 * (1 + LARGEST_FEATURES)
_WEIGHT_AT = COUNTS + _ACTIVE
_LAYOUTS = np.array([COARSE, FINE])
_COARSE_LENGTH, _FINE_LENGTH = LENGTHS
_FINE_FROM, _FINE_TO = -BELOW[1] * LENGTHS[1], ABOVE[1] * LENGTHS[1]


class MapRegression(NamedTuple):
    """State of the regression of one map besides the weights themselves; all of it is written in place.

    Attributes:
        kind: 0 for the coarse, 1 for the fine map.
        covariance: P of the reached weights in its first rows and columns, shape (n, n), n the number of all weights.
        numbers: Two scratches of length n and one for the splines of a sample; the prior of the elastic part and of a
            feature; the Cholesky factors of these priors among the reached weights, in the order of reaching.
        places: The counts; rows of the newest sample; weight of each row; row of each weight, -1 for one not reached;
            reached knots of the elastic part, in the order of reaching; the same of a feature.
    """

    kind: int
    covariance: Array
    numbers: Array
    places: Ints


def _lengths(kind: int) -> tuple[int, int, int]:
    """Number of all weights, of those of the elastic part, and of those of a feature."""
    _, begin, knots, _, coarse, _, end = COARSE if kind == 0 else FINE
    return end - begin, knots, coarse


def _sizes(kind: int) -> tuple[int, int, int]:
    """Lengths of covariance, numbers and places."""
    size, knots, coarse = _lengths(kind)
    factors = 1 if kind else 2  # a part that is reached in full at once needs no factors
    numbers = 2 * size + _ACTIVE + factors * (knots * knots + coarse * coarse)
    return size * size, numbers, _WEIGHT_AT + 2 * size + knots + coarse


def regression_size(kind: int) -> int:
    """Length of the array of a regression, of the coarse (0) or the fine map (1)."""
    return sum(_sizes(kind))


_SIZES = np.array([_sizes(0), _sizes(1)])


@inlined
def regression(part: Array, kind: int) -> MapRegression:
    """View a part of a longer array as a regression.

    Args:
        part: Shape (regression_size(kind),); whole numbers are stored in it as they are.
        kind: 0 for the coarse, 1 for the fine map.
    """
    size = _LAYOUTS[kind, 6] - _LAYOUTS[kind, 1]
    one, two = _SIZES[kind, 0], _SIZES[kind, 0] + _SIZES[kind, 1]
    return MapRegression(kind, part[:one].reshape((size, size)), part[one:two], part[two:].view(np.int64))


def make_regression(kind: int, part: Array | None = None) -> MapRegression:
    """Make a regression without samples, of the coarse (0) or the fine map (1).

    Args:
        kind: 0 for the coarse, 1 for the fine map.
        part: Array that holds it, shape (regression_size(kind),).
    """
    found = regression(np.zeros(regression_size(kind)) if part is None else part, kind)
    size, knots, coarse = _lengths(kind)
    begin, end = 2 * size + _ACTIVE, 2 * size + _ACTIVE + knots * knots
    found.numbers[begin:end] = elastic_prior(kind).ravel()
    found.numbers[end : end + coarse * coarse] = feature_prior(kind).ravel()
    forget(found)
    return found


@compiled(error_model="numpy")
def part_of(state: MapRegression, elastic: bool) -> tuple[int, Array, Array, Ints]:
    """Knots, prior and factor row by row, and order of reaching, of the elastic part or of a feature."""
    _, begin, knots, _, coarse, _, end = _LAYOUTS[state.kind]
    size = end - begin
    first = 2 * size + _ACTIVE
    second = first + knots * knots
    third = second + coarse * coarse
    order = _WEIGHT_AT + 2 * size
    if elastic:
        return knots, state.numbers[first:second], state.numbers[third:], state.places[order : order + knots]
    return coarse, state.numbers[second:third], state.numbers[third + knots * knots :], state.places[order + knots :]


@compiled(error_model="numpy")
def conditional(state: MapRegression, elastic: bool, knot: int) -> float:
    """Write c of a knot into the second scratch and return d; the factor and the order grow by this knot."""
    knots, prior, factor, order = part_of(state, elastic)
    size = state.covariance.shape[0]
    share, count = state.numbers[size : 2 * size], state.places[1 if elastic else 2]
    new = count * knots
    rest = prior[knot * knots + knot]
    for i in range(count):
        value = prior[knot * knots + order[i]]
        for k in range(i):
            value -= factor[i * knots + k] * factor[new + k]
        value /= factor[i * knots + i]
        factor[new + i] = value
        rest -= value * value
    rest = max(rest, 0.0)
    order[count] = knot
    factor[new + count] = math.sqrt(rest)
    for i in range(count):
        share[i] = factor[new + i]
    for i in range(count - 1, -1, -1):
        share[i] /= factor[i * knots + i]
        for k in range(i):
            share[k] -= factor[i * knots + k] * share[i]
    return float(rest)


@compiled(error_model="numpy")
def append(weights: Array, state: MapRegression, begin: int, order: Ints, count: int, rest: float) -> None:
    """Add one row: for the weight `begin + order[count]`, whose part begins at `begin`."""
    covariance, size = state.covariance, state.covariance.shape[0]
    new, share = state.numbers[:size], state.numbers[size : 2 * size]
    weight_at = state.places[_WEIGHT_AT : _WEIGHT_AT + size]
    row_of = state.places[_WEIGHT_AT + size : _WEIGHT_AT + 2 * size]
    rows, weight = state.places[REACHED_WEIGHTS], begin + order[count]
    new[:rows] = 0.0
    value = 0.0
    for i in range(count):
        c, known = share[i], begin + order[i]
        row = row_of[known]
        value += c * weights[known]
        for k in range(rows):
            new[k] += c * covariance[row, k]
    for i in range(count):
        rest += share[i] * new[row_of[begin + order[i]]]
    for k in range(rows):
        covariance[rows, k] = new[k]
        covariance[k, rows] = new[k]
    covariance[rows, rows] = rest
    weights[weight] = value
    weight_at[rows], row_of[weight] = weight, rows
    state.places[REACHED_WEIGHTS] = rows + 1


@compiled(error_model="numpy")
def reach_knot(weights: Array, state: MapRegression, elastic: bool, knot: int) -> None:
    """Reach one more knot, of the elastic part or of every feature."""
    rest = conditional(state, elastic, knot)
    order = part_of(state, elastic)[3]
    if elastic:
        append(weights, state, 0, order, state.places[REACHED_ELASTIC], rest)
        state.places[REACHED_ELASTIC] += 1
        return
    _, _, knots, _, coarse, features, _ = _LAYOUTS[state.kind]
    for f in range(features):
        append(weights, state, knots + f * coarse, order, state.places[REACHED_FEATURE], rest)
    state.places[REACHED_FEATURE] += 1


@compiled(error_model="numpy")
def reach(weights: Array, state: MapRegression, elastic: int, feature: int) -> None:
    """Reach four knots from each of these on, of the elastic part and the features, and all between them and others."""
    counts = state.places
    if counts[REACHED_WEIGHTS] == 0:
        counts[FROM_ELASTIC] = counts[TO_ELASTIC] = elastic
        counts[FROM_FEATURE] = counts[TO_FEATURE] = feature
    while counts[TO_ELASTIC] < elastic + 4:
        reach_knot(weights, state, True, counts[TO_ELASTIC])
        counts[TO_ELASTIC] += 1
    while counts[FROM_ELASTIC] > elastic:
        counts[FROM_ELASTIC] -= 1
        reach_knot(weights, state, True, counts[FROM_ELASTIC])
    while counts[TO_FEATURE] < feature + 4:
        reach_knot(weights, state, False, counts[TO_FEATURE])
        counts[TO_FEATURE] += 1
    while counts[FROM_FEATURE] > feature:
        counts[FROM_FEATURE] -= 1
        reach_knot(weights, state, False, counts[FROM_FEATURE])


@compiled(error_model="numpy")
def reach_all(state: MapRegression) -> None:
    """Reach all weights of a map that has reached none, in their order.

    This spares a map that is soon reached in full the rows one by one: one step of the hand may span many of its knots.
    """
    _, _, knots, _, coarse, features, _ = _LAYOUTS[state.kind]
    size = state.covariance.shape[0]
    state.covariance[:] = 0.0
    elastic, prior = part_of(state, True)[1], part_of(state, False)[1]
    for i in range(knots):  # a slice of an array into another takes seconds to compile
        for j in range(knots):
            state.covariance[i, j] = elastic[i * knots + j]
    for f in range(features):
        begin = knots + f * coarse
        for i in range(coarse):
            for j in range(coarse):
                state.covariance[begin + i, begin + j] = prior[i * coarse + j]
    for i in range(size):
        state.places[_WEIGHT_AT + i] = state.places[_WEIGHT_AT + size + i] = i
    state.places[REACHED_WEIGHTS] = size
    state.places[FROM_ELASTIC], state.places[TO_ELASTIC] = 0, knots
    state.places[FROM_FEATURE], state.places[TO_FEATURE] = 0, coarse


@compiled(error_model="numpy")
def forget(state: MapRegression) -> None:
    """Begin again without samples. The fine map is reached in full at once."""
    size = state.covariance.shape[0]
    state.places[:COUNTS] = 0
    state.places[_WEIGHT_AT + size : _WEIGHT_AT + 2 * size] = -1
    if state.kind == 1:
        reach_all(state)


@inlined
def look(weights: Array, state: MapRegression, place: float, values: Array) -> int:
    """Write rows and splines of a sample into the scratch and return their number, reaching them first."""
    length = _COARSE_LENGTH if state.kind == 0 else _FINE_LENGTH
    below = BELOW[0] if state.kind == 0 else BELOW[1]
    _, _, knots, _, coarse, features, _ = _LAYOUTS[state.kind]
    elastic, a, b, c, d = cubic(place, length, below, knots)
    feature, p, q, r, s = cubic(place, COARSENESS * length, -(-below // COARSENESS), coarse)
    counts, size = state.places, state.covariance.shape[0]
    new = elastic < counts[FROM_ELASTIC] or elastic + 4 > counts[TO_ELASTIC]
    if new or feature < counts[FROM_FEATURE] or feature + 4 > counts[TO_FEATURE]:
        reach(weights, state, elastic, feature)
    regressor, active = state.numbers[2 * size : 2 * size + _ACTIVE], state.places[COUNTS:_WEIGHT_AT]
    row_of = state.places[_WEIGHT_AT + size : _WEIGHT_AT + 2 * size]
    regressor[0], regressor[1], regressor[2], regressor[3] = a, b, c, d
    for j in range(4):
        active[j] = row_of[elastic + j]
    at, first = 4, knots + feature
    for f in range(features):
        value = values[f]
        regressor[at], regressor[at + 1] = p * value, q * value
        regressor[at + 2], regressor[at + 3] = r * value, s * value
        for j in range(4):
            active[at + j] = row_of[first + j]
        at += 4
        first += coarse
    return at


@inlined
def in_fine_reach(place: float) -> bool:
    """Whether the fine map learns at a position [m from the origin]."""
    return _FINE_FROM <= place <= _FINE_TO


@compiled(error_model="numpy")
def fit(weights: Array, state: MapRegression, place: float, values: Array, force: float) -> float:
    """Learn one sample by recursive least squares; returns the error before [N], inf outside the range of the map.

    The new covariance P - P h h' P / (h' P h + r) is symmetric to rounding as it is computed; the error is NaN where
    the old one was not a covariance.

    Args:
        weights: Weights of the map, a part of the flat array.
        state: State of their regression.
        place: Position from the origin [m].
        values: Features of the sample.
        force: Measured force, plus what the map gives without contact [N].
    """
    if state.kind == 1 and not in_fine_reach(place):
        return math.inf
    count = look(weights, state, place, values)
    covariance, size, rows = state.covariance, state.covariance.shape[0], state.places[REACHED_WEIGHTS]
    gain, regressor = state.numbers[:size], state.numbers[2 * size : 2 * size + _ACTIVE]
    active, weight_at = state.places[COUNTS:_WEIGHT_AT], state.places[_WEIGHT_AT : _WEIGHT_AT + size]
    error, variance = force, NOISE * NOISE
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
    if not variance >= NOISE * NOISE:  # the covariance is lost to rounding
        return math.nan
    for i in range(rows):
        share = gain[i] / variance
        weights[weight_at[i]] += share * error
        for k in range(rows):
            covariance[i, k] -= share * gain[k]
    return error


@compiled(error_model="numpy")
def fade(state: MapRegression, share: float) -> None:
    """Move the covariance back towards the prior by a fraction."""
    _, _, knots, _, coarse, _, _ = _LAYOUTS[state.kind]
    size, rows = state.covariance.shape[0], state.places[REACHED_WEIGHTS]
    before, weight_at = state.numbers[size : 2 * size], state.places[_WEIGHT_AT : _WEIGHT_AT + size]
    elastic, feature = part_of(state, True)[1], part_of(state, False)[1]
    for i in range(rows):
        weight = weight_at[i]
        inside = weight < knots
        begin = 0 if inside else knots + (weight - knots) // coarse * coarse
        length, prior = (knots, elastic) if inside else (coarse, feature)
        at = (weight - begin) * length
        for k in range(rows):
            place = weight_at[k] - begin
            before[k] = prior[at + place] if 0 <= place < length else 0.0
        for k in range(rows):
            state.covariance[i, k] += share * (before[k] - state.covariance[i, k])


def whole_covariance(weights: Array, state: MapRegression) -> tuple[Array, Array]:
    """All weights of a map and their covariance, including those not reached, in the order of the flat array.

    Args:
        weights: Weights of the map; left as they are.
        state: State of their regression; left as it is.

    Returns:
        Shapes (n,) and (n, n).
    """
    weights = weights.copy()
    state = MapRegression(state.kind, state.covariance.copy(), state.numbers.copy(), state.places.copy())
    if not state.places[REACHED_WEIGHTS]:
        reach_all(state)
    size, knots, coarse = _lengths(state.kind)
    for knot in (0, knots - 4):
        reach(weights, state, knot, int(state.places[FROM_FEATURE]))
    for knot in (0, coarse - 4):
        reach(weights, state, 0, knot)
    row_of = state.places[_WEIGHT_AT + size : _WEIGHT_AT + 2 * size]
    return weights, state.covariance[np.ix_(row_of, row_of)]
