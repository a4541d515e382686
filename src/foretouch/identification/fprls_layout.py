"""What the compiled linear estimators keep of one recording, and their options, each packed into one array.

A call from Python costs about 0.1 us for each array that it hands over, so there are two.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.identification.recovery import BINS_PER_DECADE, DECADES

__all__ = [
    "BEFORE",
    "BIN",
    "BINS",
    "FIRST_COVARIANCE",
    "FIRST_THETA",
    "FLOOR",
    "FREE_AIR",
    "GAIN",
    "GATED",
    "GATE_DEPTH",
    "GATE_FORCE",
    "LARGEST_RATE",
    "LAST_DEPTH",
    "LEARNT",
    "LOG_SCALE",
    "NEWTONS",
    "OPTIONS_SIZE",
    "PERTURBATION",
    "PERTURBED",
    "RATE",
    "RATE_FACTOR",
    "RESETTING",
    "RESIDUALS",
    "RESTARTED",
    "SENSITIVITY",
    "SHARE",
    "STATE_SIZE",
    "TRACE_LIMIT",
    "UNUSABLE",
    "VELOCITY_FACTOR",
    "WEIGHT",
    "full_covariance",
]

Array = NDArray[np.float64]

LEARNT, FREE_AIR, UNUSABLE, GATED, RESTARTED, PERTURBED = range(6)
"""What was done with a sample; the last one learnt from it too."""

# The state of one recording: theta is 0 to 3, the triangle of P 4 to 13.
RESIDUALS = 14  # sum of the squared residuals, and of their weights
LAST_DEPTH = 16  # of the newest sample that was not refused [m], NaN after free air
GAIN = 17  # what a new sample weighs in the histogram of depths; grows instead of shrinking all bins
BIN = 18
BINS = BINS_PER_DECADE * DECADES
STATE_SIZE = BIN + BINS

# The options of one recording, in the units of the regressors.
LOG_SCALE = 0  # ln of the depth that regressors are measured by
VELOCITY_FACTOR, RATE_FACTOR = 1, 2  # what v and v / x are multiplied by
LARGEST_RATE = 3  # [1/s], inf for none
FLOOR, SHARE, RATE = 4, 5, 6  # mu = floor + share exp(-rate dx)
GATE_FORCE, GATE_DEPTH = 7, 8
WEIGHT = 9  # 1 / weight_force [1/N], 0 for equal weights
SENSITIVITY, PERTURBATION = 10, 11
NEWTONS, BEFORE, RESETTING = 12, 13, 14  # 1 or 0
TRACE_LIMIT = 15
FIRST_THETA, FIRST_COVARIANCE = 16, 20
OPTIONS_SIZE = 21


def full_covariance(triangle: Array) -> Array:
    """P of its lower triangle, shape (10, ...), row by row: shape (4, 4, ...)."""
    rows, columns = np.tril_indices(4)
    covariance = np.empty((4, 4, *triangle.shape[1:]))
    covariance[rows, columns] = covariance[columns, rows] = triangle
    return covariance
