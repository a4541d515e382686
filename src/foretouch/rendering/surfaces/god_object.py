"""The god object on a triangle mesh, compiled.

In contact the proxy is where the distance to the probe has a minimum, downhill on the surface from where it was: from
the nearest point of its triangle, if that is on an edge or corner, it goes on to the triangle there that comes nearest,
as long as one comes nearer. Distances to a triangle are convex, so every step is a way down within one triangle; none
is seen twice. On a flat face one plane holds the proxy, in a concave edge two, in a concave corner three; over a convex
edge it slides. Contact ends where the probe is outside of what the proxy is on.

References:
    Zilles and Salisbury (1995), A constraint-based god-object method for haptic display, IEEE/RSJ IROS.
    Ho, Basdogan and Srinivasan (1999), Efficient point-based rendering techniques for haptic display of virtual
    objects, Presence 8(5): the walk over neighbours.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.rendering.surfaces.boxes import find_crossing, find_nearest
from foretouch.rendering.surfaces.triangle_kernel import EDGE_NORMALS, FACE, NORMAL, VERTEX_NORMALS, nearest, side

Array = NDArray[np.float64]
Ints = NDArray[np.int32]

NEIGHBOURS, BORDER_CORNERS, LINKS = 3, 6, 9
"""In a row of links: three corners, the neighbours beyond the three edges (-1: none), whether the corners are on a
border, and how long a row is."""

STATE = 0  # one of the next
UNKNOWN, FREE, TOUCHING = 0.0, 1.0, 2.0
PLACE_AT = 1  # of the probe
POINT_AT, TRIANGLE_AT, NORMAL_AT, DEPTH = 4, 7, 8, 11
IN_FRONT = 12  # 1 where a free probe was on the outward side of the surface, not beyond its border
MEMORY = 13

ROUNDS = 100
"""Largest number of triangles that the proxy passes in one tick; then it waits there, in contact, for the next."""

PASSES = 3
"""Largest number of entries tested in one tick: a fast probe may cut a corner and come in behind it."""

NUDGE = 1e-9
"""Distance outside the former position at which an entry begins [m]: rounding may have put it below the surface."""

NO_DIRECTION = 1e-7
"""Distance from the surface below which the direction to it is rounding [m]; the normal of the surface counts."""

Spot = tuple[int, float, float, float, float, int]
"""A triangle, the squared distance to it [m^2], its nearest point [m] and the feature that this is on."""


@compiled
def _spot(triangles: Array, triangle: int, x: float, y: float, z: float) -> Spot:
    distance, px, py, pz, feature = nearest(triangles[triangle], x, y, z)
    return triangle, distance, px, py, pz, feature


@compiled
def _walk(
    triangles: Array, links: Ints, starts: Ints, fans: Ints, triangle: int, x: float, y: float, z: float
) -> tuple[Spot, bool]:
    """Downhill from a triangle; and whether it came to a minimum."""
    here = _spot(triangles, triangle, x, y, z)
    for _ in range(ROUNDS):
        best = here
        feature = here[5]
        if feature == FACE:
            return here, True
        if feature >= 3:
            neighbour = links[here[0], NEIGHBOURS + feature - 3]
            if neighbour >= 0:
                there = _spot(triangles, neighbour, x, y, z)
                if there[1] < best[1]:
                    best = there
        else:
            corner = links[here[0], feature]
            for i in range(starts[corner], starts[corner + 1]):
                there = _spot(triangles, fans[i], x, y, z)
                if there[1] < best[1]:
                    best = there
        if best[0] == here[0]:
            return here, True
        here = best
    return here, False


@compiled
def _on_border(links: Ints, spot: Spot) -> bool:
    """Whether the nearest point is on the border of an open surface: then the probe is beside it."""
    if spot[5] < 3:
        return bool(links[spot[0], BORDER_CORNERS + spot[5]] != 0)
    return bool(spot[5] < FACE and links[spot[0], NEIGHBOURS + spot[5] - 3] < 0)


@compiled
def _is_inside(triangles: Array, spot: Spot, x: float, y: float, z: float) -> bool:
    """Whether the probe is on the inner side of what its nearest point is on."""
    return side(triangles[spot[0]], spot[5], x - spot[2], y - spot[3], z - spot[4]) < 0.0


@compiled
def _remember(triangles: Array, memory: Array, spot: Spot, touching: bool, x: float, y: float, z: float) -> None:
    """Write the positions of probe and proxy into the memory."""
    sign = 1.0 if touching else -1.0
    distance = math.sqrt(spot[1])
    memory[STATE] = TOUCHING if touching else FREE
    memory[PLACE_AT], memory[PLACE_AT + 1], memory[PLACE_AT + 2] = x, y, z
    memory[POINT_AT], memory[POINT_AT + 1], memory[POINT_AT + 2] = spot[2], spot[3], spot[4]
    memory[TRIANGLE_AT] = spot[0]
    memory[DEPTH] = sign * distance
    if distance > NO_DIRECTION:
        scale = sign / distance
        memory[NORMAL_AT] = scale * (spot[2] - x)
        memory[NORMAL_AT + 1] = scale * (spot[3] - y)
        memory[NORMAL_AT + 2] = scale * (spot[4] - z)
        return
    at = NORMAL
    if spot[5] < 3:
        at = VERTEX_NORMALS + 3 * spot[5]
    elif spot[5] < FACE:
        at = EDGE_NORMALS + 3 * (spot[5] - 3)
    for k in range(3):
        memory[NORMAL_AT + k] = triangles[spot[0], at + k]


@compiled
def _enter(
    triangles: Array,
    links: Ints,
    starts: Ints,
    fans: Ints,
    boxes: Array,
    order: Ints,
    memory: Array,
    start: tuple[float, float, float],
    x: float,
    y: float,
    z: float,
) -> bool:
    """Look for the first way in from a free place to the probe; write it down, and say whether there is one."""
    for _ in range(PASSES):
        way = (x - start[0], y - start[1], z - start[2])
        found, _ = find_crossing(triangles, boxes, order, start, way)
        if found < 0:
            return False
        spot, ended = _walk(triangles, links, starts, fans, found, x, y, z)
        if not ended or (_is_inside(triangles, spot, x, y, z) and not _on_border(links, spot)):
            _remember(triangles, memory, spot, True, x, y, z)
            return True
        t = triangles[spot[0]]  # in and out again within one tick: on from where it came out
        start = (
            spot[2] + NUDGE * t[NORMAL],
            spot[3] + NUDGE * t[NORMAL + 1],
            spot[4] + NUDGE * t[NORMAL + 2],
        )
    return False


@compiled
def follow(
    triangles: Array,
    links: Ints,
    starts: Ints,
    fans: Ints,
    boxes: Array,
    order: Ints,
    closed: bool,
    memory: Array,
    x: float,
    y: float,
    z: float,
) -> None:
    """Move the probe on to a place, and the proxy after it.

    Args:
        triangles: Rows of `triangle_kernel`, of shape (n, 30).
        links: Rows of `LINKS`, of shape (n, 9).
        starts: Where in `fans` the triangles about each corner begin, one more than there are corners.
        fans: Those triangles.
        boxes: From `build_boxes`.
        order: From `build_boxes`.
        closed: Whether there is no border.
        memory: Of shape (13,), all 0 at first; written.
        x: Coordinate of the probe [m], finite.
        y: Coordinate of the probe [m], finite.
        z: Coordinate of the probe [m], finite.
    """
    start = (
        memory[PLACE_AT] + NUDGE * memory[NORMAL_AT],
        memory[PLACE_AT + 1] + NUDGE * memory[NORMAL_AT + 1],
        memory[PLACE_AT + 2] + NUDGE * memory[NORMAL_AT + 2],
    )
    state, last = memory[STATE], int(memory[TRIANGLE_AT])
    near = False  # whether something may have been crossed on the way
    in_front = state == UNKNOWN or memory[IN_FRONT] > 0.0
    if state == TOUCHING:
        spot, ended = _walk(triangles, links, starts, fans, last, x, y, z)
        if not ended or (_is_inside(triangles, spot, x, y, z) and not _on_border(links, spot)):
            _remember(triangles, memory, spot, True, x, y, z)
            return
        t = triangles[spot[0]]
        start = (
            spot[2] + NUDGE * t[NORMAL],
            spot[3] + NUDGE * t[NORMAL + 1],
            spot[4] + NUDGE * t[NORMAL + 2],
        )
        last, near, in_front = spot[0], True, not _on_border(links, spot)
    elif state == FREE:
        dx, dy, dz = x - memory[PLACE_AT], y - memory[PLACE_AT + 1], z - memory[PLACE_AT + 2]
        room = -memory[DEPTH] - 2.0 * NUDGE
        near = room <= 0.0 or dx * dx + dy * dy + dz * dz >= room * room
    if near and _enter(triangles, links, starts, fans, boxes, order, memory, start, x, y, z):
        return
    found, _ = find_nearest(triangles, boxes, order, x, y, z, last)
    spot = _spot(triangles, found, x, y, z)
    border = _on_border(links, spot)
    inside = _is_inside(triangles, spot, x, y, z)
    _remember(triangles, memory, spot, inside and not border and (closed or in_front), x, y, z)
    memory[IN_FRONT] = 0.0 if border or inside else 1.0
