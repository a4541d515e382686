"""One tick of `foretouch.session.proven_way.ProvenWay`, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.session.proven_way import CELL, CELLS, CONTRADICTED, GROWTH, LARGEST_STEP, LEAST_FORCE, MEAN

__all__ = ["SIZE", "forget_way", "observe_way", "proven_force", "proven_speed"]

Array = NDArray[np.float64]

SEEN, AT, PLACE, TIME = 0, 1, 2, 3
"""Places in the array: samples in the ring, at most `MEAN`; where the next goes; the newest mean position [m], NaN for
none; and the time of it [s]."""

IN_EDGE, IN_TIME, LARGEST = 4, 5, 6
"""The edge that was crossed last on the way in, by number, NaN for none; when [s]; and the largest force since [N]."""

OUT_EDGE, LEAST = 7, 8
"""The same of the way out, and the least force since [N]."""

POSITIONS, FORCES = 9, 9 + MEAN
"""Rings of the newest samples [m, N]."""

NUMBERS = FORCES + MEAN
"""Number of the cell that is kept in each place, NaN for none; then u [m/s], F and E [N] of them."""

SPEEDS, HIGHEST, LOWEST = NUMBERS + CELLS, NUMBERS + 2 * CELLS, NUMBERS + 3 * CELLS

SIZE = NUMBERS + 4 * CELLS

FARTHEST = 1e6
"""No robot is further out than this [m]: the numbers of its cells would be none."""


@compiled
def _set_out(way: Array) -> None:
    """What comes is no motion from what was."""
    way[SEEN] = way[AT] = 0.0
    way[PLACE] = way[IN_EDGE] = way[OUT_EDGE] = math.nan
    way[LARGEST] = way[LEAST] = 0.0


@compiled("void(f8[::1])")
def forget_way(way: Array) -> None:
    """See `ProvenWay.forget`."""
    way[TIME] = 0.0
    way[NUMBERS:SPEEDS] = math.nan
    _set_out(way)


@compiled
def _predicted(speed: float, highest: float, lowest: float, at: float) -> float:
    """Largest force at another speed [N]."""
    return highest + max(highest - lowest, LEAST_FORCE) * max(at / speed - 1.0, 0.0)


@compiled
def _allowed(speed: float, highest: float, lowest: float, allowed: float) -> float:
    """Speed at which no more than what is allowed is felt [m/s]."""
    spare = max(allowed - highest, 0.0) / max(highest - lowest, LEAST_FORCE)
    return speed * min(1.0 + spare, GROWTH)


@compiled
def _crossed(way: Array, cell: float, speed: float, force: float) -> None:
    """Take a crossing of a whole cell on the way in."""
    at = int(cell) % CELLS
    if way[NUMBERS + at] == cell:
        known, highest = way[SPEEDS + at], way[HIGHEST + at]
        most = CONTRADICTED * _predicted(known, highest, way[LOWEST + at], speed) + LEAST_FORCE
        least = highest * min(speed / known, 1.0) / CONTRADICTED - LEAST_FORCE
        if not least <= force <= most:
            way[LOWEST + at] = 0.0
        elif speed < known:
            return
    else:
        way[NUMBERS + at], way[LOWEST + at] = cell, 0.0
    way[SPEEDS + at], way[HIGHEST + at] = speed, force


@compiled
def _go_in(way: Array, before: float, place: float, period: float, largest: float) -> None:
    """The mean position has grown: cells may have been crossed."""
    edge, last = math.floor(before / CELL) + 1.0, math.floor(place / CELL)
    while edge <= last:
        time = way[TIME] + period * (edge * CELL - before) / (place - before)
        if way[IN_EDGE] == edge - 1.0:
            _crossed(way, edge - 1.0, CELL / (time - way[IN_TIME]), way[LARGEST])
        way[IN_EDGE], way[IN_TIME], way[LARGEST] = edge, time, largest
        way[OUT_EDGE] = math.nan
        edge += 1.0


@compiled
def _go_out(way: Array, before: float, place: float, least: float) -> None:
    """The mean position has shrunk: what a cell gives back bounds what is elastic in it."""
    edge, last = math.ceil(before / CELL) - 1.0, math.ceil(place / CELL)
    while edge >= last:
        at = int(edge) % CELLS
        if way[OUT_EDGE] == edge + 1.0 and way[NUMBERS + at] == edge:
            way[LOWEST + at] = max(way[LEAST], 0.0)
        way[OUT_EDGE], way[LEAST] = edge, least
        if way[IN_EDGE] >= edge:
            way[IN_EDGE] = math.nan
        edge -= 1.0


@compiled("void(f8[::1], f8, f8, f8)")
def observe_way(way: Array, position: float, force: float, period: float) -> None:
    """See `ProvenWay.observe`; the array is written."""
    if not abs(position) < FARTHEST:
        return
    at = int(way[AT])
    if way[SEEN] > 0.0 and abs(position - way[POSITIONS + (at + MEAN - 1) % MEAN]) > LARGEST_STEP:
        _set_out(way)
        at = 0
    before = way[PLACE]
    way[POSITIONS + at], way[FORCES + at] = position, force
    way[AT] = float((at + 1) % MEAN)
    way[SEEN] = min(way[SEEN] + 1.0, float(MEAN))
    if way[SEEN] < MEAN:
        return
    place, largest, least = 0.0, way[FORCES], way[FORCES]
    for index in range(MEAN):
        place += way[POSITIONS + index] / MEAN
        largest = max(largest, way[FORCES + index])
        least = min(least, way[FORCES + index])
    way[LARGEST], way[LEAST] = max(way[LARGEST], largest), min(way[LEAST], least)
    if place > before:
        _go_in(way, before, place, period, largest)
    elif place < before:
        _go_out(way, before, place, least)
    way[PLACE] = place
    way[TIME] += period


@compiled("f8(f8[::1], f8, f8)")
def proven_speed(way: Array, position: float, allowed: float) -> float:
    """See `ProvenWay.speed`; 0 where nothing is proven."""
    if not abs(position) < FARTHEST:
        return 0.0
    cell = math.floor(position / CELL)
    at = int(cell) % CELLS
    if way[NUMBERS + at] != cell:
        return 0.0
    return float(_allowed(way[SPEEDS + at], way[HIGHEST + at], way[LOWEST + at], allowed))


@compiled("f8(f8[::1], f8)")
def proven_force(way: Array, position: float) -> float:
    """Largest force when the cell of a place was crossed [N]; 0 where nothing is proven."""
    if not abs(position) < FARTHEST:
        return 0.0
    cell = math.floor(position / CELL)
    at = int(cell) % CELLS
    return float(way[HIGHEST + at]) if way[NUMBERS + at] == cell else 0.0
