"""Counting what arrives, by sequence number."""

from __future__ import annotations

__all__ = ["SequenceCounter"]


class SequenceCounter:
    """Tells the newest from the late, and counts both and what is missing.

    Attributes:
        newest: Largest sequence number that has arrived, 0 before the first.
        first: The number that arrived first; what was sent before there was a listener is not lost.
        received: Messages that have arrived.
        late: Of these, the ones that came after a newer one.
    """

    __slots__ = ("first", "late", "newest", "received")

    def __init__(self) -> None:
        self.newest = 0
        self.first = 1
        self.received = 0
        self.late = 0

    def is_newest(self, sequence: int) -> bool:
        """Count one arrival and say whether it is newer than all before."""
        if not self.received:
            self.first = sequence
        self.received += 1
        if sequence <= self.newest:
            self.late += 1
            return False
        self.newest = sequence
        return True

    @property
    def lost(self) -> int:
        """Sequence numbers from the first to the newest that have not arrived (a late one may still come)."""
        return max(0, self.newest - self.first + 1 - self.received) if self.received else 0
