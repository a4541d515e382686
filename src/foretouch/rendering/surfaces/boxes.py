"""A balanced tree of boxes about triangles, so that few of them have to be looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.core import compiled
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces.triangle_kernel import crossing, nearest

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

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
    stack = np.empty(STACK, np.int32)
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
    stack = np.empty(STACK, np.int32)
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
