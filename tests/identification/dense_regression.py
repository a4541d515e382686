"""Recursive least squares of one map with the covariance of all its weights, as a reference: slow and plain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.identification.contact_map.prior import prior
from foretouch.identification.contact_map.regression import Regression, begin_regression, reach
from foretouch.models.contact_map.kernel import locate
from foretouch.models.contact_map.layout import GRIDS

Array = NDArray[np.float64]


def new_regression(kind: int) -> NDArray[np.void]:
    """The compiled regression without samples, an array of one."""
    made = Regression.new()
    begin_regression(made[0], kind)
    return made


def whole_covariance(kind: int, weights: Array, regressions: NDArray[np.void]) -> tuple[Array, Array]:
    """All weights of a map and their covariance, including those not reached, in the order of the map's weights."""
    weights, regression, grid = weights.copy(), regressions.copy()[0], GRIDS[kind]
    if kind == 0:
        for place in (0, 1):
            reach(weights, regression, place * (grid.knots - 4), place * (grid.feature_knots - 4))
    rows = regression.row_of[: grid.size]
    return weights, regression.covariance[np.ix_(rows, rows)]


class DenseRegression:
    """Weights w and covariance P of a map, all of them at every sample."""

    def __init__(self, kind: int) -> None:
        self.kind = kind
        self.covariance = prior(kind)
        self.weights = np.zeros(self.covariance.shape[0])

    def regressor(self, place: float, values: Array) -> Array:
        """h, shape (n,)."""
        grid, splines = GRIDS[self.kind], np.empty(4)
        result = np.zeros(self.weights.size)
        first = locate(place, grid.spacing, grid.below, grid.knots, splines)
        result[first : first + 4] = splines
        first = grid.knots + locate(place, grid.feature_spacing, grid.feature_below, grid.feature_knots, splines)
        for feature in range(grid.features):
            begin = first + feature * grid.feature_knots
            result[begin : begin + 4] = splines * values[feature]
        return result

    def fit(self, place: float, values: Array, force: float) -> float:
        """One sample; returns the error before."""
        grid = GRIDS[self.kind]
        if self.kind == 1 and not -grid.below * grid.spacing <= place <= grid.above * grid.spacing:
            return math.inf
        regressor = self.regressor(place, values)
        error = force - float(regressor @ self.weights)
        gain = self.covariance @ regressor
        share = gain / (1.0 + float(regressor @ gain))
        self.weights += share * error
        self.covariance -= np.outer(share, gain)
        return error

    def fade(self, share: float) -> None:
        """Back towards the prior."""
        self.covariance += share * (prior(self.kind) - self.covariance)
