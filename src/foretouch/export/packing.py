"""Bytes of a record in fewer words: what repeats in it is copied from earlier in it, as in Lempel and Ziv (1977)."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

LEAST = 5  # Words of a copy, at least: telling which so few are takes no more room
LOOKED_AT = 40  # Newest places at which a repetition is looked for
NOTED = 200  # First words of a copy that later copies may begin at

MOST = (1 << 16) - 1
"""Most words that a piece tells, and most different ones that a record may have."""


class Packed(NamedTuple):
    """A record in fewer words.

    Attributes:
        words: Its different words of 64 bits.
        pieces: Numbers of 16 bits. Of each piece, how many words it tells, how many are copied behind them, and how far
            back they are, the latter two in two numbers each, the lower first; then which words it tells. A copy may
            overlap what it writes, so that equal words in a row are one.
    """

    words: list[int]
    pieces: list[int]


def packed(first: NDArray[np.void]) -> Packed:
    """A record in fewer words."""
    clean = np.zeros(1, first.dtype)  # what lies between two fields is anything, and is not copied
    clean[:] = first
    words: list[int] = np.frombuffer(clean.tobytes(), "<u8").tolist()
    places = {word: place for place, word in enumerate(sorted(set(words)))}
    pieces: list[int] = []
    told: list[int] = []
    for begin, end, back in _pieces(words):
        if not back:
            told += [places[word] for word in words[begin:end]]
        if back or len(told) == MOST:
            pieces += _piece(told, end - begin if back else 0, back)
            told = []
    return Packed(list(places), pieces + _piece(told, 0, 0) if told else pieces)


def _piece(told: list[int], length: int, back: int) -> list[int]:
    return [len(told), length & MOST, length >> 16, back & MOST, back >> 16, *told]


def _pieces(words: list[int]) -> list[tuple[int, int, int]]:
    """Begin and end of each piece, and how far back it is copied from; 0 for one that is told word by word."""
    known: dict[tuple[int, ...], list[int]] = defaultdict(list)
    pieces, at = [], 0
    while at < len(words):
        places = known[tuple(words[at : at + LEAST])][-LOOKED_AT:]
        length, place = max(((_same(words, place, at), place) for place in places), default=(0, 0))
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
