"""Counting what arrives, by sequence number."""

from __future__ import annotations

from array import array

REMEMBERED = 2**15  # Number of the newest sequence numbers that are remembered one by one: at 1 kHz, half a minute


class SequenceCounter:
    """Tells the newest from the late and from copies, counts them, and what is missing.

    What is older than the 32,768 newest numbers cannot be distinguished from a copy any more and counts as one.

    Attributes:
        newest: Largest sequence number of this sender that has arrived, 0 before the first.
        first: The smallest that has arrived; what was sent before there was a listener is not lost.
        received: Messages that have arrived, each counted once however often it came.
        late: Number of these that came after a newer one.
        copies: Arrivals of what had arrived before.
    """

    __slots__ = ("_arrived", "_lost_before", "_received_before", "copies", "first", "late", "newest", "received")

    def __init__(self) -> None:
        self.received = 0
        self.late = 0
        self.copies = 0
        self._lost_before = 0
        self._begin()

    def restart(self) -> None:
        """Begin with another sender, which counts from 1 again; the counts of the one before stay."""
        self._lost_before = self.lost
        self._begin()

    def _begin(self) -> None:
        self.newest = 0
        self.first = 1
        self._received_before = self.received
        self._arrived = array("q", [-1]) * REMEMBERED  # the newest number that arrived of those with one remainder

    def is_newest(self, sequence: int) -> bool:
        """Count one arrival and say whether it is newer than all before."""
        arrived, index, newest = self._arrived, sequence % REMEMBERED, self.newest
        if sequence > newest:
            if self.received == self._received_before:
                self.first = sequence
            arrived[index] = self.newest = sequence
            self.received += 1
            return True
        if arrived[index] == sequence or newest - sequence >= REMEMBERED:
            self.copies += 1
            return False
        if sequence < self.first or self.received == self._received_before:
            self.first = sequence
        arrived[index] = sequence
        self.received += 1
        self.late += 1
        return False

    @property
    def lost(self) -> int:
        """Sequence numbers from the first to the newest that have not arrived (a late one may still come)."""
        received = self.received - self._received_before
        return self._lost_before + (self.newest - self.first + 1 - received if received else 0)
