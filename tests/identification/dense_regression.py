"""Recursive least squares of one map with the covariance of all its weights, as a reference: slow and plain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.identification.contact_map.prior import NOISE, prior
from foretouch.models.contact_map.kernel import locate
from foretouch.models.contact_map.layout import ABOVE, BELOW, COARSE, COARSENESS, FINE, LENGTHS

Array = NDArray[np.float64]


class DenseRegression:
    """Weights w and covariance P of a map, all of them at every sample."""

    def __init__(self, kind: int) -> None:
        self.kind = kind
        self.covariance = prior(kind)
        self.weights = np.zeros(self.covariance.shape[0])

    def regressor(self, place: float, values: Array) -> Array:
        """h, shape (n,)."""
        _, _, knots, _, coarse, count, _ = COARSE if self.kind == 0 else FINE
        length, below, splines = LENGTHS[self.kind], BELOW[self.kind], np.empty(4)
        found = np.zeros(self.weights.size)
        first = locate(place, length, below, knots, splines)
        found[first : first + 4] = splines
        first = knots + locate(place, COARSENESS * length, -(-below // COARSENESS), coarse, splines)
        for feature in range(count):
            begin = first + feature * coarse
            found[begin : begin + 4] = splines * values[feature]
        return found

    def fit(self, place: float, values: Array, force: float) -> float:
        """One sample; returns the error before."""
        length = LENGTHS[self.kind]
        if self.kind == 1 and not -BELOW[1] * length <= place <= ABOVE[1] * length:
            return math.inf
        regressor = self.regressor(place, values)
        error = force - float(regressor @ self.weights)
        gain = self.covariance @ regressor
        share = gain / (NOISE * NOISE + float(regressor @ gain))
        self.weights += share * error
        self.covariance -= np.outer(share, gain)
        return error

    def fade(self, share: float) -> None:
        """Back towards the prior."""
        self.covariance += share * (prior(self.kind) - self.covariance)
