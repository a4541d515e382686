r"""Recursive least squares of one map, compiled, in the weights that were reached.

A weight is reached when a sample's splines are not zero there. Of a weight n that was not, no sample has told
anything but what it told of the reached ones v of the same part (the elastic part, or one feature: parts are
independent before the first sample), so

.. math::
    w_n = c^T w_v, \quad P_{nj} = c^T P_{vj}, \quad P_{nn} = d + c^T P_{vv} c, \quad
        c = Q_{vv}^{-1} Q_{vn}, \quad d = Q_{nn} - Q_{nv} c

with Q the prior. That holds at any time and under any history, so the covariance is kept for reached weights alone, and
grows by a row where one more is reached: what a sample costs goes with the square of the depth that was visited and not
with the knots that there are. The Cholesky factor of Q among the reached grows with it, so c costs two triangular
solutions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.contact_map.prior import NOISE, elastic_prior, feature_prior
from foretouch.models.contact_map.kernel import cubic
from foretouch.models.contact_map.layout import ABOVE, BELOW, COARSE, COARSENESS, FINE, LARGEST_FEATURES, LENGTHS

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

REACHED_WEIGHTS, REACHED_ELASTIC, REACHED_FEATURE = range(3)
FROM_ELASTIC, TO_ELASTIC, FROM_FEATURE, TO_FEATURE = range(3, 7)
COUNTS = 7
"""How many weights were reached, in all, of the elastic part and of each feature, and which knots: from, to."""

_ACTIVE = 4 * (1 + LARGEST_FEATURES)
_WEIGHT_AT = COUNTS + _ACTIVE
_LAYOUTS = np.array([COARSE, FINE])
_COARSE_LENGTH, _FINE_LENGTH = LENGTHS
_FINE_FROM, _FINE_TO = -BELOW[1] * LENGTHS[1], ABOVE[1] * LENGTHS[1]

_compiled = compiled(error_model="numpy")
_inlined = compiled(error_model="numpy", forceinline=True)


class MapRegression(NamedTuple):
    """What is known of the weights of one map beside the weights themselves; all is written in place.

    Attributes:
        kind: 0 for the coarse, 1 for the fine map.
        covariance: P of the reached weights in its first rows and columns, shape (n, n), n all weights of the map.
        numbers: Two scratches of length n and one for the splines of a sample; the prior of the elastic part and of a
            feature; the Cholesky factors of these among the reached, in the order in which they were.
        places: The counts; which rows a sample is about; which weight a row is of; row of a weight, -1 for one that was
            not reached; reached knots of the elastic part, in the order in which they were; the same of a feature.
    """

    kind: int
    covariance: Array
    numbers: Array
    places: Ints


def _lengths(kind: int) -> tuple[int, int, int]:
    """Weights, those of the elastic part, and those of a feature."""
    _, begin, knots, _, coarse, _, end = COARSE if kind == 0 else FINE
    return end - begin, knots, coarse


def _sizes(kind: int) -> tuple[int, int, int]:
    """Lengths of covariance, numbers and places."""
    size, knots, coarse = _lengths(kind)
    factors = 1 if kind else 2  # what is reached in full at once needs no factors
    numbers = 2 * size + _ACTIVE + factors * (knots * knots + coarse * coarse)
    return size * size, numbers, _WEIGHT_AT + 2 * size + knots + coarse


def regression_size(kind: int) -> int:
    """Numbers that a regression takes, of the coarse (0) or the fine map (1)."""
    return sum(_sizes(kind))


_SIZES = np.array([_sizes(0), _sizes(1)])


def _regression(part: Array, kind: int) -> MapRegression:
    """A regression in a part of a longer array.

    Args:
        part: Shape (regression_size(kind),); whole numbers are stored in it as they are.
        kind: 0 for the coarse, 1 for the fine map.
    """
    size = _LAYOUTS[kind, 6] - _LAYOUTS[kind, 1]
    one, two = _SIZES[kind, 0], _SIZES[kind, 0] + _SIZES[kind, 1]
    return MapRegression(kind, part[:one].reshape((size, size)), part[one:two], part[two:].view(np.int64))


regression: Callable[[Array, int], MapRegression] = _inlined(_regression)


def make_regression(kind: int, part: Array | None = None) -> MapRegression:
    """A regression that has seen nothing, of the coarse (0) or the fine map (1).

    Args:
        kind: Which.
        part: Where it is kept, shape (regression_size(kind),).
    """
    found = regression(np.zeros(regression_size(kind)) if part is None else part, kind)
    size, knots, coarse = _lengths(kind)
    begin, end = 2 * size + _ACTIVE, 2 * size + _ACTIVE + knots * knots
    found.numbers[begin:end] = elastic_prior(kind).ravel()
    found.numbers[end : end + coarse * coarse] = feature_prior(kind).ravel()
    forget(found)
    return found


def _part(state: MapRegression, elastic: bool) -> tuple[int, Array, Array, Ints]:
    """Of the elastic part or of a feature: knots, prior and factor row by row, and the order of what was reached."""
    _, begin, knots, _, coarse, _, end = _LAYOUTS[state.kind]
    size = end - begin
    first = 2 * size + _ACTIVE
    second = first + knots * knots
    third = second + coarse * coarse
    order = _WEIGHT_AT + 2 * size
    if elastic:
        return knots, state.numbers[first:second], state.numbers[third:], state.places[order : order + knots]
    return coarse, state.numbers[second:third], state.numbers[third + knots * knots :], state.places[order + knots :]


part_of: Callable[[MapRegression, bool], tuple[int, Array, Array, Ints]] = _compiled(_part)


def _conditional(state: MapRegression, elastic: bool, knot: int) -> float:
    """C of a knot into the second scratch, and d; the factor and the order grow by this knot."""
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


conditional: Callable[[MapRegression, bool, int], float] = _compiled(_conditional)


def _append(weights: Array, state: MapRegression, begin: int, order: Ints, count: int, rest: float) -> None:
    """One more row: of the weight `begin + order[count]`, whose part begins at `begin`."""
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


append: Callable[[Array, MapRegression, int, Ints, int, float], None] = _compiled(_append)


def _reach_knot(weights: Array, state: MapRegression, elastic: bool, knot: int) -> None:
    """One more knot, of the elastic part or of every feature."""
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


reach_knot: Callable[[Array, MapRegression, bool, int], None] = _compiled(_reach_knot)


def _reach(weights: Array, state: MapRegression, elastic: int, feature: int) -> None:
    """Reach the four knots from these on, of the elastic part and of the features, and all between them and others."""
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


reach: Callable[[Array, MapRegression, int, int], None] = _compiled(_reach)


def _reach_all(state: MapRegression) -> None:
    """Reach all weights of a map that has reached none, in their order.

    A map that is soon reached in full is spared the rows one by one: one step of the hand may be many of its knots.
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


