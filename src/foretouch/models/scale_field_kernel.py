"""The field of a material's scale over a surface, compiled: its lattice, its value at a point, and what is not touched.

The equations are in `foretouch.models.ScaleField`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.core.records import Record

Grid = NDArray[np.float64]

SPACING = 3e-3
"""Distance between two nodes [m]: half of the width of the sharpest edge that soft tissue shows under a probe."""

SIDE = 256  # Number of nodes along each axis: the lattice is 768 mm wide, with its middle in the fixture's origin

REACH = 20e-3
"""Distance over which the correlation of two places falls to 1/e [m]."""

SPREAD = 1.0
"""Standard deviation of the logarithm of the scale where nothing was touched: a factor of e either way."""

LARGEST_LOG = 7.0
"""Largest logarithm of a scale, either way: a factor of 1,100, more than between skin and bone."""

BETWEEN = math.exp(-SPACING / REACH)  # Correlation of two neighbours
TOUCHED = 0.5 * SPREAD * SPREAD
"""Variance below which a node counts as touched; what is known less of goes on from those that are."""

FILLED = 8  # Number of nodes outwards from the touched ones that are filled


class Scales(Record):
    """What is known of the scale at each node, of its logarithm."""

    value: Annotated[NDArray[Any], float, (SIDE, SIDE)]
    variance: Annotated[NDArray[Any], float, (SIDE, SIDE)] = SPREAD * SPREAD  # type: ignore[assignment]


@compiled(error_model="numpy")
def locate(x: float, y: float) -> tuple[int, int, float, float]:
    """The node below and left of a point, seen from above, and the point's place in that cell, from 0 to 1 each.

    A point beyond the lattice is taken for the nearest on its rim, with a margin of two nodes.
    """
    low, high = 2.0, SIDE - 3.0 - 1e-9
    u, v = min(max(x / SPACING + SIDE // 2, low), high), min(max(y / SPACING + SIDE // 2, low), high)
    i, j = int(u), int(v)
    return i, j, u - i, v - j


@compiled(error_model="numpy")
def scale_at(scales: Scales, x: float, y: float) -> tuple[float, float]:
    """The logarithm of the scale at a point, and its variance, that of the nodes taken as one."""
    i, j, u, v = locate(x, y)
    value = variance = 0.0
    for a in range(2):
        for b in range(2):
            weight = (u if a else 1.0 - u) * (v if b else 1.0 - v)
            value += weight * scales.value[i + a, j + b]
            variance += weight * scales.variance[i + a, j + b]
    return value, variance


@compiled(error_model="numpy")
def scales_at(scales: Scales, points: Grid, out: Grid) -> None:
    """`scale_at` many points of shape (n, 2), written into out of shape (n, 2)."""
    for row in range(points.shape[0]):
        out[row, 0], out[row, 1] = scale_at(scales, points[row, 0], points[row, 1])


@compiled(allocates=True, error_model="numpy")
def fill(known: Scales, filled: Scales, low_i: int, high_i: int, low_j: int, high_j: int) -> None:
    """Copy what is touched within these rows and columns, and go on from there, one ring of nodes after the other.

    A node next to known ones takes their mean, times the correlation of two neighbours; those at corners count half.
    """
    low_i, high_i = max(low_i - FILLED, 1), min(high_i + FILLED, SIDE - 2)
    low_j, high_j = max(low_j - FILLED, 1), min(high_j + FILLED, SIDE - 2)
    prior = SPREAD * SPREAD
    ring = np.full((high_i - low_i + 3, high_j - low_j + 3), FILLED + 1, np.int64)  # in which each was reached
    for i in range(low_i, high_i + 1):
        for j in range(low_j, high_j + 1):
            filled.value[i, j], filled.variance[i, j] = known.value[i, j], known.variance[i, j]
            if known.variance[i, j] < TOUCHED:
                ring[i - low_i + 1, j - low_j + 1] = 0
    for step in range(1, FILLED + 1):
        for i in range(low_i, high_i + 1):
            for j in range(low_j, high_j + 1):
                if ring[i - low_i + 1, j - low_j + 1] <= step:
                    continue
                total = value = variance = 0.0
                for a in range(-1, 2):
                    for b in range(-1, 2):
                        if ring[i + a - low_i + 1, j + b - low_j + 1] < step:
                            weight = 0.5 if a != 0 and b != 0 else 1.0
                            total += weight
                            value += weight * filled.value[i + a, j + b]
                            variance += weight * filled.variance[i + a, j + b]
                if total > 0.0:
                    ring[i - low_i + 1, j - low_j + 1] = step
                    filled.value[i, j] = BETWEEN * value / total
                    filled.variance[i, j] = prior - BETWEEN * BETWEEN * (prior - variance / total)
