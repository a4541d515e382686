"""Recursive least squares of one map with the covariance of all its weights, as a reference: slow and plain."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.identification.contact_map.prior import prior
from foretouch.identification.contact_map.regression import (
    CoarseRegression,
    FineRegression,
    begin_regressions,
    fit_coarse,
    fit_fine,
)
from foretouch.models.contact_map.kernel import locate
from foretouch.models.contact_map.layout import GRIDS

Array = NDArray[np.float64]


def new_regression(kind: int) -> NDArray[np.void]:
    """The compiled regression without samples, an array of one."""
    made = CoarseRegression.new(), FineRegression.new()
    begin_regressions(made[0][0], made[1][0])
    return made[kind]


def fit(kind: int) -> Callable[..., float]:
    """How it learns a sample."""
    return fit_fine if kind else fit_coarse


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
