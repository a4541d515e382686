"""The form in which a contact map crosses the network: what a force can be computed from, and nothing else."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.models.contact_map.kernel import cubic, length
from foretouch.models.contact_map.layout import (
    BELOW,
    COARSENESS,
    DOUBT,
    DOUBTS,
    EXPERTS,
    FEATURE_COUNT,
    FEATURE_KNOTS,
    FEATURE_WEIGHTS,
    HEADER,
    KNOTS,
    LAW,
    LAW_SPEED,
    LOWEST,
    RANGES,
    REACHED,
    SHARES,
    SIZE,
    STARTS,
    WEIGHTS,
)

Array = NDArray[np.float64]


def _window(flat: Array, spacing: float, below: int, knots: int) -> tuple[int, int]:
    """The knots that a force can be computed from: those around the places that were visited."""
    first = cubic(flat[LOWEST], spacing, below, knots)[0]
    return first, cubic(flat[REACHED], spacing, below, knots)[0] + 4


window = compiled(_window)


def _transfer(flat: Array, packed: Array, unpacking: bool) -> int:
    """Copy what a force can be computed from between a flat array and a short one; returns the short one's length.

    A fine map without a share is left out; -1 where the short array ends too early.
    """
    if packed.size < HEADER:
        return -1
    if unpacking:
        flat[:] = 0.0
    for k in range(HEADER):  # a slice of an array into another takes seconds to compile
        if unpacking:
            flat[k] = packed[k]
        else:
            packed[k] = flat[k]
    size = HEADER
    for kind in range(2):
        if kind == 1 and not flat[SHARES + 2] > 0.0:
            continue
        start = STARTS[kind]
        below = BELOW[0] if kind == 0 else BELOW[1]
        count = start[FEATURE_COUNT]
        for part in range(2 + count):
            if part == 0:
                begin, end = start[RANGES], start[RANGES] + 2 * count
            elif part == 1:
                low, high = window(flat, length(kind), below, start[KNOTS])
                begin, end = start[WEIGHTS] + low, start[WEIGHTS] + high
            else:
                spacing, knots = COARSENESS * length(kind), start[FEATURE_KNOTS]
                low, high = window(flat, spacing, -(-below // COARSENESS), knots)
                offset = start[FEATURE_WEIGHTS] + (part - 2) * knots
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


transfer = compiled(_transfer)


def pack(flat: Array) -> bytes:
    """The numbers that a force can be computed from, less those of the law, as 32-bit floats, little-endian."""
    short, rounded = np.empty(SIZE), flat.copy()
    rounded[LAW : LAW + 4] = 0.0
    # What is rounded decides which knots are needed, so it is rounded first.
    rounded = rounded.astype(np.float32).astype(np.float64)
    return short[: transfer(rounded, short, False)].astype("<f4").tobytes()


def _sensible(short: Array) -> bool:
    """Whether numbers can be those of a model."""
    total, good = 0.0, short.size >= HEADER
    for value in short:
        good = good and math.isfinite(value)
    if not good:
        return False
    for k in range(EXPERTS):
        total += short[SHARES + k]
        good = good and short[SHARES + k] >= 0.0
    for k in range(4):
        good = good and short[LAW + k] >= 0.0
    good = good and abs(total - 1.0) < 1e-3 and short[LAW_SPEED] >= 0.0
    for k in range(DOUBTS):
        good = good and short[DOUBT + k] >= 0.0
    return good and short[LOWEST] <= short[REACHED]


sensible = compiled(_sensible)


def unpack(content: bytes) -> Array | None:
    """The flat array of packed bytes, None where they are none."""
    if len(content) % 4 or len(content) > 4 * SIZE:
        return None
    rounded = np.frombuffer(content, dtype="<f4")
    if not np.isfinite(rounded).all():
        return None
    short, flat = rounded.astype(np.float64), np.empty(SIZE)
    return flat if sensible(short) and transfer(flat, short, True) == short.size else None
