"""Bytes of a record in fewer words: what repeats in it is copied from earlier in it, as in Lempel and Ziv (1977)."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

LEAST = 3  # Words of a copy, at least: one of fewer is as long as they are
LOOKED_AT = 40  # Newest places at which a repetition is looked for
NOTED = 200  # First words of a copy that later copies may begin at

COUNT_BITS, LENGTH_BITS, DISTANCE_BITS = 16, 24, 24
"""A token says how many words follow it, how many are copied behind them, and how far back they are, lowest bits
first. A copy may overlap what it writes, so that equal words in a row are one."""


def packed(first: NDArray[np.void]) -> list[int]:
    """The tokens of a record, each with the words that follow it."""
    clean = np.zeros(1, first.dtype)  # what lies between two fields is anything, and is not copied
    clean[:] = first
    words: list[int] = np.frombuffer(clean.tobytes(), "<u8").tolist()
    result: list[int] = []
    told: list[int] = []
    for begin, end, back in _pieces(words):
        if not back:
            told += words[begin:end]
        if back or len(told) == (1 << COUNT_BITS) - 1:
            result += [_token(len(told), end - begin if back else 0, back), *told]
            told = []
    return [*result, _token(len(told), 0, 0), *told] if told else result


def _token(count: int, length: int, distance: int) -> int:
    return count | length << COUNT_BITS | distance << (COUNT_BITS + LENGTH_BITS)


def _pieces(words: list[int]) -> list[tuple[int, int, int]]:
    """Begin and end of each piece, and how far back it is copied from; 0 for one that is told word by word."""
    known: dict[tuple[int, ...], list[int]] = defaultdict(list)
    pieces, at = [], 0
    while at < len(words):
        places = known[tuple(words[at : at + LEAST])][-LOOKED_AT:]
        length, place = max(((_same(words, place, at), place) for place in places), default=(0, 0))
        length = min(length, (1 << LENGTH_BITS) - 1)
        copies = length >= LEAST
        end = at + (length if copies else 1)
        pieces.append((at, end, at - place if copies else 0))
        for noted in range(at, min(end, at + NOTED)):
            known[tuple(words[noted : noted + LEAST])].append(noted)
        at = end
    return pieces


def _same(words: list[int], one: int, other: int) -> int:
    """How many words are the same from two places on."""
    length = 0
    while other + length < len(words) and words[one + length] == words[other + length]:
        length += 1
    return length
