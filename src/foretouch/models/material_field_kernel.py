"""The field of materials, compiled: which nodes are about a point, and their blend.

A node's key (i, j, k) is packed into one whole number that sorts as the key does.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

Array = NDArray[np.float64]
Codes = NDArray[np.int64]

CORNERS = 8  # Number of nodes about a point
NUMBERS = 4  # Numbers of a node: a, b, c of its law, and the standard deviation of its local stiffness
HALF = 32768  # Bound on the keys, which go from minus this to this, less one


@compiled
def cell_of(x: float, y: float, z: float, spacing: float, codes: Codes, weights: Array) -> None:
    """Find the eight nodes about a point, and their trilinear weights, which sum to 1."""
    limit = HALF - 2.0
    u, v, w = (
        min(max(x / spacing, -limit), limit),
        min(max(y / spacing, -limit), limit),
        min(max(z / spacing, -limit), limit),
    )
    i, j, k = math.floor(u), math.floor(v), math.floor(w)
    fu, fv, fw = u - i, v - j, w - k
    first = ((int(i) + HALF) << 32) | ((int(j) + HALF) << 16) | (int(k) + HALF)
    for corner in range(CORNERS):
        di, dj, dk = corner >> 2, (corner >> 1) & 1, corner & 1
        codes[corner] = first + (di << 32) + (dj << 16) + dk
        weights[corner] = (fu if di else 1.0 - fu) * (fv if dj else 1.0 - fv) * (fw if dk else 1.0 - fw)


@compiled
def blend(
    codes: Codes, values: Array, unknown: Array, spacing: float, x: float, y: float, z: float
) -> tuple[float, float, float, float, float]:
    """The law at a point: a, b, c, the standard deviation of its local stiffness, and the weight of the known nodes."""
    about, weights = np.empty(CORNERS, np.int64), np.empty(CORNERS)
    cell_of(x, y, z, spacing, about, weights)
    a = b = c = variance = known = 0.0
    for corner in range(CORNERS):
        weight = weights[corner]
        if weight <= 0.0:
            continue
        at = np.searchsorted(codes, about[corner])
        if at == codes.shape[0] or codes[at] != about[corner]:
            continue
        node = values[at]
        known += weight
        a += weight * node[0]
        b += weight * node[1]
        c += weight * node[2]
        variance += (weight * node[3]) ** 2
    missing = 1.0 - known if known < 1.0 else 0.0
    a += missing * unknown[0]
    b += missing * unknown[1]
    c += missing * unknown[2]
    return a, b, c, math.sqrt(variance + (missing * unknown[3]) ** 2), known


@compiled
def blend_many(codes: Codes, values: Array, unknown: Array, spacing: float, points: Array, out: Array) -> None:
    """`blend` at many points of shape (n, 3), written into out of shape (n, 5)."""
    for row in range(points.shape[0]):
        a, b, c, deviation, known = blend(
            codes, values, unknown, spacing, points[row, 0], points[row, 1], points[row, 2]
        )
        out[row, 0], out[row, 1], out[row, 2], out[row, 3], out[row, 4] = a, b, c, deviation, known
