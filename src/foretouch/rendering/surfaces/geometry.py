"""Compiled geometry: vectors; the nearest point of a triangle, where a segment crosses it, and which of many that is.

A balanced tree of boxes about them leaves few to look at.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled
from foretouch.core.compiling import scratch
from foretouch.quantities import pose
from foretouch.quantities.pose import Vector

Array = NDArray[np.float64]
Numbers3 = Annotated[Array, float, 3]
Ints = NDArray[np.int32]

FACE = 6  # Index of the feature that is neither corner nor edge
OVERLAP = 1e-9  # a segment through the very edge of two triangles is seen by both: no gap to fall through


class Triangle(Record):
    """A triangle of a mesh. Its features: 0 to 2 are the corners, 3 to 5 the edges from corner 0, 1, 2 on, 6 its face.

    The normals of the features tell inside from outside.
    """

    corners: Annotated[Array, float, (3, 3)]  # [m]
    normals: Annotated[Array, float, (7, 3)]  # of the features, outwards
    vertices: Annotated[NDArray[np.int64], int, 3]  # numbers of the corners in the mesh
    neighbours: Annotated[NDArray[np.int64], int, 3]  # triangles beyond the edges, -1 for none
    border: Annotated[NDArray[np.int64], int, 7]  # 1 for the features on the border of an open mesh


add = compiled(pose.add)
dot = compiled(pose.dot)
scaled = compiled(pose.scaled)
norm = compiled(pose.norm)
subtract = compiled(pose.subtract)


@compiled
def vector(numbers: Array) -> Vector:
    """Three numbers of an array."""
    return float(numbers[0]), float(numbers[1]), float(numbers[2])


@compiled
def write(numbers: Array, values: Vector) -> None:
    """Write three numbers into an array."""
    numbers[0], numbers[1], numbers[2] = values


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


LEAF = 4  # Number of triangles in a box that is not divided
STACK = 64  # Largest number of boxes waiting in a search: two for each level of the tree


def build_boxes(corners: Array) -> tuple[Array, Ints]:
    """Boxes about triangles (n, 3, 3) [m], halved at the median of their longest side, level by level.

    Returns:
        The boxes as (lowest, highest corner) of shape (2 m - 1, 6), where those of box i are 2 i + 1 and 2 i + 2; and
        the triangles of its m leaves, `LEAF` each, of shape (m * LEAF,), some in two leaves.
    """
    count = len(corners)
    leaves = 1
    while leaves * LEAF < count:
        leaves *= 2
    middle = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
    order = np.resize(np.arange(count), leaves * LEAF)
    groups = 1
    while groups < leaves:
        grouped = order.reshape(groups, -1)
        positions = middle[grouped]
        axis = np.argmax(np.ptp(positions, axis=1), axis=1)
        along = np.take_along_axis(positions, axis[:, None, None], axis=2)[:, :, 0]
        order = np.take_along_axis(grouped, np.argsort(along, axis=1, kind="stable"), axis=1).ravel()
        groups *= 2
    members = corners[order].reshape(leaves, LEAF * 3, 3)
    boxes = np.empty((2 * leaves - 1, 6))
    boxes[leaves - 1 :] = np.concatenate([members.min(axis=1), members.max(axis=1)], axis=1)
    while leaves > 1:
        below = boxes[leaves - 1 : 2 * leaves - 1].reshape(leaves // 2, 2, 6)
        leaves //= 2
        boxes[leaves - 1 : 2 * leaves - 1] = np.concatenate(
            [below[:, :, :3].min(axis=1), below[:, :, 3:].max(axis=1)], axis=1
        )
    return boxes, order.astype(np.int32)


@compiled
def _box_distance(box: Array, place: Vector) -> float:
    """Squared distance from a point to a box [m^2]."""
    dx = max(box[0] - place[0], 0.0, place[0] - box[3])
    dy = max(box[1] - place[1], 0.0, place[1] - box[4])
    dz = max(box[2] - place[2], 0.0, place[2] - box[5])
    return float(dx * dx + dy * dy + dz * dz)


@compiled
def find_nearest(triangles: NDArray[np.void], boxes: Array, order: Ints, place: Vector, first: int) -> int:
    """The triangle nearest to a point; `first` is a guess."""
    best, result = nearest(triangles[first], place)[0], first
    stack = scratch(np.int32, STACK)
    stack[0] = 0
    waiting = 1
    leaves = (boxes.shape[0] + 1) // 2
    while waiting > 0:
        waiting -= 1
        at = stack[waiting]
        if _box_distance(boxes[at], place) >= best:
            continue
        if at >= leaves - 1:
            for i in range((at - leaves + 1) * LEAF, (at - leaves + 2) * LEAF):
                distance = nearest(triangles[order[i]], place)[0]
                if distance < best:
                    best, result = distance, order[i]
            continue
        left = 2 * at + 1
        near_left, near_right = _box_distance(boxes[left], place), _box_distance(boxes[left + 1], place)
        far = left + 1 if near_left <= near_right else left
        stack[waiting] = far  # the nearer one is looked at first
        stack[waiting + 1] = 2 * left + 1 - far
        waiting += 2
    return result


@compiled
def _segment_meets(box: Array, start: Vector, step: Vector, until: float) -> bool:
    """Whether a segment meets a box before this fraction of it (slabs)."""
    enter, leave = 0.0, until
    for k in range(3):
        if step[k] == 0.0:
            if start[k] < box[k] or start[k] > box[k + 3]:
                return False
            continue
        scale = 1.0 / step[k]
        one, other = (box[k] - start[k]) * scale, (box[k + 3] - start[k]) * scale
        enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    return enter <= leave + 1e-9


@compiled
def find_crossing(triangles: NDArray[np.void], boxes: Array, order: Ints, start: Vector, step: Vector) -> int:
    """First triangle that a segment enters through; -1 if there is none."""
    best, result = 2.0, -1
    stack = scratch(np.int32, STACK)
    stack[0] = 0
    waiting = 1
    leaves = (boxes.shape[0] + 1) // 2
    while waiting > 0:
        waiting -= 1
        box = stack[waiting]
        if not _segment_meets(boxes[box], start, step, min(best, 1.0)):
            continue
        if box >= leaves - 1:
            for i in range((box - leaves + 1) * LEAF, (box - leaves + 2) * LEAF):
                fraction = crossing(triangles[order[i]], start, step)
                if fraction < best:
                    best, result = fraction, order[i]
            continue
        stack[waiting] = 2 * box + 1
        stack[waiting + 1] = 2 * box + 2
        waiting += 2
    return result
