"""What waits to be sent over a thin link, the most urgent first, in pieces that hold nothing up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from foretouch.session.network.erasure import MOST_PARITIES, parity_of, restored

PIECE = 3  # Kind of a record: a piece of something longer
PARITIES = bytes((4, *range(6, 5 + MOST_PARITIES)))  # and of its parities, by their rows
PIECE_HEAD = 6
"""Bytes of a record before its content: kind, name, number, place among the pieces, their count, and size. A parity has
the size of the last piece in the place of its own."""
MOST_PIECES, SHORTEST, LONGEST = 255, 16, 249  # Pieces of a thing, and bytes of one, unless it is the last
NUMBERS = 255  # Things of a name that have numbers of their own, from 1


class Outbox:
    """Things that are longer than a packet, by name; of each name the newest counts, once one has been begun is sent.

    Args:
        names: Their names, the most urgent first.
        longest: Bytes of a record, at most.
        parities: How many parities so many pieces have.
        urgent: How many of the names always go first; the others take turns.
    """

    def __init__(self, names: tuple[str, ...], longest: int, parities: Callable[[int], int], urgent: int) -> None:
        self._urgent, self._turns, self._places = names[:urgent], [*names], {name: at for at, name in enumerate(names)}
        self._longest, self._parities = min(longest - PIECE_HEAD, LONGEST), parities
        self._waiting: dict[str, bytes] = {}
        self._pieces: dict[str, list[bytes]] = {}
        self._numbers = dict.fromkeys(names, 0)

    def put(self, name: str, data: bytes) -> None:
        """Send this instead of what waits under this name, unless it is empty or too long."""
        if 0 < len(data) <= MOST_PIECES * self._longest:
            self._waiting[name] = data

    @property
    def is_empty(self) -> bool:
        """Whether nothing is to be sent."""
        return not (self._waiting or self._pieces)

    def next(self, room: int) -> bytes:
        """A record of at most so many bytes of what is most urgent; none where nothing waits."""
        if self.is_empty:
            return b""
        for name in self._turns:
            if not self._pieces.get(name) and name in self._waiting:
                self._pieces[name] = self._cut(name, self._waiting.pop(name), room - PIECE_HEAD)
            pieces = self._pieces.get(name)
            if pieces:
                if len(pieces[0]) > room:
                    return b""
                if len(pieces) == 1:
                    self._end(name)
                return pieces.pop(0)
        return b""

    def _end(self, name: str) -> None:
        """All of a thing is sent: unless it is urgent, the others' turn comes before this name's."""
        del self._pieces[name]
        if name not in self._urgent:
            self._turns.remove(name)
            self._turns.append(name)

    def _cut(self, name: str, data: bytes, size: int) -> list[bytes]:
        size = max(min(size, self._longest), min(SHORTEST, self._longest), -(-len(data) // MOST_PIECES))
        parts = [data[at : at + size] for at in range(0, len(data), size)]
        place = self._places[name]
        number = self._numbers[name] = self._numbers[name] % NUMBERS + 1
        made = [bytes((PIECE, place, number, index, len(parts), len(part))) + part for index, part in enumerate(parts)]
        for row in range(min(self._parities(len(parts)), MOST_PARITIES, MOST_PIECES + 1 - len(parts))):
            parity = parity_of(parts, row)
            made.append(bytes((PARITIES[row], place, number, len(parts[-1]), len(parts), len(parity))) + parity)
        return made


@dataclass(slots=True)
class _Begun:
    """What has come of a thing."""

    number: int
    count: int  # of its pieces
    last: int = 0  # bytes of the last of them, as a parity said it
    pieces: dict[int, bytes] = field(default_factory=dict)  # by place
    parities: dict[int, bytes] = field(default_factory=dict)  # by row
    is_whole: bool = False

    def joined(self) -> bytes:
        """The pieces together; nothing while too many are missing."""
        if len(self.pieces) + len(self.parities) < self.count:
            return b""
        pieces = restored(self.pieces, self.parities, self.count)
        if self.count - 1 not in self.pieces:
            pieces[-1] = pieces[-1][: self.last]
        return b"".join(pieces)


class Inbox:
    """Things that come in pieces; of one that lacks some the parities give them back.

    Args:
        names: Their names, as the other end's outbox has them.

    Attributes:
        broken: How many of each name were begun and never whole.
        missed: How many were not even begun.
        whole: How many were whole.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names, self.broken = names, dict.fromkeys(names, 0)
        self.missed, self.whole = dict.fromkeys(names, 0), dict.fromkeys(names, 0)
        self._begun: dict[int, _Begun] = {}  # the newest of each name

    def restart(self) -> None:
        """Begin with another sender, whose numbers begin anew."""
        self._begun.clear()

    def take(self, data: bytes, at: int) -> tuple[int, str, bytes]:
        """Take a record of a piece at a place: where it ends, negative where it is none; and what is whole now."""
        if at + PIECE_HEAD > len(data):
            return -1, "", b""
        kind, place, number, index, count, size = data[at : at + PIECE_HEAD]
        end, row = at + PIECE_HEAD + size, PARITIES.find(kind)
        if end > len(data) or place >= len(self._names) or count == 0 or size == 0:
            return -1, "", b""
        if index >= count if kind == PIECE else not 0 <= row <= MOST_PIECES - count:
            return -1, "", b""
        before = self._begun.get(place)
        if before is not None and 0 < (before.number - number) % NUMBERS <= NUMBERS // 2:  # of one that is older
            return end, "", b""
        if before is None or before.number != number:
            name = self._names[place]
            self.broken[name] += before is not None and not before.is_whole
            self.missed[name] += 0 if before is None else (number - before.number) % NUMBERS - 1
            before = self._begun[place] = _Begun(number, count)
        if before.is_whole or before.count != count:
            return end, "", b""
        if kind == PIECE:
            before.pieces[index] = data[at + PIECE_HEAD : end]
        else:
            before.parities[row], before.last = data[at + PIECE_HEAD : end], index
        whole = before.joined()
        if not whole:
            return end, "", b""
        self.whole[self._names[place]] += 1
        self._begun[place] = _Begun(number, count, is_whole=True)
        return end, self._names[place], whole
