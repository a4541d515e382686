"""How many messages are lost on their way, and how late both loops are."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from foretouch.console.window import NAN, Array
from foretouch.messages import CHANNELS, COUNT_PREFIX

__all__ = ["LATE", "Lateness", "LossTrace", "Losses"]

OVER = 2.5
"""A share is taken over so long [s]."""
KEPT = 10.0
"""[s]."""
MOST = 1024
"""Each side says its counters twice a second; of more, the newest are kept."""
COUNTERS = {"follower": ("commands_lost", CHANNELS["command"].rate), "leader": ("telemetry_lost", 1000.0)}
"""By who counts: what, and how many a second would be all."""


LATE_NS = 1_500_000
"""A tick is late that begins so long after the one before [ns]."""
LOOKS = 6
"""The share of late ticks is taken over so many looks."""
LATE = 5.0
"""A machine is said to be late from this share of late ticks on [%]; a quiet one has about 1 %."""
GIVE_WAY, TAKE_BACK = 0.6, 1.15
"""By how much a picture rate changes at a look while the loops are late, and while they are not."""
SLOWEST, FASTEST = 4.0, 30.0
"""Pictures a second. Fewer than the slowest, and the page could not tell a slow console from one that is gone."""


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


class Lateness:
    """How late the ticks of both sides are, and how many pictures a second leave them their processor.

    Who draws on the machine of the loops takes its time from them; so while they are late fewer pictures are drawn.
    One thread calls `take`, another `look`.

    Attributes:
        late: Share of late ticks over the last looks [%], by side.
        pictures: So many a second are to be drawn.
    """

    def __init__(self) -> None:
        self._counted = {"leader": [0, 0], "follower": [0, 0]}
        self._looks: deque[dict[str, tuple[int, int]]] = deque(maxlen=LOOKS)
        self.late: Mapping[str, float] = {}
        self.pictures = FASTEST / 2

    def take(self, side: str, period_ns: int) -> None:
        """Count a tick of a side that began so long after the one before [ns]."""
        counted = self._counted[side]
        counted[0] += 1
        counted[1] += period_ns > LATE_NS

    def look(self) -> None:
        """Take the shares, and more or fewer pictures; to be called about twice a second."""
        now = {side: (ticks, late) for side, (ticks, late) in self._counted.items()}
        if self._looks:
            newest = _shares(self._looks[-1], now)
            if newest:
                factor = GIVE_WAY if max(newest.values()) > LATE else TAKE_BACK
                self.pictures = min(max(self.pictures * factor, SLOWEST), FASTEST)
            self.late = _shares(self._looks[0], now)
        self._looks.append(now)


def _shares(before: Mapping[str, tuple[int, int]], now: Mapping[str, tuple[int, int]]) -> dict[str, float]:
    """Share of late ticks [%] between two counts, of each side that made any."""
    made = {side: (now[side][0] - before[side][0], now[side][1] - before[side][1]) for side in now}
    return {side: 100.0 * late / ticks for side, (ticks, late) in made.items() if ticks}
