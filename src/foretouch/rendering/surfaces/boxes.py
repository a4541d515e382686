"""A balanced tree of boxes about triangles, so that few of them have to be looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.rendering.surfaces.triangle_kernel import crossing, nearest

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

LEAF = 4
"""Number of triangles in a box that is not divided."""

STACK = 64
"""Largest number of boxes waiting in a search: two for each level of the tree."""


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
        places = middle[grouped]
        axis = np.argmax(np.ptp(places, axis=1), axis=1)
        along = np.take_along_axis(places, axis[:, None, None], axis=2)[:, :, 0]
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
def _box_distance(box: Array, x: float, y: float, z: float) -> float:
    """Squared distance from a point to a box [m^2]."""
    dx = max(box[0] - x, 0.0, x - box[3])
    dy = max(box[1] - y, 0.0, y - box[4])
    dz = max(box[2] - z, 0.0, z - box[5])
    return float(dx * dx + dy * dy + dz * dz)


@compiled
def find_nearest(
    triangles: Array, boxes: Array, order: Ints, x: float, y: float, z: float, first: int
) -> tuple[int, float]:
    """The triangle nearest to a point, and its squared distance [m^2]; `first` is a guess."""
    best, found = nearest(triangles[first], x, y, z)[0], first
    stack = np.empty(STACK, np.int32)
    stack[0] = 0
    waiting = 1
    leaves = (boxes.shape[0] + 1) // 2
    while waiting > 0:
        waiting -= 1
        at = stack[waiting]
        if _box_distance(boxes[at], x, y, z) >= best:
            continue
        if at >= leaves - 1:
            for i in range((at - leaves + 1) * LEAF, (at - leaves + 2) * LEAF):
                distance = nearest(triangles[order[i]], x, y, z)[0]
                if distance < best:
                    best, found = distance, order[i]
            continue
        left = 2 * at + 1
        near_left = _box_distance(boxes[left], x, y, z)
        near_right = _box_distance(boxes[left + 1], x, y, z)
        far = left + 1 if near_left <= near_right else left
        stack[waiting] = far  # the nearer one is looked at first
        stack[waiting + 1] = 2 * left + 1 - far
        waiting += 2
    return found, best


@compiled
def _segment_meets(box: Array, at: tuple[float, float, float], way: tuple[float, float, float], until: float) -> bool:
    """Whether a segment meets a box before this fraction of it (slabs)."""
    enter, leave = 0.0, until
    for k in range(3):
        if way[k] == 0.0:
            if at[k] < box[k] or at[k] > box[k + 3]:
                return False
            continue
        scale = 1.0 / way[k]
        one, other = (box[k] - at[k]) * scale, (box[k + 3] - at[k]) * scale
        enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    return enter <= leave + 1e-9


@compiled
def find_crossing(
    triangles: Array,
    boxes: Array,
    order: Ints,
    at: tuple[float, float, float],
    way: tuple[float, float, float],
) -> tuple[int, float]:
    """First triangle that a segment enters through, and the fraction of it up to there; (-1, 2.0) if there is none."""
    best, found = 2.0, -1
    stack = np.empty(STACK, np.int32)
    stack[0] = 0
    waiting = 1
    leaves = (boxes.shape[0] + 1) // 2
    while waiting > 0:
        waiting -= 1
        box = stack[waiting]
        if not _segment_meets(boxes[box], at, way, min(best, 1.0)):
            continue
        if box >= leaves - 1:
            for i in range((box - leaves + 1) * LEAF, (box - leaves + 2) * LEAF):
                share = crossing(triangles[order[i]], at[0], at[1], at[2], way[0], way[1], way[2])
                if share < best:
                    best, found = share, order[i]
            continue
        stack[waiting] = 2 * box + 1
        stack[waiting + 1] = 2 * box + 2
        waiting += 2
    return found, best
