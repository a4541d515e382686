"""How many messages are lost on their way, from what both sides count and say twice a second."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from foretouch.console.window import NAN, Array
from foretouch.messages import CHANNELS, COUNT_PREFIX

__all__ = ["LossTrace", "Losses"]

OVER = 2.5
"""A share is taken over so long [s]."""
KEPT = 10.0
"""[s]."""
MOST = 1024
"""Each side says its counters twice a second; of more, the newest are kept."""
COUNTERS = {"follower": ("commands_lost", CHANNELS["command"].rate), "leader": ("telemetry_lost", 1000.0)}
"""By who counts: what, and how many a second would be all."""


class LossTrace(NamedTuple):
    """Losses over time, both ways; all arrays have one length.

    Attributes:
        time: Seconds before now, increasing.
        there: Share of the commands that were lost shortly before [%]; NaN where nobody has said.
        back: Share of the telemetry [%].
    """

    time: Array
    there: Array
    back: Array


class Losses:
    """Counters of both sides as they come, and the shares that they make.

    One thread stores, another reads.
    """

    def __init__(self) -> None:
        self._counts: dict[str, deque[tuple[float, int]]] = {role: deque(maxlen=MOST) for role in COUNTERS}
        self._shares: deque[tuple[float, float, float]] = deque(maxlen=MOST)
        self._newest = dict.fromkeys(COUNTERS, NAN)

    def take(self, role: str, texts: Mapping[str, str], now: float) -> None:
        """A side has said its counters.

        Args:
            role: Of the side.
            texts: Of its `Hello`.
            now: When it was heard [s].
        """
        if role not in COUNTERS:
            return
        name, rate = COUNTERS[role]
        text = texts.get(COUNT_PREFIX + name, "")
        if not (text.isascii() and text.isdigit() and len(text) < 20):
            return
        counts, count = self._counts[role], int(text)
        if counts and count < counts[-1][1]:  # a process that began anew
            counts.clear()
        counts.append((now, count))
        while len(counts) > 2 and counts[0][0] < now - OVER:
            counts.popleft()
        since, before = counts[0]
        if now > since:
            self._newest[role] = min(100.0 * (count - before) / (rate * (now - since)), 100.0)
            self._shares.append((now, self._newest["follower"], self._newest["leader"]))
        while self._shares and self._shares[0][0] < now - KEPT:
            self._shares.popleft()

    def trace(self, now: float, seconds: float) -> LossTrace:
        """The last seconds."""
        rows = np.array([row for row in tuple(self._shares) if row[0] >= now - seconds]).reshape(-1, 3)
        return LossTrace(rows[:, 0] - now, rows[:, 1], rows[:, 2])
