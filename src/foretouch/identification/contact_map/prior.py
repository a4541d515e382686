"""What is believed of a contact map before the first sample."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from foretouch.models.contact_map.layout import COARSENESS, GRIDS

Array = NDArray[np.float64]

LEVEL, SIZE = 5.0, 2.0
"""Standard deviations, in that of a sample's force, so that force has no unit: the elastic part's at the origin; and
its slope's and its change of slope's, per knot, and each feature's part."""

FEATURE_REACH = 2.0 * COARSENESS  # Over how many knots of the elastic part a feature's part resembles itself


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
        SIZE**2 * np.where(same_side, near * near * (3.0 * far - near) / 6.0, 0.0)
        + LEVEL**2
        + SIZE**2 * np.outer(knots, knots)
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
    result: Array = SIZE**2 * np.exp(-0.5 * distance**2) + 1e-9 * np.eye(knots.size)
    return result


def prior(kind: int) -> Array:
    """Covariance of all weights of the coarse (0) or the fine map (1), in their order: its parts are independent."""
    from scipy.linalg import block_diag

    parts = [elastic_prior(kind)] + [feature_prior(kind)] * GRIDS[kind].features
    return np.asarray(block_diag(*parts))