reach_all: Callable[[MapRegression], None] = _compiled(_reach_all)


def _forget(state: MapRegression) -> None:
    """Begin anew. The fine map is reached in full at once."""
    size = state.covariance.shape[0]
    state.places[:COUNTS] = 0
    state.places[_WEIGHT_AT + size : _WEIGHT_AT + 2 * size] = -1
    if state.kind == 1:
        reach_all(state)


forget: Callable[[MapRegression], None] = _compiled(_forget)


def _look(weights: Array, state: MapRegression, place: float, values: Array) -> int:
    """Rows and splines of what a sample is about, into the scratch; returns how many they are, reaching them first."""
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


look: Callable[[Array, MapRegression, float, Array], int] = _inlined(_look)


def _in_fine_reach(place: float) -> bool:
    """Whether the fine map learns of a place [m from the origin]."""
    return _FINE_FROM <= place <= _FINE_TO


in_fine_reach: Callable[[float], bool] = _inlined(_in_fine_reach)


def _fit(weights: Array, state: MapRegression, place: float, values: Array, force: float) -> float:
    """Recursive least squares: one sample into a map; returns the error before [N], inf where the map does not reach.

    The new covariance P - P h h' P / (h' P h + r) is symmetric to rounding as it is computed; the error is NaN where
    the old one was none.

    Args:
        weights: Of the map, a part of the flat array.
        state: What is known of them.
        place: From the origin [m].
        values: The features.
        force: What is felt there, with what the map gives without contact [N].
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
    if not variance >= NOISE * NOISE:  # rounding has spoilt the covariance
        return math.nan
    for i in range(rows):
        share = gain[i] / variance
        weights[weight_at[i]] += share * error
        for k in range(rows):
            covariance[i, k] -= share * gain[k]
    return error


fit: Callable[[Array, MapRegression, float, Array, float], float] = _compiled(_fit)


def _fade(state: MapRegression, share: float) -> None:
    """The covariance goes back towards the prior by a share."""
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


fade: Callable[[MapRegression, float], None] = _compiled(_fade)


def whole_covariance(weights: Array, state: MapRegression) -> tuple[Array, Array]:
    """All weights of a map and their covariance, also of those that were not reached, in the order of the flat array.

    Args:
        weights: Of the map; left as they are.
        state: What is known of them; left as it is.

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
