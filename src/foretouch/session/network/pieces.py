"""What waits to be sent over a thin link, the most urgent first, in pieces that hold nothing up."""

from __future__ import annotations

PIECE, PARITY = 3, 4  # Kinds of a record: a piece of something longer, and the exclusive or of its pieces
PIECE_HEAD = 6
"""Bytes of a record before its content: kind, name, number, place among the pieces, their count, and size."""
MOST_PIECES, SHORTEST, LONGEST = 255, 16, 249  # Pieces of a thing, and bytes of one, unless it is the last
NUMBERS = 255  # Things of a name that have numbers of their own, from 1


def parity_of(pieces: list[bytes]) -> bytes:
    """The exclusive or of pieces, of which the last may be shorter: one that is lost comes back."""
    size = len(pieces[0])
    total = 0
    for piece in pieces:
        total ^= int.from_bytes(piece.ljust(size, b"\0"), "little")
    return total.to_bytes(size, "little")


class Outbox:
    """Things that are longer than a packet, by name; of each name the newest counts, once one has been begun is sent.

    Args:
        names: Their names, the most urgent first.
        longest: Bytes of a record, at most.

    Attributes:
        refused: Number of things that were too long to be sent.
    """

    def __init__(self, names: tuple[str, ...], longest: int) -> None:
        self._names, self._longest = names, min(longest - PIECE_HEAD, LONGEST)
        self.refused = 0
        self._waiting: dict[str, bytes] = {}
        self._pieces: dict[str, list[bytes]] = {}
        self._numbers = dict.fromkeys(names, 0)

    def put(self, name: str, data: bytes) -> None:
        """Send this instead of what waits under this name, unless it is too long."""
        if len(data) > MOST_PIECES * self._longest:
            self.refused += 1
        elif data:
            self._waiting[name] = data

    def waits(self, name: str) -> bool:
        """Whether anything is to be sent under this name."""
        return name in self._waiting or bool(self._pieces.get(name))

    @property
    def is_empty(self) -> bool:
        """Whether nothing is to be sent."""
        return not (self._waiting or self._pieces)

    def next(self, room: int) -> bytes:
        """A record of at most so many bytes of what is most urgent; none where nothing waits."""
        if self.is_empty:
            return b""
        for place, name in enumerate(self._names):
            if not self._pieces.get(name) and name in self._waiting:
                self._pieces[name] = self._cut(place, name, self._waiting.pop(name), room - PIECE_HEAD)
            pieces = self._pieces.get(name)
            if pieces:
                if len(pieces[0]) > room:
                    return b""
                if len(pieces) == 1:
                    del self._pieces[name]
                return pieces.pop(0)
        return b""

    def _cut(self, place: int, name: str, data: bytes, size: int) -> list[bytes]:
        size = max(min(size, self._longest), min(SHORTEST, self._longest), -(-len(data) // MOST_PIECES))
        parts = [data[at : at + size] for at in range(0, len(data), size)]
        number = self._numbers[name] = self._numbers[name] % NUMBERS + 1
        made = [bytes((PIECE, place, number, index, len(parts), len(part))) + part for index, part in enumerate(parts)]
        if len(parts) > 1:
            parity = parity_of(parts)
            made.append(bytes((PARITY, place, number, len(parts[-1]), len(parts), len(parity))) + parity)
        return made


class Inbox:
    """Things that come in pieces; of one that lacks a piece the parity gives it back.

    Args:
        names: Their names, as the other end's outbox has them.

    Attributes:
        broken: How many of each name were begun and never whole.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names, self.broken = names, dict.fromkeys(names, 0)
        self._begun: dict[int, tuple[int, int, dict[int, bytes] | None]] = {}
        """Number, count, and pieces of the newest, by place; no pieces where it is whole."""

    def restart(self) -> None:
        """Begin with another sender, whose numbers begin anew."""
        self._begun.clear()

    def take(self, data: bytes, at: int) -> tuple[int, str, bytes]:
        """Take a record of a piece at a place: where it ends, negative where it is none; and what is whole now."""
        if at + PIECE_HEAD > len(data):
            return -1, "", b""
        kind, place, number, index, count, size = data[at : at + PIECE_HEAD]
        end = at + PIECE_HEAD + size
        if end > len(data) or place >= len(self._names) or count == 0 or (kind == PIECE and index >= count):
            return -1, "", b""
        before = self._begun.get(place)
        if before is not None and 0 < (before[0] - number) % NUMBERS <= NUMBERS // 2:  # of one that is older
            return end, "", b""
        if before is None or before[0] != number:
            self.broken[self._names[place]] += before is not None and before[2] is not None
            before = self._begun[place] = (number, count, {})
        if before[2] is None or before[1] != count:
            return end, "", b""
        known = before[2]
        known[index if kind == PIECE else -1] = data[at + PIECE_HEAD : end]
        if kind == PARITY:
            known[-2] = bytes((index,))
        whole = _joined(known, count)
        if not whole:
            return end, "", b""
        self._begun[place] = (number, count, None)
        return end, self._names[place], whole


def _joined(known: dict[int, bytes], count: int) -> bytes:
    """The pieces together, one of them from the parity; nothing while more are missing."""
    missing = [index for index in range(count) if index not in known]
    if len(missing) > 1 or (missing and -1 not in known):
        return b""
    pieces = [known.get(index, b"") for index in range(count)]
    if missing:
        parity = known[-1]
        found = parity_of([parity, *(piece[: len(parity)] for index, piece in enumerate(pieces) if index in known)])
        pieces[missing[0]] = found[: known[-2][0]] if missing[0] == count - 1 else found
    return b"".join(pieces)
