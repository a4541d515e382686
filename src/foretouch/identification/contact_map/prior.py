"""What is believed of a contact map before the first sample."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from foretouch.models.contact_map.layout import COARSENESS, GRIDS

Array = NDArray[np.float64]

NOISE = 0.3
"""Standard deviation of a force. Only its ratio to the prior matters, so force has no unit here."""

LEVEL, SLOPE, CURVATURE = 1.5, 0.5, 0.6
"""Elastic part at the origin, its slope there, and the density of the noise that is its curvature; per knot."""

FEATURE_SIZE, FEATURE_REACH = 0.4, 2.0 * COARSENESS
"""Standard deviation of a feature's part, and over how many knots of the elastic part it resembles itself: two of its
own."""


@cache
def elastic_prior(kind: int) -> Array:
    """Covariance of the weights of the elastic part: a doubly integrated white noise from the origin both ways.

    That is a cubic smoothing spline (Wahba 1990).

    Returns:
        Shape (knots, knots), not to be written.
    """
    grid = GRIDS[kind]
    knots = np.arange(grid.knots) - grid.below - 1.0
    size = np.abs(knots)
    near, far = np.minimum.outer(size, size), np.maximum.outer(size, size)
    same_side = np.sign(knots)[:, None] == np.sign(knots)[None, :]
    result: Array = (
        CURVATURE**2 * np.where(same_side, near * near * (3.0 * far - near) / 6.0, 0.0)
        + LEVEL**2
        + SLOPE**2 * np.outer(knots, knots)
    )
    return result


@cache
def feature_prior(kind: int) -> Array:
    """Covariance of the weights of one feature: a Gaussian process with a squared-exponential covariance.

    Returns:
        Shape (knots of the feature, knots of the feature), not to be written.
    """
    knots = np.arange(GRIDS[kind].feature_knots)
    distance = COARSENESS * np.subtract.outer(knots, knots) / FEATURE_REACH
    result: Array = FEATURE_SIZE**2 * np.exp(-0.5 * distance**2) + 1e-9 * np.eye(knots.size)
    return result


def prior(kind: int) -> Array:
    """Covariance of all weights of the coarse (0) or the fine map (1), in their order: its parts are independent."""
    from scipy.linalg import block_diag

    parts = [elastic_prior(kind)] + [feature_prior(kind)] * GRIDS[kind].features
    return np.asarray(block_diag(*parts))
