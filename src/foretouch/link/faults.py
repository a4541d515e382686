"""Network faults of our own, seeded: delay, jitter, loss, outages. The same stage serves both runners."""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass
from typing import Generic, TypeVar

from foretouch.errors import SettingError

__all__ = ["LONGEST_DELAY", "OUTAGE_SPACING", "FaultStage", "Faults"]

T = TypeVar("T")

LONGEST_DELAY = 10.0
"""Delays beyond this [s] are refused: they are in other units."""

OUTAGE_SPACING = 10.0
"""One outage begins at a seeded moment within every so many seconds."""


@dataclass(frozen=True, slots=True)
class Faults:
    """What one direction of the network does to messages.

    Args:
        delay: One-way delay [s], 0 to 10.
        jitter: Largest change of the delay, to either side, uniformly distributed and drawn for each message [s];
            messages may overtake each other. The delay never falls below 0.
        loss: Share of messages lost, independently, 0 to 1.
        outage: Length of an outage [s], 0 to 10; one begins at a random moment of every 10 s, and what is sent
            meanwhile is lost.
        seed: Of the random draws.

    Raises:
        SettingError: A value out of range.
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    outage: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, largest in (("delay", LONGEST_DELAY), ("jitter", LONGEST_DELAY), ("outage", OUTAGE_SPACING)):
            value = getattr(self, name)
            if not 0.0 <= value <= largest:
                raise SettingError(name, value, f"must lie between 0 and {largest:g} s")
        if not 0.0 <= self.loss <= 1.0:
            raise SettingError("loss", self.loss, "is a share and must lie between 0 and 1")


class FaultStage(Generic[T]):
    """Holds messages of one direction back until they are due.

    Two messages due at the same moment come out in the order in which they went in.

    Args:
        faults: What to do to them.

    Attributes:
        delay: One-way delay [s]; may be changed at any time, for messages that follow.
        dropped: Messages lost so far.
    """

    def __init__(self, faults: Faults) -> None:
        self.faults = faults
        self.delay = faults.delay
        self.dropped = 0
        self._random = random.Random(faults.seed)
        self._waiting: list[tuple[int, int, T]] = []
        self._count = 0
        self._epoch_ns: int | None = None
        self._outage_window = -1
        self._outage_start = 0.0

    def push(self, now_ns: int, message: T) -> None:
        """Take a message that was sent at `now_ns`, the receiver's clock."""
        # Drawn for every message, so that one setting does not shift the draws of another.
        chance, spread = self._random.random(), self._random.uniform(-1.0, 1.0)
        if chance < self.faults.loss or self._in_outage(now_ns):
            self.dropped += 1
            return
        delay = max(0.0, self.delay + self.faults.jitter * spread)
        self._count += 1
        heapq.heappush(self._waiting, (now_ns + round(delay * 1e9), self._count, message))

    def pop_due(self, now_ns: int) -> list[T]:
        """Messages that are due by `now_ns`, earliest first."""
        due: list[T] = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            due.append(heapq.heappop(self._waiting)[2])
        return due

    def _in_outage(self, now_ns: int) -> bool:
        if not self.faults.outage:
            return False
        if self._epoch_ns is None:
            self._epoch_ns = now_ns
        elapsed = (now_ns - self._epoch_ns) * 1e-9
        window = int(elapsed // OUTAGE_SPACING)
        if window != self._outage_window:
            # A generator of its own: when outages happen depends on the seed, not on how many messages were sent.
            moment = random.Random(f"{self.faults.seed}/outage/{window}").random()
            self._outage_window = window
            self._outage_start = window * OUTAGE_SPACING + moment * (OUTAGE_SPACING - self.faults.outage)
        return self._outage_start <= elapsed < self._outage_start + self.faults.outage
