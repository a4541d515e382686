"""What the robot's own motion has proven of its path into a material, cell by cell, compiled."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled

Array = NDArray[np.float64]

CELL = 2.5e-4
"""Length of a cell of the path [m]: a count of 15 um that flickers is 6 % of it, and a millimetre has four."""

CELLS = 1024  # Number of cells remembered, 256 mm; the newest replace those as far away as the whole memory

MEAN = 10
"""Number of ticks over which positions are averaged and the largest force is taken: noise is no motion, and sensors
are late."""

LARGEST_STEP = 2e-3
"""Step of the position in one tick above which it is another position, and no motion to it [m]."""

GROWTH = 4.0
"""Largest ratio of the allowed speed to that of the crossing that is kept, the fastest: no law is trusted further."""

CONTRADICTED = 1.2  # Ratio of a force to the proven one above which it replaces it
LEAST_FORCE = 0.25  # Least force with which damping is computed [N]: the sensor's zero errs


class ProvenWay(Record):
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
    """

    seen: int  # samples in the ring, at most `MEAN`
    at: int  # index of the next sample in the ring
    place: float = math.nan  # newest mean position [m], NaN for none
    time: float  # of that position [s]
    in_edge: float = math.nan  # number of the edge crossed last going in, NaN for none
    in_time: float  # of that crossing [s]
    largest: float  # force since then [N]
    out_edge: float = math.nan  # number of the edge crossed last on leaving, NaN for none
    least: float  # force since then [N]
    positions: Annotated[Array, float, MEAN]  # ring of the newest samples [m]
    forces: Annotated[Array, float, MEAN]  # [N]
    numbers: Annotated[Array, float, CELLS] = math.nan  # type: ignore[assignment]  # of the cell in each slot, or NaN
    speeds: Annotated[Array, float, CELLS]  # its u [m/s]
    highest: Annotated[Array, float, CELLS]  # its F [N]
    lowest: Annotated[Array, float, CELLS]  # its E [N]


FARTHEST = 1e6  # Largest distance of a robot for which cells are numbered [m]


@compiled
def _set_out(way: ProvenWay) -> None:
    """Start again: the next sample is no motion from the last."""
    way.seen = way.at = 0
    way.place = way.in_edge = way.out_edge = math.nan
    way.largest = way.least = 0.0


@compiled
def forget_way(way: ProvenWay) -> None:
    """Forget all that was proven: it is another point."""
    way.time = 0.0
    way.numbers[:] = math.nan
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
def _crossed(way: ProvenWay, cell: float, speed: float, force: float) -> None:
    """Take a crossing of a whole cell inwards."""
    at = int(cell) % CELLS
    if way.numbers[at] == cell:
        known, highest = way.speeds[at], way.highest[at]
        most = CONTRADICTED * _predicted(known, highest, way.lowest[at], speed) + LEAST_FORCE
        least = highest * min(speed / known, 1.0) / CONTRADICTED - LEAST_FORCE
        if not least <= force <= most:
            way.lowest[at] = 0.0
        elif speed < known:
            return
    else:
        way.numbers[at], way.lowest[at] = cell, 0.0
    way.speeds[at], way.highest[at] = speed, force


@compiled
def _go_in(way: ProvenWay, before: float, place: float, period: float, largest: float) -> None:
    """Take a mean position that has grown: cells may have been crossed."""
    edge, last = math.floor(before / CELL) + 1.0, math.floor(place / CELL)
    while edge <= last:
        time = way.time + period * (edge * CELL - before) / (place - before)
        if way.in_edge == edge - 1.0:
            _crossed(way, edge - 1.0, CELL / (time - way.in_time), way.largest)
        way.in_edge, way.in_time, way.largest = edge, time, largest
        way.out_edge = math.nan
        edge += 1.0


@compiled
def _go_out(way: ProvenWay, before: float, place: float, least: float) -> None:
    """Take a mean position that has shrunk: the force on leaving a cell bounds its elastic part."""
    edge, last = math.ceil(before / CELL) - 1.0, math.ceil(place / CELL)
    while edge >= last:
        at = int(edge) % CELLS
        if way.out_edge == edge + 1.0 and way.numbers[at] == edge:
            way.lowest[at] = max(way.least, 0.0)
        way.out_edge, way.least = edge, least
        if way.in_edge >= edge:
            way.in_edge = math.nan
        edge -= 1.0


@compiled
def observe_way(way: ProvenWay, position: float, force: float, period: float) -> None:
    """Take one sample of the sensors, finite.

    Args:
        way: Written.
        position: Position of the robot [m].
        force: Measured force [N].
        period: Time since the previous sample [s].
    """
    if not abs(position) < FARTHEST:
        return
    at = way.at
    if way.seen > 0 and abs(position - way.positions[(at + MEAN - 1) % MEAN]) > LARGEST_STEP:
        _set_out(way)
        at = 0
    before = way.place
    way.positions[at], way.forces[at] = position, force
    way.at = (at + 1) % MEAN
    way.seen = min(way.seen + 1, MEAN)
    if way.seen < MEAN:
        return
    point, largest, least = 0.0, way.forces[0], way.forces[0]
    for index in range(MEAN):
        point += way.positions[index] / MEAN
        largest = max(largest, way.forces[index])
        least = min(least, way.forces[index])
    way.largest, way.least = max(way.largest, largest), min(way.least, least)
    if point > before:
        _go_in(way, before, point, period, largest)
    elif point < before:
        _go_out(way, before, point, least)
    way.place = point
    way.time += period


@compiled
def proven_speed(way: ProvenWay, position: float, allowed: float) -> float:
    """Speed w at which the cell at a position may be crossed [m/s]; 0 where nothing is proven.

    Args:
        way: Proven until now.
        position: Position [m].
        allowed: F_a [N].
    """
    if not abs(position) < FARTHEST:
        return 0.0
    cell = math.floor(position / CELL)
    at = int(cell) % CELLS
    if way.numbers[at] != cell:
        return 0.0
    return float(_allowed(way.speeds[at], way.highest[at], way.lowest[at], allowed))


@compiled
def proven_force(way: ProvenWay, position: float) -> float:
    """Largest force when the cell at a position was crossed [N]; 0 where nothing is proven."""
    if not abs(position) < FARTHEST:
        return 0.0
    cell = math.floor(position / CELL)
    at = int(cell) % CELLS
    return float(way.highest[at]) if way.numbers[at] == cell else 0.0
