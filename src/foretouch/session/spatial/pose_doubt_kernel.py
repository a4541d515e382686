"""What `foretouch.session.spatial.pose_doubt.PoseDoubt` takes of a covariance in each tick, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

__all__ = ["height_variance", "variances"]

Array = NDArray[np.float64]


def _variance(covariance: Array, a: float, b: float, c: float, x: float, y: float, z: float) -> float:
    """J P J^T for J = (-n, n x q), n = (a, b, c) and q = (x, y, z)."""
    derivative = (-a, -b, -c, b * z - c * y, c * x - a * z, a * y - b * x)
    total = 0.0
    for row in range(6):
        for column in range(6):
            total += derivative[row] * covariance[row, column] * derivative[column]
    return total


height_variance = compiled("f8(f8[:,::1], f8, f8, f8, f8, f8, f8)")(_variance)


def _variances(
    covariance: Array, a: float, b: float, c: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Of a point q = (x, y, z) of a fixture, with a surface of normal n = (a, b, c) there.

    Returns:
        Variance of its height, of where it is over all directions [m^2], and of how the normal is inclined [rad^2].
    """
    place = height_variance(covariance, 1.0, 0.0, 0.0, x, y, z) + height_variance(covariance, 0.0, 1.0, 0.0, x, y, z)
    place += height_variance(covariance, 0.0, 0.0, 1.0, x, y, z)
    normal, inclined = (a, b, c), 0.0
    for row in range(3):
        inclined += covariance[3 + row, 3 + row]
        for column in range(3):
            inclined -= normal[row] * covariance[3 + row, 3 + column] * normal[column]
    return height_variance(covariance, a, b, c, x, y, z), place, inclined


variances = compiled("Tuple((f8, f8, f8))(f8[:,::1], f8, f8, f8, f8, f8, f8)")(_variances)
