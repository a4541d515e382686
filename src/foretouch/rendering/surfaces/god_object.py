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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces.geometry import (
    FACE,
    Array,
    Ints,
    Numbers3,
    Triangle,
    add,
    dot,
    find_crossing,
    find_nearest,
    nearest,
    scaled,
    side,
    subtract,
    vector,
    write,
)


class Mesh(NamedTuple):
    """A mesh as the god object walks on it; a plane has no triangles.

    Attributes:
        triangles: One `Triangle` each.
        starts: Where in `fans` the triangles about each corner begin, one more than there are corners.
        fans: Those triangles.
        boxes: From `build_boxes`.
        order: From `build_boxes`.
        closed: Whether there is no border.
    """

    triangles: NDArray[np.void]
    starts: Ints
    fans: Ints
    boxes: Array
    order: Ints
    closed: bool


MESH = "NamedTuple((Triangle[::1], i4[::1], i4[::1], f8[:, ::1], i4[::1], b1), Mesh)"
"""The types of a `Mesh`, for a kernel."""

NO_MESH = Mesh(
    Triangle.new(0), np.zeros(1, np.int32), np.zeros(0, np.int32), np.zeros((0, 6)), np.zeros(0, np.int32), False
)

UNKNOWN, FREE, TOUCHING = range(3)


class Proxy(Record):
    """The god object and the probe that it follows; infinitely far outside before the first place."""

    state: int  # `UNKNOWN`, `FREE` or `TOUCHING`
    place: Numbers3  # of the probe [m]
    point: Numbers3 = math.nan  # type: ignore[assignment]  # of the proxy [m]
    triangle: int  # that it is on
    normal: Numbers3 = (0.0, 0.0, 1.0)  # type: ignore[assignment]
    depth: float = -math.inf  # [m]
    in_front: bool  # whether a free probe was on the outward side of the surface, not beyond its border


ROUNDS = 100
"""Largest number of triangles that the proxy passes in one tick; then it waits there, in contact, for the next."""

PASSES = 3  # Largest number of entries tested in one tick: a fast probe may cut a corner and come in behind it

NUDGE = 1e-9
"""Distance outside the former position at which an entry begins [m]: rounding may have put it below the surface."""

NO_DIRECTION = 1e-7
"""Distance from the surface below which the direction to it is rounding [m]; the normal of the surface counts."""

Spot = tuple[int, float, Vector, int]
"""A triangle, the squared distance to it [m^2], its nearest point [m] and the feature that this is on."""


@compiled
def _spot(mesh: Mesh, triangle: int, place: Vector) -> Spot:
    distance, point, feature = nearest(mesh.triangles[triangle], place)
    return triangle, distance, point, feature


@compiled
def _walk(mesh: Mesh, triangle: int, place: Vector) -> tuple[Spot, bool]:
    """Downhill from a triangle; and whether it came to a minimum."""
    here = _spot(mesh, triangle, place)
    for _ in range(ROUNDS):
        best, feature, at = here, here[3], mesh.triangles[here[0]]
        if feature == FACE:
            return here, True
        if feature >= 3:
            neighbour = at.neighbours[feature - 3]
            if neighbour >= 0:
                there = _spot(mesh, neighbour, place)
                if there[1] < best[1]:
                    best = there
        else:
            corner = at.vertices[feature]
            for i in range(mesh.starts[corner], mesh.starts[corner + 1]):
                there = _spot(mesh, mesh.fans[i], place)
                if there[1] < best[1]:
                    best = there
        if best[0] == here[0]:
            return here, True
        here = best
    return here, False


@compiled
def _on_border(mesh: Mesh, spot: Spot) -> bool:
    """Whether the nearest point is on the border of an open surface: then the probe is beside it."""
    return bool(mesh.triangles[spot[0]].border[spot[3]])


