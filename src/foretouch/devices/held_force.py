"""The force that a simulated device really gives: as late as it is, and no longer than its watchdog lets it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

__all__ = ["HeldForce"]

F = TypeVar("F")


class HeldForce(Generic[F]):
    """A force that is held from one `render` to the next.

    It begins to act a delay after it was rendered, and ends where the watchdog's time has passed since it began.

    Args:
        none: No force.
        delay: From rendering until it acts [s], not negative.
        watchdog: [s]; 0 for none.
    """

    __slots__ = ("_delay_ns", "_due", "_ends_ns", "_force", "_none", "_watchdog_ns")

    def __init__(self, none: F, delay: float, watchdog: float) -> None:
        self._none = self._force = none
        self._delay_ns = round(delay * 1e9)
        self._watchdog_ns = round(watchdog * 1e9) if watchdog > 0.0 else 0
        self._ends_ns = 0
        self._due: deque[tuple[int, F]] = deque()

    def render(self, force: F, now_ns: int) -> None:
        """Give this force from a delay after now [ns] on."""
        begins = now_ns + self._delay_ns
        if self._due and self._due[-1][0] >= begins:
            self._due.pop()
        self._due.append((begins, force))

    def over(self, begin_ns: int, end_ns: int) -> Iterator[tuple[float, F]]:
        """The forces between two times that never go back: each with how long it acts [s]."""
        due, time_ns = self._due, begin_ns
        while time_ns < end_ns:
            while due and due[0][0] <= time_ns:
                begins, self._force = due.popleft()
                self._ends_ns = begins + self._watchdog_ns
            acts = not self._watchdog_ns or time_ns < self._ends_ns
            until_ns = min(end_ns, due[0][0]) if due else end_ns
            if acts and self._watchdog_ns:
                until_ns = min(until_ns, self._ends_ns)
            yield (until_ns - time_ns) * 1e-9, self._force if acts else self._none
            time_ns = until_ns
