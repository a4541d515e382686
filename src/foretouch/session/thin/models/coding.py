"""Few bits for whole numbers that are mostly zero: an adaptive binary arithmetic coder, which writes and reads alike.

What a model differs in from another is written part by part. A chance, of a zero or of a further bit of a number, moves
towards what came; so a zero among zeros takes a part of a bit.

References:
    Arithmetic coding with adaptive binary chances: Witten, Neal and Cleary (1987), Communications of the ACM 30.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.core.compiling import inlined, scratch
from foretouch.models.contact_map.layout import HEADER, SIZE, Map
from foretouch.session.thin.models.compact import (
    AT_MAP,
    AT_SPACE,
    FARTHEST,
    LAST_STEP,
    LAW,
    PARTS,
    SHARES,
    Numbers,
    Steps,
    mark_needed,
)

Bytes = NDArray[np.uint8]

MOST_CONTEXTS = 400


class Coder(Record):
    """A binary arithmetic coder: what it writes or reads, with the chances that it has learnt so far."""

    reads: bool
    low: int
    high: int
    code: int  # the bits that are read
    at: int  # bytes so far
    chances: Annotated[
        NDArray[Any], int, MOST_CONTEXTS
    ]  # of a bit that is set, in 65,536ths; the first is even for ever


WIDTH = 40  # Bits of `low` and `high`
MASK = 2**WIDTH - 1
EVEN = 0  # Context of a bit about which nothing is known
PACE = 5  # A chance goes this power of a half of the way to what came
LEAST, MOST = 400, 65536 - 400  # Chances


@compiled
def _bit(c: Coder, data: Bytes, context: int, value: int) -> int:
    """Write or read a bit; beyond the end there are zeros."""
    chance = c.chances[context]
    middle = c.low + ((c.high - c.low) >> 16) * chance
    if c.reads:
        value = 1 if c.code <= middle else 0
    if value != 0:
        c.high = middle
    else:
        c.low = middle + 1
    if context != EVEN:
        chance += ((value << 16) - chance) >> PACE
        c.chances[context] = min(max(chance, LEAST), MOST)
    while (c.low ^ c.high) >> (WIDTH - 8) == 0:
        if c.reads:
            c.code = ((c.code << 8) & MASK) | (int(data[c.at]) if c.at < data.size else 0)
        elif c.at < data.size:
            data[c.at] = c.high >> (WIDTH - 8)
        c.at += 1
        c.low, c.high = (c.low << 8) & MASK, ((c.high << 8) & MASK) | 255
    return value


@compiled
def _bits(c: Coder, data: Bytes, count: int, value: int) -> int:
    """So many bits about which nothing is known."""
    known = 0
    for k in range(count - 1, -1, -1):
        known = 2 * known + _bit(c, data, EVEN, (value >> k) & 1)
    return known


LENGTHS = 10  # Contexts for the length of a number
CONTEXTS = 3 + 2 + LENGTHS
"""Contexts of a kind of numbers: for whether one is zero, by its neighbours; for its sign, by that of the last; and for
its length."""


@compiled
def _number(c: Coder, data: Bytes, first: int, zero: int, last: int, value: int) -> int:
    """A whole number, by the contexts of its kind, and that for whether it is zero."""
    if _bit(c, data, zero, 1 if value == 0 else 0) != 0:
        return 0
    negative = _bit(c, data, first + 3 + last, 1 if value < 0 else 0)
    size = abs(value)
    length = 0
    while length < FARTHEST and _bit(c, data, first + 5 + min(length, LENGTHS - 1), 1 if size >> (length + 1) else 0):
        length += 1
    size = (1 << length) | _bits(c, data, length, size & ((1 << length) - 1))
    return -size if negative else size


@compiled
def _long(c: Coder, data: Bytes, first: int, spread: int, value: int) -> int:
    """A whole number that mostly has about so many bits."""
    negative = _bit(c, data, EVEN, 1 if value < 0 else 0)
    size = abs(value)
    high = _number(c, data, first, first, 0, size >> spread)
    size = (abs(high) << spread) | _bits(c, data, spread, size & ((1 << spread) - 1))
    return -size if negative else size


HEADS = 9  # Kind of the numbers of `HEAD`, and of the memory, one each
HEAD = ((5, "number"), (0, "time [ms], less 20 a number"), (0, "command, less the time"), (0, "reason"))
MEMORY = ((9, "near"), (0, "side"), (2, "far"), (2, "short"), (3, "middle"), (4, "long"), (0, "stuck"))
SPREADS = np.array([spread for spread, _ in (*HEAD, *MEMORY)])
AT_PARTS = 1 + (HEADS + len(SPREADS)) * CONTEXTS  # Contexts for whether a part has changed
AT_SCALARS = AT_PARTS + len(PARTS)  # Contexts for whether each number of the first part is zero
SMOOTH = (3, 4, 5, 6)  # Kinds whose differences are much like that of the number before
SHIFTS = 7  # Most bits, less one, by which the differences of a part are shorter


def _chances() -> Steps:
    """Chances at first, shape (`MOST_CONTEXTS`,): as they are in sessions with simulated materials."""
    chances = np.full(MOST_CONTEXTS, 0.5)
    for kind in range(1, HEADS + len(SPREADS)):
        zeros, signs, lengths = FIRST.get(kind, ((50,) * 3, (50, 50), (50,) * 4))
        lengths = (*lengths, *(lengths[-1:] * (LENGTHS - len(lengths))))
        first = 1 + kind * CONTEXTS
        chances[first : first + CONTEXTS] = 0.01 * np.array([*zeros, *signs, *lengths])
    chances[AT_PARTS : AT_PARTS + len(PARTS)] = 0.01 * np.array(FIRST_OF_PARTS)
    chances[AT_SCALARS : AT_SCALARS + len(FIRST_OF_SCALARS)] = 0.01 * np.array(FIRST_OF_SCALARS)
    return np.clip((65536 * chances).astype(np.int64), LEAST, MOST)


FIRST = {
    1: ((50, 50, 50), (31, 52), (98, 87, 84, 84, 80, 78, 69, 70, 61, 48)),
    2: ((72, 51, 33), (65, 57), (63, 56, 40, 40, 59, 34)),
    3: ((56, 36, 20), (44, 51), (56, 53, 58, 57, 55, 47, 57, 26)),
    4: ((60, 39, 28), (50, 46), (40, 40, 38, 33, 25, 20)),
    5: ((76, 49, 29), (49, 51), (36, 37, 45, 37, 48, 24)),
    6: ((81, 49, 16), (44, 55), (40, 36, 37, 38, 52, 20)),
    7: ((90, 70, 50), (50, 50), (70,)),
    8: ((38, 58, 44), (8, 50), (98, 98, 98, 95, 97, 98, 98, 50, 2)),
    9: ((45, 50, 50), (50, 50), (55,)),
    10: ((65, 50, 50), (50, 50), (70,)),
    11: ((97, 50, 50), (50, 50), (50,)),
    12: ((1, 50, 50), (1, 50), (98, 40, 50)),
    13: ((85, 50, 50), (50, 50), (50,)),
    14: ((50, 50, 50), (50, 50), (50,)),
    15: ((90, 50, 50), (50, 50), (50,)),
    16: ((40, 50, 50), (50, 50), (60,)),
}
"""Percent of zeros by neighbours, of negative ones by the last sign, and of a further bit by those before, by kind."""
FIRST_OF_PARTS = (80, 35, 74, 49, 57, 61, 50, 57, 60, 7, 33, 15, 2, 3)
FIRST_OF_SCALARS = (
    *(92, 71, 71, 71, 73, 98, 98, 92, 98, 50, 50, 50, 50, 74, 84, 87),
    *(82, 67, 50, 55, 93, 68, 50, 82, 78, 79, 80, 87, 98, 98, 97),
)
ALL_CHANCES = _chances()


@compiled
def _begin(c: Coder, data: Bytes, reads: bool) -> None:
    c.reads, c.low, c.high, c.code, c.at = reads, 0, MASK, 0, 0
    if reads:
        for _ in range(WIDTH // 8):
            c.code = (c.code << 8) | (int(data[c.at]) if c.at < data.size else 0)
            c.at += 1
    for k in range(c.chances.size):
        c.chances[k] = ALL_CHANCES[k]


@inlined
def _shorter(value: int, shift: int) -> int:
    """A difference in units of a power of two, towards zero."""
    return -(-value >> shift) if value < 0 else value >> shift


@compiled
def _shift_of(base: Steps, steps: Steps, begin: int, end: int) -> int:
    """By how many bits all differences of a part can be shorter; -1 where there are none."""
    every = 0
    for k in range(begin, end):
        every |= abs(steps[k] - base[k])
    shift = 0
    while every and not every & 1 and shift < SHIFTS:
        every, shift = every >> 1, shift + 1
    return shift if every else -1


@compiled
def _code_part(c: Coder, data: Bytes, part: int, base: Steps, steps: Steps, needed: NDArray[np.int8]) -> None:
    """Write or read the numbers of a part."""
    begin, end, kind, row = PARTS[part]
    shift = -1 if c.reads else _shift_of(base, steps, begin, end)
    changed = _bit(c, data, AT_PARTS + part, 1 if shift >= 0 else 0)
    if changed and part:
        shift = _bits(c, data, 3, shift)
    shift = shift if part else 0
    first, last = 1 + kind * CONTEXTS, 0
    before = second = former = 0
    for k in range(begin, end):
        if changed == 0 or (AT_MAP <= k < AT_SPACE and needed[k - AT_MAP] == 0):
            if c.reads:
                steps[k] = base[k]
            continue
        beside = before + (1 if row and steps[k - row] != base[k - row] else 0 if row else second)
        zero = first + beside if part else AT_SCALARS + k
        value = _number(c, data, first, zero, last, _shorter(steps[k] - base[k], shift) - former)
        if c.reads:
            steps[k] = min(max(base[k] + ((value + former) << shift), -LAST_STEP), LAST_STEP)
        former = value + former if kind in SMOOTH else 0
        second, before = before, 1 if value else 0
        last = (1 if value < 0 else 0) if value else last


@kernel("i8(Coder, u1[::1], i8[::1], i8[::1], i8[::1], f8[:, ::1], Map[::1], b1, b1)", Map)
def code(
    c: Coder,
    data: Bytes,
    heads: Steps,
    base: Steps,
    steps: Steps,
    grids: Numbers,
    maps: NDArray[np.void],
    is_map: bool,
    reads: bool,
) -> int:
    """Write a model or read one: the number of bytes.

    Args:
        c: Written.
        data: Bytes, written or read.
        heads: Numbers of `HEAD`, then those of `MEMORY` or none.
        base: Steps of the model that the other end has.
        steps: Steps of this one; written where it is read.
        grids: Theirs.
        maps: An array of one, which is written.
        is_map: Whether it is a contact map.
        reads: Whether it is read.
    """
    _begin(c, data, reads)
    for k in range(heads.size):
        heads[k] = _long(c, data, 1 + (HEADS + k) * CONTEXTS, SPREADS[k], heads[k])
    needed = scratch(np.int8, SIZE)
    needed[:] = 0
    for k in range(HEADER):
        needed[k] = 1 if is_map else 0
    needed[SHARES + 1 - AT_MAP] = 0
    for k in range(4):
        needed[LAW + k] = 0
    for part in range(len(PARTS)):
        _code_part(c, data, part, base, steps, needed)
        if part == 0 and is_map:
            mark_needed(steps, grids, maps, needed)
    if not reads and c.at < data.size:
        data[c.at] = (c.low >> (WIDTH - 8)) + 1  # of what lies between low and high, the one of fewest bytes
        c.at += 1
    return int(c.at)
