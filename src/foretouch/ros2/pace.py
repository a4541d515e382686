"""How many messages of a kind go out."""

from __future__ import annotations

import math

from foretouch.errors import SettingError

__all__ = ["Pace"]

EARLY, EARLY_NS = 0.25, 250_000
"""A message may be earlier than its turn by so much of a period, and at most so much [ns]: ticks are not quite even."""


class Pace:
    """Lets through at most so many messages a second, evenly, and none that is older than one before.

    Args:
        rate: Messages a second, above 0 and finite.

    Raises:
        SettingError: The rate is none.
    """

    __slots__ = ("_early_ns", "_newest_ns", "_period_ns", "_turn_ns")

    def __init__(self, rate: float) -> None:
        if not 0.0 < rate < math.inf:
            raise SettingError("rate", rate, "must be above 0 messages a second")
        self._period_ns = 1e9 / rate
        self._early_ns = min(EARLY * self._period_ns, EARLY_NS)
        self._turn_ns = self._newest_ns = -math.inf

    def is_due(self, now_ns: int) -> bool:
        """Whether a message that was made now goes out; counts it if so."""
        if now_ns <= self._newest_ns or now_ns < self._turn_ns - self._early_ns:
            return False
        self._newest_ns = now_ns
        late = now_ns > self._turn_ns + self._period_ns
        self._turn_ns = (now_ns if late else self._turn_ns) + self._period_ns
        return True
