"""How often a loop ticks, and whether that is enough to be safe."""

from __future__ import annotations

from array import array

__all__ = ["AGAIN_FROM", "LEAST_RATE", "TickRate"]

LEAST_RATE = 500
"""A loop that makes fewer ticks a second than this is too slow: half of what limits and filters are made for."""

AGAIN_FROM = 600
"""A loop that was too slow is fast enough again from so many ticks a second on: one that stays about the limit does not
come and go."""

WINDOW = 500
"""The rate is that of so many ticks: a second at the least rate, half a second at the usual one."""

LONGEST_NS = 250_000_000
"""A tick counts for at most so long [ns]: a process that stood still once is not slow."""

_USUAL_NS = 1_000_000
"""Before there was a tick the loop counts as in time [ns]."""


class TickRate:
    """Whether a loop is too slow, by the time that its last 500 ticks took: constant time and memory a tick.

    It is too slow where they took longer than 1 s, that is below 500 a second, and until they have taken less than
    0.83 s, 600 a second.

    Attributes:
        too_slow: The newest judgement.
    """

    __slots__ = ("_next", "_periods", "_total", "too_slow")

    def __init__(self) -> None:
        self._periods = array("q", [_USUAL_NS]) * WINDOW
        self._total = WINDOW * _USUAL_NS
        self._next = 0
        self.too_slow = False

    def update(self, period_ns: int) -> bool:
        """Take one tick; whether the loop is too slow.

        Args:
            period_ns: Since the tick before began [ns]; 0 in the first.
        """
        period_ns = min(max(period_ns, 0), LONGEST_NS)
        at = self._next
        self._total += period_ns - self._periods[at]
        self._periods[at] = period_ns
        self._next = at + 1 if at + 1 < WINDOW else 0
        rate = AGAIN_FROM if self.too_slow else LEAST_RATE
        self.too_slow = self._total * rate > WINDOW * 1_000_000_000
        return self.too_slow
