"""Counting what arrives, by sequence number."""

from __future__ import annotations

__all__ = ["SequenceCounter"]


class SequenceCounter:
    """Tells the newest from the late, and counts both and what is missing.

    Attributes:
        newest: Largest sequence number that has arrived, 0 before the first.
        received: Messages that have arrived.
        late: Of these, the ones that came after a newer one.
    """

    __slots__ = ("late", "newest", "received")

    def __init__(self) -> None:
        self.newest = 0
        self.received = 0
        self.late = 0

    def is_newest(self, sequence: int) -> bool:
        """Count one arrival and say whether it is newer than all before."""
        self.received += 1
        if sequence <= self.newest:
            self.late += 1
            return False
        self.newest = sequence
        return True

    @property
    def lost(self) -> int:
        """Sequence numbers up to the newest that have not arrived (a late one may still come)."""
        return max(0, self.newest - self.received)
