"""The form in which a contact map crosses the network: what a force can be computed from, and nothing else."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined, kernel
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.kernel import cubic
from foretouch.models.contact_map.layout import COARSE, FINE, HEADER, SIZE, Grid, Map

Flags = NDArray[np.int8]
Short = NDArray[np.float32]


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


@kernel("i8(Map[::1], Map[::1], f4[::1])")
def shrink(maps: NDArray[np.void], sent: NDArray[np.void], short: Short) -> int:
    """Write the map as `unpack` gives it, but for what a force is not computed from, and `pack`'s numbers: how many."""
    numbers, rounded, needed = maps.view(np.float64), sent.view(np.float64), np.empty(SIZE, np.int8)
    for k in range(SIZE):  # what is rounded decides which knots are needed, so it is rounded first
        rounded[k] = np.float32(numbers[k])
    sent[0].law[:] = 0.0
    mark(sent, needed)
    count = 0
    for k in range(SIZE):
        if needed[k] > 0:
            short[count] = np.float32(rounded[k])
            count += 1
    return count


@kernel("b1(f4[::1], Map[::1])")
def expand(short: Short, maps: NDArray[np.void]) -> bool:
    """Write the map of these numbers, at least a header's; whether they are those of one."""
    numbers, needed = maps.view(np.float64), np.empty(SIZE, np.int8)
    numbers[:] = 0.0
    for k in range(short.size):
        if not math.isfinite(short[k]):
            return False
    for k in range(HEADER):
        numbers[k] = short[k]
    if not is_sensible(maps):
        return False
    mark(maps, needed)
    count = 0
    for k in range(SIZE):
        if needed[k] > 0:
            if count < short.size:
                numbers[k] = short[count]
            count += 1
    return bool(count == short.size)


def pack(maps: NDArray[np.void]) -> bytes:
    """The numbers that a force can be computed from, less those of the law, as 32-bit floats, little-endian."""
    short = np.empty(SIZE, np.float32)
    count = shrink.entry(maps, np.empty(1, Map.layout), short)
    return short[:count].astype("<f4", copy=False).tobytes()


def unpack(content: bytes) -> NDArray[np.void] | None:
    """The map of packed bytes, an array of one; None where they are none."""
    if len(content) % 4 or not HEADER <= len(content) // 4 <= SIZE:
        return None
    short, maps = np.frombuffer(content, "<f4").astype(np.float32, copy=False), np.empty(1, Map.layout)
    return maps if expand.entry(short, maps) else None
