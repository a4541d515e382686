"""The form in which a contact map crosses the network: what a force can be computed from, and nothing else."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined, kernel, scratch
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.kernel import cubic
from foretouch.models.contact_map.layout import COARSE, FINE, HEADER, SIZE, Grid, Map

Flags = NDArray[np.int8]
Short = NDArray[np.float32]
Law = tuple[float, float, float, float]


@inlined
def mark_part(learnt: Map, grid: Grid, place: float, begin: int, needed: Flags) -> int:
    """`mark` the part of one grid, which begins at an index, and return where it ends."""
    knots = begin + 2 * grid.features
    needed[begin:knots] = 1
    first, last = learnt.lowest - place, learnt.reached - place
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
    end = mark_part(learnt, COARSE, 0.0, HEADER, needed)
    if learnt.shares[2] > 0.0:
        mark_part(learnt, FINE, learnt.place, end, needed)


@compiled
def is_sensible(maps: NDArray[np.void]) -> bool:
    """Whether the numbers before the coarse map can be those of a model."""
    learnt, numbers = maps[0], maps.view(np.float64)
    for k in range(HEADER):
        if not math.isfinite(numbers[k]):
            return False
    total, good = 0.0, min(learnt.law_speed, learnt.felt, learnt.touch_way, learnt.touch_force, learnt.pull) >= 0.0
    for k in range(layout.EXPERTS):
        total += learnt.shares[k]
        good = good and learnt.shares[k] >= 0.0
    for k in range(4):
        good = good and learnt.law[k] >= 0.0
    for k in range(layout.UNCERTAINTIES):
        good = good and learnt.uncertainty[k] >= 0.0
    return good and learnt.hold <= learnt.catch and abs(total - 1.0) < 1e-3 and learnt.lowest <= learnt.reached


@compiled(error_model="numpy")
def narrow(maps: NDArray[np.void], sent: NDArray[np.void], needed: Flags) -> bool:
    """Write a map rounded to 32 bits, less the law's own numbers, and `mark` it; False where no model can be made."""
    numbers, rounded = maps.view(np.float64), sent.view(np.float64)
    for k in range(SIZE):  # what is rounded decides which knots are needed, so it is rounded first
        rounded[k] = np.float32(numbers[k])
    for k in range(4):
        if not 0.0 <= maps[0].law[k] < math.inf:
            return False
        sent[0].law[k] = 0.0
    if not is_sensible(sent):
        return False
    mark(sent, needed)
    good = True
    for k in range(SIZE):
        good = good and (needed[k] == 0 or math.isfinite(rounded[k]))
    return good


@kernel("i8(Map[::1], Map[::1], f4[::1])")
def shrink(maps: NDArray[np.void], sent: NDArray[np.void], short: Short) -> int:
    """Write the map as it crosses the network, with the law's own numbers, and the numbers of `shrunk`: how many.

    Returns:
        Their number, negative where they are those of no model.
    """
    rounded, needed, count = sent.view(np.float64), scratch(np.int8, SIZE), 0
    needed[:] = 0
    good = narrow(maps, sent, needed)
    for k in range(SIZE):
        if needed[k] > 0:
            short[count] = np.float32(rounded[k])
            count += 1
        else:
            rounded[k] = 0.0
    for k in range(4):
        sent[0].law[k] = maps[0].law[k]
    return count if good else -count


@kernel("b1(f4[::1], UniTuple(f8, 4), Map[::1])")
def expand(short: Short, law: Law, maps: NDArray[np.void]) -> bool:
    """Write the map of these numbers, at least a header's, and of a law; whether they are those of one."""
    numbers, needed = maps.view(np.float64), scratch(np.int8, SIZE)
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
    for k in range(4):
        maps[0].law[k] = law[k]
    return bool(count == short.size)


def shrunk(maps: NDArray[np.void]) -> tuple[bytes, NDArray[np.void], bool]:
    """A map as it crosses the network.

    Returns:
        The numbers that a force can be computed from, less those of the law, as 32-bit floats, little-endian; the map
        that `unpack` makes of them but with the law's numbers; and whether it is one.
    """
    short, sent = np.empty(SIZE, np.float32), np.empty(1, Map.layout)
    count = shrink.entry(maps, sent, short)
    return short[: abs(count)].astype("<f4", copy=False).tobytes(), sent, count > 0


def unpack(content: bytes, law: Law = (0.0, 0.0, 0.0, 0.0)) -> NDArray[np.void] | None:
    """The map of packed bytes and of this law's numbers, an array of one; None where they are none."""
    if len(content) % 4 or not HEADER <= len(content) // 4 <= SIZE:
        return None
    short, maps = np.frombuffer(content, "<f4").astype(np.float32, copy=False), np.empty(1, Map.layout)
    return maps if expand.entry(short, law, maps) else None
