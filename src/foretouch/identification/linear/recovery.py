"""From the four linear numbers of (18) back to the four of the law (4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

Array = NDArray[np.float64]

BINS_PER_DECADE = 24
DECADES = 5
DEEPEST = 1.0  # Largest depth of the histogram [m], which covers 10 um to 1 m

LEAST_SPREAD = 0.05
"""Least ratio of the spread of 1 / x to its RMS; below it only one depth was seen, and b1 and b2 are not separable."""

LARGEST_UNCERTAINTY = 0.25  # Largest standard error of the fraction of b2 in the damping, which is from 0 to 1
SHARE_MARGIN = 0.1  # Distance by which noise may put that fraction outside of 0 to 1; it then counts as 0 or 1


class Recovered(NamedTuple):
    """Parameters of the law (4); None for an undetermined one.

    Attributes:
        stiffness: k [N/m^s].
        damping: lambda [N s/m^(n+1)].
        exponent: n.
        switching: alpha, from 0 to 1.
    """

    stiffness: float | None
    damping: float | None
    exponent: float | None
    switching: float | None


_EDGES = DEEPEST * 10.0 ** (-DECADES + np.arange(BINS_PER_DECADE * DECADES + 1) / BINS_PER_DECADE)

INVERSE_DEPTH = 1.0 / np.sqrt(_EDGES[1:] * _EDGES[:-1])
"""1 / x [1/m] of the bins of a histogram of depths, even over ln x."""


@compiled
def inverse_power_fit(inverse_depth: Array, weights: Array, alpha: float) -> tuple[float, float]:
    """a1 and a2 of (17), `1 / x^alpha = a1 + a2 / x`, by weighted least squares over depths.

    Returns:
        a1 [m^-alpha] and a2 [m^(1-alpha)]; NaN where all depths are equal.
    """
    one = first = second = plain = crossed = 0.0
    for index in range(weights.size):
        u, w = inverse_depth[index], weights[index]
        power = w * math.exp(alpha * math.log(u))
        one += w
        first += w * u
        second += w * u * u
        plain += power
        crossed += power * u
    determinant = one * second - first * first
    if not determinant > 0.0:
        return math.nan, math.nan
    return (second * plain - first * crossed) / determinant, (one * crossed - first * plain) / determinant


@compiled
def _switching_of_share(inverse_depth: Array, weights: Array, reference: float, share: float) -> float:
    """The alpha at which a2 / (a1 x_ref + a2), rising from 0 at alpha = 0 to 1 at alpha = 1, equals the fraction."""
    low, width = 0.0, 1.0
    for _ in range(40):  # halves are exact
        width *= 0.5
        a1, a2 = inverse_power_fit(inverse_depth, weights, low + width)
        if a2 < share * (a1 * reference + a2):
            low += width
    return low + 0.5 * width


def recover(linear: Sequence[float], covariance: Array | None, depths: Array) -> Recovered:
    r"""k, lambda, n, alpha from (ln k, s, b1, b2), over the depths that were seen.

    By (17) and (18), b1 = a1 lambda / k and b2 = a2 lambda / k, where a1 and a2 follow from alpha and the depths. The
    fraction of b2 in the damping at a mean depth, `b2 / (b1 x_ref + b2) = a2 / (a1 x_ref + a2)`, gives alpha; then

    .. math::
        \lambda = k \frac{b_1 x_{ref} + b_2}{a_1 x_{ref} + a_2}, \qquad n = s - \alpha

    which is `k b1 / a1` and `k b2 / a2` at once, and stays well-conditioned where a1 or a2 is 0.

    Damping, exponent and switching are undetermined where one depth was seen, where damping is not positive (b1 and b2
    then do not fit this law), where the fraction is not within 0 to 1 but for a margin of 0.1, or where its standard
    error by `covariance` is above 0.25. At slow motion that is the rule: damping is then a thousandth of the force.

    Args:
        linear: ln k, s, b1 [s/m], b2 [s], depth in metres: four numbers.
        covariance: Of `linear`, shape (4, 4), None where there is none.
        depths: Information on b1 and b2 by depth: for each bin of `INVERSE_DEPTH` the sum of w v^2 of its samples, in
            which old ones fade as the recursion forgets them. Least squares on (18) fits 1 / x^alpha by a1 + a2 / x
            with the weight v^2, for its regressors are v and v / x.
    """
    ln_k, s, b1, b2 = linear
    stiffness = math.exp(ln_k) if ln_k < 700.0 else None
    unknown = Recovered(stiffness, None, None, None)
    used = depths > 0.0
    inverse_depth, weights = INVERSE_DEPTH[used], depths[used]
    if stiffness is None or weights.size < 2:
        return unknown
    weights = weights / weights.sum()
    mean = float(weights @ inverse_depth)
    if not 1.0 - mean * mean / float(weights @ (inverse_depth * inverse_depth)) >= LEAST_SPREAD**2:
        return unknown
    reference = 1.0 / mean
    damping = b1 * reference + b2
    if not (damping > 0.0 and math.isfinite(damping)):
        return unknown
    weight = b2 / damping
    if covariance is None or not -SHARE_MARGIN <= weight <= 1.0 + SHARE_MARGIN:
        return unknown
    # Plain floats from here: they overflow to inf and not to a warning, and no inf passes the comparisons.
    (c11, c12), (_, c22) = covariance[2:, 2:].tolist()
    by_b1, by_b2 = -weight * (reference / damping), b1 / damping * (reference / damping)
    if not by_b1 * by_b1 * c11 + 2.0 * by_b1 * by_b2 * c12 + by_b2 * by_b2 * c22 <= LARGEST_UNCERTAINTY**2:
        return unknown
    switching = min(max(0.0, weight), 1.0)
    if 0.0 < switching < 1.0:
        switching = float(_switching_of_share(inverse_depth, weights, reference, weight))
    a1, a2 = inverse_power_fit(inverse_depth, weights, switching)
    damping *= stiffness / (a1 * reference + a2)
    return Recovered(stiffness, damping, s - switching, switching) if math.isfinite(damping) else unknown
