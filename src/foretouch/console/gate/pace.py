"""How much a page may send: what no person at a mouse reaches."""

from __future__ import annotations

__all__ = ["LARGEST_BACKLOG", "MOST_BYTES", "MOST_CONNECTIONS", "MOST_PAGES", "READ_AT_ONCE", "Volume", "Wait"]

RATE, BURST = 250.0, 500.0
"""Messages per second that are heard of one page in the long run, and at once after a pause: a mouse that drags causes
fewer than 100. What comes faster waits where it comes from."""
MOST_BYTES = 262_144
"""A page that sends more within a second is cut off: it sends some 30 kB when a mouse drags. Frames that say nothing
(pings, empty ones) cost some microseconds each and do not wait."""
READ_AT_ONCE = 8_192
"""Between two reads of one page the others have their turn [byte]: some 1,300 pings of 6 bytes, a few milliseconds."""
LARGEST_BACKLOG = 16_777_216
"""A page that sends while more than so much waits for it to be read is cut off [byte]."""
MOST_PAGES = 16
"""Pages that may be open at once."""
MOST_CONNECTIONS = 200
"""Connections that may be open at once, with those that have not said yet what they want; files and the session's own
connections need theirs of the usual 1,024."""


class Wait:
    """How long the next message of a page has to wait (a leaky bucket)."""

    def __init__(self) -> None:
        self._due = 0.0

    def next(self, now: float) -> float:
        """Count one message.

        Args:
            now: By a monotonic clock [s].

        Returns:
            How long it has to wait [s]; not positive where it need not.
        """
        self._due = max(self._due, now - BURST / RATE) + 1.0 / RATE
        return self._due - now


class Volume:
    """What a page has sent in the second that runs."""

    def __init__(self) -> None:
        self._since, self._bytes = 0.0, 0

    def too_much(self, now: float, size: int) -> bool:
        """Count bytes that have come, and whether they are too many.

        Args:
            now: By a monotonic clock [s].
            size: [byte].
        """
        if now - self._since > 1.0:
            self._since, self._bytes = now, 0
        self._bytes += size
        return self._bytes > MOST_BYTES