@compiled
def _is_inside(mesh: Mesh, spot: Spot, place: Vector) -> bool:
    """Whether the probe is on the inner side of what its nearest point is on."""
    return side(mesh.triangles[spot[0]], spot[3], subtract(place, spot[2])) < 0.0


@compiled
def _holds(mesh: Mesh, spot: Spot, ended: bool, place: Vector) -> bool:
    """Whether a walk that came to this spot leaves the probe in contact."""
    return not ended or (_is_inside(mesh, spot, place) and not _on_border(mesh, spot))


@compiled
def _outside(mesh: Mesh, spot: Spot) -> Vector:
    """A place just outside a spot on the surface [m]."""
    return add(spot[2], scaled(vector(mesh.triangles[spot[0]].normals[FACE]), NUDGE))


@compiled
def _remember(mesh: Mesh, proxy: Proxy, spot: Spot, touching: bool, place: Vector) -> None:
    """Write the positions of probe and proxy."""
    sign = 1.0 if touching else -1.0
    distance = math.sqrt(spot[1])
    proxy.state = TOUCHING if touching else FREE
    write(proxy.place, place)
    write(proxy.point, spot[2])
    proxy.triangle = spot[0]
    proxy.depth = sign * distance
    if distance > NO_DIRECTION:
        write(proxy.normal, scaled(subtract(spot[2], place), sign / distance))
    else:
        write(proxy.normal, vector(mesh.triangles[spot[0]].normals[spot[3]]))


@compiled
def _enter(mesh: Mesh, proxy: Proxy, start: Vector, place: Vector) -> bool:
    """Look for the first way in from a free place to the probe; write it down, and say whether there is one."""
    for _ in range(PASSES):
        result = find_crossing(mesh.triangles, mesh.boxes, mesh.order, start, subtract(place, start))
        if result < 0:
            return False
        spot, ended = _walk(mesh, result, place)
        if _holds(mesh, spot, ended, place):
            _remember(mesh, proxy, spot, True, place)
            return True
        start = _outside(mesh, spot)  # in and out again within one tick: on from where it came out
    return False


@compiled
def move(mesh: Mesh, proxy: Proxy, place: Vector) -> None:
    """Move the probe on to a place [m], finite, and the proxy after it."""
    start = add(vector(proxy.place), scaled(vector(proxy.normal), NUDGE))
    last = proxy.triangle
    near = False  # whether something may have been crossed on the way
    in_front = proxy.state == UNKNOWN or proxy.in_front
    if proxy.state == TOUCHING:
        spot, ended = _walk(mesh, last, place)
        if _holds(mesh, spot, ended, place):
            _remember(mesh, proxy, spot, True, place)
            return
        start = _outside(mesh, spot)
        last, near, in_front = spot[0], True, not _on_border(mesh, spot)
    elif proxy.state == FREE:
        moved = subtract(place, vector(proxy.place))
        room = -proxy.depth - 2.0 * NUDGE
        near = room <= 0.0 or dot(moved, moved) >= room * room
    if near and _enter(mesh, proxy, start, place):
        return
    spot = _spot(mesh, find_nearest(mesh.triangles, mesh.boxes, mesh.order, place, last), place)
    border, inside = _on_border(mesh, spot), _is_inside(mesh, spot, place)
    _remember(mesh, proxy, spot, inside and not border and (mesh.closed or in_front), place)
    proxy.in_front = not (border or inside)


@kernel(f"Tuple((f8, UniTuple(f8, 3), UniTuple(f8, 3), i8))({MESH}, Proxy[::1], f8, f8, f8)")
def follow(mesh: Mesh, proxies: NDArray[np.void], x: float, y: float, z: float) -> tuple[float, Vector, Vector, int]:
    """`move`; then depth [m], normal, point [m] and triangle."""
    proxy = proxies[0]
    move(mesh, proxy, (x, y, z))
    return float(proxy.depth), vector(proxy.normal), vector(proxy.point), int(proxy.triangle)
