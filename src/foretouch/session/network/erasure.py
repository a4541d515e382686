r"""A Reed-Solomon code over the field of 256 elements: as many lost pieces come back as parities of them have come.

Parity 0 is the exclusive or of the pieces. Parity :math:`j` is :math:`\sum_i w_{ji} p_i` with
:math:`w_{ji} = (x_0 + y_i) / (x_j + y_i)`, :math:`x_j = 255 - j` and :math:`y_i = i`: a Cauchy matrix, with its columns
scaled, of which no square part is singular.

References:
    Bloemer et al. (1995), An XOR-based erasure-resilient coding scheme.
"""

from __future__ import annotations

from functools import cache

MOST_PARITIES = 8
POLYNOMIAL = 0x11D  # By which products are reduced; 2 generates the field


def _powers() -> bytes:
    """Powers of 2 from 0 to 509, twice through the field."""
    made, power = bytearray(), 1
    for _ in range(510):
        made.append(power)
        power <<= 1
        power ^= POLYNOMIAL if power > 0xFF else 0
    return bytes(made)


_POWERS = _powers()
_LOGS = {power: exponent for exponent, power in enumerate(_POWERS[:255])}


def _quotient(a: int, b: int) -> int:
    """Of two that are not 0."""
    return _POWERS[_LOGS[a] + 255 - _LOGS[b]]


@cache
def _times(factor: int) -> bytes:
    """The multiples of all elements by one, for `bytes.translate`."""
    if not factor:
        return bytes(256)
    return bytes([0, *(_POWERS[_LOGS[factor] + _LOGS[element]] for element in range(1, 256))])


def _weight(row: int, place: int) -> int:
    return _quotient(0xFF ^ place, (0xFF - row) ^ place)


def _plus(total: int, piece: bytes, factor: int) -> int:
    """A sum with a multiple of a piece more."""
    return total ^ int.from_bytes(piece if factor == 1 else piece.translate(_times(factor)), "little")


def parity_of(pieces: list[bytes], row: int) -> bytes:
    """A parity of pieces, of which the last may be shorter; there are 255 - `row` of them at most."""
    total = 0
    for place, piece in enumerate(pieces):
        total = _plus(total, piece, _weight(row, place))
    return total.to_bytes(len(pieces[0]), "little")


def restored(pieces: dict[int, bytes], parities: dict[int, bytes], count: int) -> list[bytes]:
    """All pieces by their places, those that are missing as long as a parity; none where too many are missing.

    Args:
        pieces: Those that have come, by their places.
        parities: By their rows, for `parity_of`.
        count: How many pieces there are.
    """
    missing = [place for place in range(count) if place not in pieces]
    rows = sorted(parities)[: len(missing)]
    if len(rows) < len(missing):
        return []
    size = len(parities[rows[0]]) if rows else 0
    sums = []
    for row in rows:  # what the missing pieces add to this parity
        total = _plus(0, parities[row][:size], 1)
        for place, piece in pieces.items():
            total = _plus(total, piece[:size], _weight(row, place))
        sums.append(total.to_bytes(size, "little"))
    found = dict(zip(missing, _solved([[_weight(row, place) for place in missing] for row in rows], sums), strict=True))
    return [pieces[place] if place in pieces else found[place] for place in range(count)]


def _solved(weights: list[list[int]], sums: list[bytes]) -> list[bytes]:
    """The pieces of which these are the weighted sums, by elimination; no leading part is singular, so no rows swap."""
    for at, row in enumerate(weights):
        sums[at] = sums[at].translate(_times(_quotient(1, row[at])))
        row[:] = [_quotient(weight, row[at]) if weight else 0 for weight in row]
        for other, weights_of_other in enumerate(weights):
            factor = weights_of_other[at]
            if other == at or not factor:
                continue
            total = _plus(_plus(0, sums[other], 1), sums[at], factor)
            sums[other] = total.to_bytes(len(sums[at]), "little")
            weights_of_other[:] = [
                mine ^ _times(factor)[theirs] for mine, theirs in zip(weights_of_other, row, strict=True)
            ]
    return sums
