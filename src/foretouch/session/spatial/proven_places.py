"""What the robot has proven of its way into a material, kept for places that it comes back to, compiled."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces.geometry import Numbers3, norm, subtract, vector, write
from foretouch.session.safety.proven_way import CELLS, ProvenWay, forget_way

Array = NDArray[np.float64]

SAME_PLACE, SAME_HEIGHT = 3e-3, 1e-3
"""Distances within which a proven approach holds [m]: along the surface, half the radius of the tip, and of the
believed surface from its earlier position."""

PLACES = 128
"""Number of places that are kept, 36 cm^2 of the surface; the one that was left longest ago makes room."""


class ProvenPlaces(Record):
    """Remembers what `ProvenWay` has proven about the present point, and about those where the probe was before.

    A way holds within `SAME_PLACE` of the point of the surface, in the fixture's frame, where it was begun, as long as
    the believed surface stays within `SAME_HEIGHT` of where it was then. Where the surface was felt it is kept when the
    probe goes on, and comes back with it.
    """

    point: Numbers3 = math.nan  # type: ignore[assignment]  # about which the present way holds [m]
    offset: float  # of the line then [m]
    widest: float  # largest distance from it since [m]
    touched: bool  # whether the surface was felt since
    returned: bool  # whether the probe came back, and has not felt it since then
    slot: int = -1  # of the present place among the kept ones, -1 for none
    left: int  # number of places that were left
    leaves: Annotated[NDArray[np.int64], int, PLACES]  # that number when a place was left, 0 for none
    points: Annotated[Array, float, (PLACES, 3)]  # as above, of each
    offsets: Annotated[Array, float, PLACES]
    widths: Annotated[Array, float, PLACES]
    numbers: Annotated[Array, float, (PLACES, CELLS)]  # as in `ProvenWay`, of each
    speeds: Annotated[Array, float, (PLACES, CELLS)]
    highest: Annotated[Array, float, (PLACES, CELLS)]
    lowest: Annotated[Array, float, (PLACES, CELLS)]


@compiled
def forget_places(places: ProvenPlaces) -> None:
    """Forget all places but the present one."""
    places.leaves[:] = 0
    places.slot = -1


@compiled
def _keep(places: ProvenPlaces, way: ProvenWay) -> None:
    """Keep the present place, in its own slot or that of the one left longest ago."""
    slot = places.slot
    if slot < 0:
        slot = 0
        for other in range(1, PLACES):
            if places.leaves[other] < places.leaves[slot]:
                slot = other
    places.left += 1
    places.leaves[slot], places.offsets[slot], places.widths[slot] = places.left, places.offset, places.widest
    for axis in range(3):
        places.points[slot, axis] = places.point[axis]
    for cell in range(CELLS):
        places.numbers[slot, cell], places.speeds[slot, cell] = way.numbers[cell], way.speeds[cell]
        places.highest[slot, cell], places.lowest[slot, cell] = way.highest[cell], way.lowest[cell]


@compiled
def _nearest(places: ProvenPlaces, point: Vector, offset: float) -> int:
    """Slot of the nearest place that holds at a point, with the surface believed at an offset; -1 for none."""
    best, least = -1, SAME_PLACE
    for slot in range(PLACES):
        if places.leaves[slot] > 0 and abs(offset - places.offsets[slot]) <= SAME_HEIGHT:
            x, y, z = places.points[slot, 0], places.points[slot, 1], places.points[slot, 2]
            away = norm(subtract(point, (x, y, z)))
            if away <= least:
                best, least = slot, away
    return best


@compiled
def _come_back(places: ProvenPlaces, slot: int, way: ProvenWay) -> None:
    """Take up a place that is kept."""
    places.offset, places.widest = places.offsets[slot], places.widths[slot]
    places.touched = places.returned = True
    write(places.point, (places.points[slot, 0], places.points[slot, 1], places.points[slot, 2]))
    for cell in range(CELLS):
        way.numbers[cell], way.speeds[cell] = places.numbers[slot, cell], places.speeds[slot, cell]
        way.highest[cell], way.lowest[cell] = places.highest[slot, cell], places.lowest[slot, cell]


@compiled
def be_at(places: ProvenPlaces, way: ProvenWay, point: Vector, offset: float) -> float:
    """Take a point of the surface in the fixture's frame [m], and the believed surface's offset on the line [m].

    Returns:
        Its distance from the point about which the way holds [m].
    """
    aside = norm(subtract(point, vector(places.point)))
    if not (aside <= SAME_PLACE and abs(offset - places.offset) <= SAME_HEIGHT):
        if places.touched:
            _keep(places, way)
        forget_way(way)
        places.slot = _nearest(places, point, offset)
        if places.slot < 0:
            write(places.point, point)
            places.offset, places.widest = offset, 0.0
            places.touched = places.returned = False
        else:
            _come_back(places, places.slot, way)
        aside = norm(subtract(point, vector(places.point)))
    places.widest = max(places.widest, aside)
    return aside
