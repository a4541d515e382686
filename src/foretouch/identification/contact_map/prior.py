"""What is believed of a contact map before the first sample."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from foretouch.models.contact_map.layout import BELOW, COARSE, COARSENESS, FINE

Array = NDArray[np.float64]

NOISE = 0.3
"""Standard deviation of a force. Only its ratio to the prior matters, so force has no unit here."""

LEVEL, SLOPE, CURVATURE = 1.5, 0.5, 0.6
"""Elastic part at the origin, its slope there, and the density of the noise that is its curvature; per knot."""

FEATURE_SIZE, FEATURE_REACH = 0.4, 6.0
"""Standard deviation of a feature's part, and over how many knots of the elastic part it resembles itself."""


@cache
def elastic_prior(kind: int) -> Array:
    """Covariance of the weights of the elastic part: a doubly integrated white noise from the origin both ways.

    That is a cubic smoothing spline (Wahba 1990).

    Args:
        kind: 0 for the coarse, 1 for the fine map.

    Returns:
        Shape (knots, knots), not to be written.
    """
    knots = (COARSE if kind == 0 else FINE)[2]
    places = np.arange(knots) - BELOW[kind] - 1.0
    size = np.abs(places)
    near, far = np.minimum.outer(size, size), np.maximum.outer(size, size)
    same_side = np.sign(places)[:, None] == np.sign(places)[None, :]
    found: Array = (
        CURVATURE**2 * np.where(same_side, near * near * (3.0 * far - near) / 6.0, 0.0)
        + LEVEL**2
        + SLOPE**2 * np.outer(places, places)
    )
    return found


@cache
def feature_prior(kind: int) -> Array:
    """Covariance of the weights of one feature: a Gaussian process with a squared-exponential covariance.

    Args:
        kind: 0 for the coarse, 1 for the fine map.

    Returns:
        Shape (knots of the feature, knots of the feature), not to be written.
    """
    coarse = (COARSE if kind == 0 else FINE)[4]
    distance = COARSENESS * np.subtract.outer(np.arange(coarse), np.arange(coarse)) / FEATURE_REACH
    found: Array = FEATURE_SIZE**2 * np.exp(-0.5 * distance**2) + 1e-9 * np.eye(coarse)
    return found


def prior(kind: int) -> Array:
    """Covariance of all weights of a map, in the order of the flat array: its parts are independent.

    Args:
        kind: 0 for the coarse, 1 for the fine map.
    """
    _, first, knots, _, coarse, count, end = COARSE if kind == 0 else FINE
    covariance = np.zeros((end - first, end - first))
    covariance[:knots, :knots] = elastic_prior(kind)
    for feature in range(count):
        begin = knots + feature * coarse
        covariance[begin : begin + coarse, begin : begin + coarse] = feature_prior(kind)
    return covariance
