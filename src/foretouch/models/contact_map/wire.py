"""The form in which a contact map crosses the network: what a force can be computed from, and nothing else."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.kernel import cubic, length

Array = NDArray[np.float64]


@compiled
def window(flat: Array, spacing: float, below: int, knots: int) -> tuple[int, int]:
    """The knots that a force can be computed from: those around the places that were visited."""
    first = cubic(flat[layout.LOWEST], spacing, below, knots)[0]
    return first, cubic(flat[layout.REACHED], spacing, below, knots)[0] + 4


@compiled
def transfer(flat: Array, packed: Array, unpacking: bool) -> int:
    """Copy what a force can be computed from between a flat array and a short one; returns the short one's length.

    A fine map without a share is left out; -1 where the short array ends too early.
    """
    if packed.size < layout.HEADER:
        return -1
    if unpacking:
        flat[:] = 0.0
    for k in range(layout.HEADER):  # a slice of an array into another takes seconds to compile
        if unpacking:
            flat[k] = packed[k]
        else:
            packed[k] = flat[k]
    size = layout.HEADER
    for kind in range(2):
        if kind == 1 and not flat[layout.SHARES + 2] > 0.0:
            continue
        start = layout.STARTS[kind]
        below = layout.BELOW[0] if kind == 0 else layout.BELOW[1]
        count = start[layout.FEATURE_COUNT]
        for part in range(2 + count):
            if part == 0:
                begin, end = start[layout.RANGES], start[layout.RANGES] + 2 * count
            elif part == 1:
                low, high = window(flat, length(kind), below, start[layout.KNOTS])
                begin, end = start[layout.WEIGHTS] + low, start[layout.WEIGHTS] + high
            else:
                spacing, knots = layout.COARSENESS * length(kind), start[layout.FEATURE_KNOTS]
                low, high = window(flat, spacing, -(-below // layout.COARSENESS), knots)
                offset = start[layout.FEATURE_WEIGHTS] + (part - 2) * knots
                begin, end = offset + low, offset + high
            if size + end - begin > packed.size:
                return -1
            for k in range(begin, end):
                if unpacking:
                    flat[k] = packed[size]
                else:
                    packed[size] = flat[k]
                size += 1
    return size


def pack(flat: Array) -> bytes:
    """The numbers that a force can be computed from, less those of the law, as 32-bit floats, little-endian."""
    short, rounded = np.empty(layout.SIZE), flat.copy()
    rounded[layout.LAW : layout.LAW + 4] = 0.0
    # What is rounded decides which knots are needed, so it is rounded first.
    rounded = rounded.astype(np.float32).astype(np.float64)
    return short[: transfer(rounded, short, False)].astype("<f4").tobytes()


@compiled
def sensible(short: Array) -> bool:
    """Whether numbers can be those of a model."""
    total, good = 0.0, short.size >= layout.HEADER
    for value in short:
        good = good and math.isfinite(value)
    if not good:
        return False
    for k in range(layout.EXPERTS):
        total += short[layout.SHARES + k]
        good = good and short[layout.SHARES + k] >= 0.0
    for k in range(4):
        good = good and short[layout.LAW + k] >= 0.0
    good = good and abs(total - 1.0) < 1e-3 and short[layout.LAW_SPEED] >= 0.0
    for k in range(layout.UNCERTAINTIES):
        good = good and short[layout.UNCERTAINTY + k] >= 0.0
    return good and short[layout.LOWEST] <= short[layout.REACHED]


def unpack(content: bytes) -> Array | None:
    """The flat array of packed bytes, None where they are none."""
    if len(content) % 4 or len(content) > 4 * layout.SIZE:
        return None
    rounded = np.frombuffer(content, dtype="<f4")
    if not np.isfinite(rounded).all():
        return None
    short, flat = rounded.astype(np.float64), np.empty(layout.SIZE)
    return flat if sensible(short) and transfer(flat, short, True) == short.size else None
