"""What the robot's own motion has proven of its path into a material, cell by cell, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

Array = NDArray[np.float64]

CELL = 2.5e-4
"""Length of a cell of the path [m]: a count of 15 um that flickers is 6 % of it, and a millimetre has four."""

CELLS = 1024
"""Number of cells remembered, 256 mm; the newest replace those as far away as the whole memory."""

MEAN = 10
"""Number of ticks over which positions are averaged and the largest force is taken: noise is no motion, and sensors
are late."""

LARGEST_STEP = 2e-3
"""Step of the position in one tick above which it is another position, and no motion to it [m]."""

GROWTH = 4.0
"""Largest ratio of the allowed speed to that of the crossing that is kept, the fastest: no law is trusted further."""

CONTRADICTED = 1.2
"""Ratio of a force to the proven one above which it replaces it."""

LEAST_FORCE = 0.25
"""Least force with which damping is computed [N]: the sensor's zero errs."""


class ProvenWay:
    r"""Remembers how fast the robot has gone in through each cell of its path, and what forces it felt.

    A cell crossed at the mean speed u, with at most the force F in it, and at least the force E on leaving through it,
    bounds the force at any other speed v there:

    .. math:: F(v) \le F + (F - E) \max(v / u - 1, 0)

    for a material whose force is elastic, E(x) or more, and damped in proportion to speed, or less; and for linear
    viscoelastic ones at a steady speed. So it may cross the cell at

    .. math:: w = u \Big(1 + \frac{F_a - F}{F - E}\Big) \le 4 u

    with F_a the force that may be reached, and no faster than u where F is above F_a. Position is the mean of ten
    measured ones, and speed that over a whole cell: a command, or an encoder's noise in one tick, proves nothing. A
    cell that was never crossed, from its outer to its inner end, proves nothing. A crossing that felt 1.2 times the
    proven force, or as much less than the bound, replaces the proven one: it is another material. Else the fastest is
    kept.

    Args:
        numbers: Array that holds its numbers, shared with others, shape
            (`foretouch.session.safety.proven_way.SIZE`,); None for an array of its own.
    """

    __slots__ = ("_numbers",)

    def __init__(self, numbers: Array | None = None) -> None:
        self._numbers = np.zeros(SIZE) if numbers is None else numbers
        self.forget()

    def forget(self) -> None:
        """Forget all that was proven: it is another point."""
        forget_way(self._numbers)

    def observe(self, position: float, force: float, period: float) -> None:
        """One sample of the sensors, finite.

        Args:
            position: Position of the robot [m].
            force: Measured force [N].
            period: Time since the previous sample [s].
        """
        observe_way(self._numbers, position, force, period)

    def speed(self, position: float, allowed: float) -> float:
        """Speed w at which the cell at a position may be crossed [m/s]; NaN where nothing is proven.

        Args:
            position: Position [m].
            allowed: F_a [N].
        """
        found = proven_speed(self._numbers, position, allowed)
        return found if found > 0.0 else math.nan


SEEN, AT, PLACE, TIME = 0, 1, 2, 3
"""Indices in the array: number of samples in the ring, at most `MEAN`; where the next goes; the newest mean position
[m], NaN for none; and the time of it [s]."""

IN_EDGE, IN_TIME, LARGEST = 4, 5, 6
"""Indices of the edge crossed last going in, by number, NaN for none; its time [s]; the largest force since [N]."""

OUT_EDGE, LEAST = 7, 8
"""Indices of the edge crossed last on leaving, NaN for none; and the least force since [N]."""

POSITIONS, FORCES = 9, 9 + MEAN
"""First indices of the rings of the newest samples [m, N]."""

NUMBERS = FORCES + MEAN
"""First index of the number of the cell kept in each slot, NaN for none; then of its u [m/s], F and E [N]."""

SPEEDS, HIGHEST, LOWEST = NUMBERS + CELLS, NUMBERS + 2 * CELLS, NUMBERS + 3 * CELLS

SIZE = NUMBERS + 4 * CELLS

FARTHEST = 1e6
"""Largest distance of a robot for which cells are numbered [m]."""


@compiled
def _set_out(way: Array) -> None:
    """Start again: the next sample is no motion from the last."""
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
    """Speed at which the force stays within the allowed one [m/s]."""
    spare = max(allowed - highest, 0.0) / max(highest - lowest, LEAST_FORCE)
    return speed * min(1.0 + spare, GROWTH)


@compiled
def _crossed(way: Array, cell: float, speed: float, force: float) -> None:
    """Take a crossing of a whole cell inwards."""
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
    """Take a mean position that has grown: cells may have been crossed."""
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
    """Take a mean position that has shrunk: the force on leaving a cell bounds its elastic part."""
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
    """Largest force when the cell at a position was crossed [N]; 0 where nothing is proven."""
    if not abs(position) < FARTHEST:
        return 0.0
    cell = math.floor(position / CELL)
    at = int(cell) % CELLS
    return float(way[HIGHEST + at]) if way[NUMBERS + at] == cell else 0.0
