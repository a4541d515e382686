"""The form in which a contact map crosses the network: what a force can be computed from, and nothing else."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import kernel
from foretouch.core.compiling import compiled, inlined
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.kernel import cubic
from foretouch.models.contact_map.layout import COARSE, FINE, HEADER, SIZE, Grid, Map

Flags = NDArray[np.int8]


@inlined
def mark_part(learnt: Map, grid: Grid, begin: int, needed: Flags) -> int:
    """`mark` the part of one grid, which begins at an index, and return where it ends."""
    knots = begin + 2 * grid.features
    needed[begin:knots] = 1
    first, last = learnt.lowest, learnt.reached
    low = cubic(first, grid.spacing, grid.below, grid.knots)[0]
    high = cubic(last, grid.spacing, grid.below, grid.knots)[0] + 4
    needed[knots + low : knots + high] = 1
    low = cubic(first, grid.feature_spacing, grid.feature_below, grid.feature_knots)[0]
    high = cubic(last, grid.feature_spacing, grid.feature_below, grid.feature_knots)[0] + 4
    for f in range(grid.features):
        feature = knots + grid.knots + f * grid.feature_knots
        needed[feature + low : feature + high] = 1
    return knots + grid.size


@compiled
def mark(maps: NDArray[np.void], needed: Flags) -> None:
    """Mark the numbers that a force can be computed from: a header, and the knots around the positions visited.

    A fine map without weight is left out.
    """
    learnt = maps[0]
    needed[:] = 0
    needed[:HEADER] = 1
    end = mark_part(learnt, COARSE, HEADER, needed)
    if learnt.shares[2] > 0.0:
        mark_part(learnt, FINE, end, needed)


@compiled
def is_sensible(maps: NDArray[np.void]) -> bool:
    """Whether the numbers before the coarse map can be those of a model."""
    learnt, numbers = maps[0], maps.view(np.float64)
    for k in range(HEADER):
        if not math.isfinite(numbers[k]):
            return False
    total, good = 0.0, learnt.law_speed >= 0.0
    for k in range(layout.EXPERTS):
        total += learnt.shares[k]
        good = good and learnt.shares[k] >= 0.0
    for k in range(4):
        good = good and learnt.law[k] >= 0.0
    for k in range(layout.UNCERTAINTIES):
        good = good and learnt.uncertainty[k] >= 0.0
    return good and abs(total - 1.0) < 1e-3 and learnt.lowest <= learnt.reached


def pack(maps: NDArray[np.void]) -> bytes:
    """The numbers that a force can be computed from, less those of the law, as 32-bit floats, little-endian."""
    rounded, needed = maps.copy(), np.empty(SIZE, np.int8)
    rounded[0].law[:] = 0.0
    numbers = rounded.view(np.float64)
    # What is rounded decides which knots are needed, so it is rounded first.
    numbers[:] = numbers.astype(np.float32)
    mark(rounded, needed)
    return numbers[needed > 0].astype("<f4").tobytes()


@kernel("b1(Map[::1], f4[::1])")
def fill(maps: NDArray[np.void], short: NDArray[np.float32]) -> bool:
    """Write packed numbers into a new map; whether they are one."""
    if not HEADER <= short.size <= SIZE:
        return False
    numbers, needed = maps.view(np.float64), np.empty(SIZE, np.int8)
    for k in range(HEADER):
        numbers[k] = short[k]
    if not is_sensible(maps):
        return False
    mark(maps, needed)
    at = 0
    for k in range(SIZE):
        if needed[k] > 0:
            if at == short.size or not math.isfinite(short[at]):
                return False
            numbers[k] = short[at]
            at += 1
    return at == short.size


def unpack(content: bytes) -> NDArray[np.void] | None:
    """The map of packed bytes, an array of one; None where they are none."""
    if len(content) % 4:
        return None
    maps = Map.new()
    return maps if fill.entry(maps, np.frombuffer(content, dtype="<f4")) else None
