"""Many recordings at once in NumPy, as whoever has no compiler writes it: every operation over all streams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.press import INITIAL_COVARIANCE

__all__ = ["recursion_over_many"]

Array = NDArray[np.float64]


def recursion_over_many(regressors: Array, targets: Array, forgetting_factor: Array) -> Array:
    """Equation (20) without its perturbation, from theta_0 = 0 and P_0 = p I.

    Args:
        regressors: Phi of m samples of n streams, shape (m, 4, n): streams innermost, as it is fastest.
        targets: ln F, shape (m, n).
        forgetting_factor: mu, shape (m, n).

    Returns:
        Theta after the last sample, shape (n, 4).
    """
    _, size, streams = regressors.shape
    theta = np.zeros((size, streams))
    covariance = np.zeros((size, size, streams))
    covariance[range(size), range(size)] = INITIAL_COVARIANCE
    for regressor, target, mu in zip(regressors, targets, forgetting_factor, strict=True):
        projected = (covariance * regressor).sum(axis=1)
        gain = projected / (mu + (regressor * projected).sum(axis=0))
        theta += gain * (target - (regressor * theta).sum(axis=0))
        covariance -= gain[:, None] * projected
        covariance /= mu
    return theta.T
