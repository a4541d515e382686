"""Compiled geometry of one triangle: its nearest point, and where a segment crosses it."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled
from foretouch.quantities import pose
from foretouch.quantities.pose import Vector

FACE = 6  # Index of the feature that is neither corner nor edge
OVERLAP = 1e-9  # a segment through the very edge of two triangles is seen by both: no gap to fall through


class Triangle(Record):
    """A triangle of a mesh. Its features: 0 to 2 are the corners, 3 to 5 the edges from corner 0, 1, 2 on, 6 its face.

    The normals of the features tell inside from outside.
    """

    corners: Annotated[NDArray[np.float64], float, (3, 3)]  # [m]
    normals: Annotated[NDArray[np.float64], float, (7, 3)]  # of the features, outwards
    vertices: Annotated[NDArray[np.int64], int, 3]  # numbers of the corners in the mesh
    neighbours: Annotated[NDArray[np.int64], int, 3]  # triangles beyond the edges, -1 for none
    border: Annotated[NDArray[np.int64], int, 7]  # 1 for the features on the border of an open mesh


add = compiled(pose.add)
dot = compiled(pose.dot)
scaled = compiled(pose.scaled)
subtract = compiled(pose.subtract)


@compiled
def vector(numbers: NDArray[np.float64]) -> Vector:
    """Three numbers of an array."""
    return float(numbers[0]), float(numbers[1]), float(numbers[2])


@compiled
def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def nearest(triangle: Triangle, place: Vector) -> tuple[float, Vector, int]:
    """Nearest point of a triangle: its squared distance [m^2], the point [m] and the feature that it is on.

    References:
        Ericson (2005), Real-Time Collision Detection, section 5.1.5.
    """
    a, b, c = vector(triangle.corners[0]), vector(triangle.corners[1]), vector(triangle.corners[2])
    ab, ac = subtract(b, a), subtract(c, a)
    ap, bp, cp = subtract(place, a), subtract(place, b), subtract(place, c)
    d1, d2, d3, d4, d5, d6 = dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp)
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
    point = add(add(a, scaled(ab, v)), scaled(ac, w))
    away = subtract(place, point)
    return dot(away, away), point, feature


@compiled
def side(triangle: Triangle, feature: int, away: Vector) -> float:
    """Positive where a point this far away from its nearest point is outside, by the feature's normal.

    References:
        Baerentzen and Aanaes (2005), Signed distance computation using the angle weighted pseudonormal, IEEE
        Transactions on Visualization and Computer Graphics 11(3).
    """
    return dot(vector(triangle.normals[feature]), away)


@compiled
def crossing(triangle: Triangle, start: Vector, step: Vector) -> float:
    """Fraction of a step from a place at which it enters through the triangle; 2 if never. From behind it never does.

    References:
        Moeller and Trumbore (1997), Fast, minimum storage ray-triangle intersection, Journal of Graphics Tools 2(1).
    """
    if dot(vector(triangle.normals[FACE]), step) >= 0.0:
        return 2.0
    corner = vector(triangle.corners[0])
    one, other = subtract(vector(triangle.corners[1]), corner), subtract(vector(triangle.corners[2]), corner)
    h = _cross(step, other)
    determinant = dot(one, h)
    if determinant == 0.0:
        return 2.0
    scale, away = 1.0 / determinant, subtract(start, corner)
    q = _cross(away, one)
    u, v, fraction = scale * dot(away, h), scale * dot(step, q), scale * dot(other, q)
    if u < -OVERLAP or v < -OVERLAP or u + v > 1.0 + OVERLAP or fraction < 0.0 or fraction > 1.0:
        return 2.0
    return fraction
