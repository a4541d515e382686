"""Compiled geometry of one triangle: its nearest point, and where a segment crosses it.

A triangle is a row of `SIZE` numbers: three corners, its normal, and the normals at its edges and corners, which tell
inside from outside. Its features: 0 to 2 are the corners, 3 to 5 the edges from corner 0, 1, 2 on, 6 is its inside.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

Array = NDArray[np.float64]

NORMAL, EDGE_NORMALS, VERTEX_NORMALS, SIZE = 9, 12, 21, 30
"""Where in a row the face's normal stands, the edges' and the corners', and how long a row is."""

FACE = 6
"""Index of the feature that is neither corner nor edge."""

_OVERLAP = 1e-9  # a segment through the very edge of two triangles is seen by both: no gap to fall through


@compiled
def nearest(t: Array, px: float, py: float, pz: float) -> tuple[float, float, float, float, int]:
    """Nearest point of a triangle: its squared distance [m^2], its coordinates [m] and the feature that it is on.

    References:
        Ericson (2005), Real-Time Collision Detection, section 5.1.5.
    """
    ax, ay, az = t[0], t[1], t[2]
    abx, aby, abz = t[3] - ax, t[4] - ay, t[5] - az
    acx, acy, acz = t[6] - ax, t[7] - ay, t[8] - az
    apx, apy, apz = px - ax, py - ay, pz - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    bpx, bpy, bpz = px - t[3], py - t[4], pz - t[5]
    d3 = abx * bpx + aby * bpy + abz * bpz
    d4 = acx * bpx + acy * bpy + acz * bpz
    cpx, cpy, cpz = px - t[6], py - t[7], pz - t[8]
    d5 = abx * cpx + aby * cpy + abz * cpz
    d6 = acx * cpx + acy * cpy + acz * cpz
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v = w = 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        feature = 0
    elif d3 >= 0.0 and d4 <= d3:
        feature, v = 1, 1.0
    elif d6 >= 0.0 and d5 <= d6:
        feature, w = 2, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        feature, v = 3, d1 / (d1 - d3)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        feature, w = 4, (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        feature, w = 5, d2 / (d2 - d6)
    else:
        feature = FACE
        scale = 1.0 / (va + vb + vc)
        v, w = vb * scale, vc * scale
    x = ax + v * abx + w * acx
    y = ay + v * aby + w * acy
    z = az + v * abz + w * acz
    dx, dy, dz = px - x, py - y, pz - z
    return dx * dx + dy * dy + dz * dz, x, y, z, feature


@compiled
def side(t: Array, feature: int, dx: float, dy: float, dz: float) -> float:
    """Positive where a point (dx, dy, dz) away from its nearest point is outside, by the feature's normal.

    References:
        Baerentzen and Aanaes (2005), Signed distance computation using the angle weighted pseudonormal, IEEE
        Transactions on Visualization and Computer Graphics 11(3).
    """
    at = NORMAL
    if feature < 3:
        at = VERTEX_NORMALS + 3 * feature
    elif feature < FACE:
        at = EDGE_NORMALS + 3 * (feature - 3)
    return float(t[at] * dx + t[at + 1] * dy + t[at + 2] * dz)


@compiled
def crossing(t: Array, x: float, y: float, z: float, dx: float, dy: float, dz: float) -> float:
    """Fraction of the segment from (x, y, z) along (dx, dy, dz) at which it enters through the triangle; 2 if never.

    From behind nothing is crossed.

    References:
        Moeller and Trumbore (1997), Fast, minimum storage ray-triangle intersection, Journal of Graphics Tools 2(1).
    """
    if t[NORMAL] * dx + t[NORMAL + 1] * dy + t[NORMAL + 2] * dz >= 0.0:
        return 2.0
    e1x, e1y, e1z = t[3] - t[0], t[4] - t[1], t[5] - t[2]
    e2x, e2y, e2z = t[6] - t[0], t[7] - t[1], t[8] - t[2]
    hx, hy, hz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
    determinant = e1x * hx + e1y * hy + e1z * hz
    if determinant == 0.0:
        return 2.0
    scale = 1.0 / determinant
    sx, sy, sz = x - t[0], y - t[1], z - t[2]
    u = scale * (sx * hx + sy * hy + sz * hz)
    qx, qy, qz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
    v = scale * (dx * qx + dy * qy + dz * qz)
    share = scale * (e2x * qx + e2y * qy + e2z * qz)
    if u < -_OVERLAP or v < -_OVERLAP or u + v > 1.0 + _OVERLAP or share < 0.0 or share > 1.0:
        return 2.0
    return float(share)
