"""Holds the messages of one direction back, loses them and doubles them, as `Faults` says: one fault, one function."""

from __future__ import annotations

import heapq
import random
from collections import deque
from typing import Generic, TypeVar

from foretouch.link.faults import SPELL_SPACING, Faults

__all__ = ["COPY_LATER", "HELD_BACK", "FaultStage"]

T = TypeVar("T")

HELD_BACK = (0.005, 0.05)
"""A message that others are to overtake is held back by so long [s], uniformly distributed."""

COPY_LATER = (0.001, 0.02)
"""The copy of a message comes so much later than the first [s], uniformly distributed."""


MOST_HELD = 2**18
"""Messages that wait, of one direction; more are dropped. With the longest delay, jitter and stall that there are, a
session's own are fewer than 100,000."""


class FaultStage(Generic[T]):
    """Takes messages as they are sent and gives them as they arrive.

    Two messages due at the same moment come out in the order in which they went in. Each fault has random draws of its
    own, made for every message whether they are needed or not, so that one setting does not shift another's.

    Args:
        faults: What to do to them; `change` puts others in their place while it runs.

    Attributes:
        delay: One-way delay [s]; may be changed at any time, for messages that follow.
        dropped: Messages lost so far.
        duplicated: Messages so far that come, or came, a second time.
    """

    def __init__(self, faults: Faults) -> None:
        self.faults = faults
        self.delay = faults.delay
        self.dropped = 0
        self.duplicated = 0
        self._random = random.Random(faults.seed)
        self._reorder = _Extra("reorder", faults.reorder, HELD_BACK, faults.seed) if faults.reorder else None
        self._duplicate = _Extra("duplicate", faults.duplicate, COPY_LATER, faults.seed) if faults.duplicate else None
        self._epoch_ns = 0  # from which outages and stalls count
        self._outage = self._spells("outage", faults.outage)
        self._stall = self._spells("stall", faults.stall)
        self._after_arrival, self._after_loss = faults.loss_transitions
        self._chance_of_loss = faults.loss
        # When each is due, its number, and it: those that come in the order in which they went in, and as a heap those
        # that come before one of these.
        self._waiting: deque[tuple[int, int, T]] = deque()
        self._overtaking: list[tuple[int, int, T]] = []
        self._count = 0
        self._begun = False

    def change(self, *, delay: float, jitter: float, loss: float, outage: float) -> None:
        """Other faults from the next message on; what waits is due when it was.

        The draws go on: the same changes before the same messages give the same arrivals. Where the delay becomes
        shorter, later messages overtake those that wait. A value out of the range of `Faults` counts as the nearest
        one within it, and so does more loss than bursts of the length at hand can make: nothing is raised.

        Args:
            delay: As in `Faults` [s].
            jitter: [s].
            loss: A share.
            outage: [s].
        """
        faults = self.faults.changed(delay=delay, jitter=jitter, loss=loss, outage=outage)
        if faults.outage != self.faults.outage:
            self._outage = self._spells("outage", faults.outage)
        if faults.loss != self.faults.loss:
            self._after_arrival, self._after_loss = faults.loss_transitions
            self._chance_of_loss = faults.loss
        self.faults, self.delay = faults, faults.delay

    def _spells(self, name: str, length: float) -> _Spells | None:
        return _Spells(name, length, self.faults.seed, self._epoch_ns) if length else None

    def push(self, now_ns: int, message: T) -> None:
        """Take a message that was sent at `now_ns`, the receiver's clock."""
        draw, faults = self._random.random, self.faults
        # Whether it is lost is one step of the chain, which starts in its long-term mean.
        lost = draw() < self._chance_of_loss
        self._chance_of_loss = self._after_loss if lost else self._after_arrival
        delay = max(0.0, self.delay + faults.jitter * (-1.0 + 2.0 * draw()))
        if self._reorder is not None:
            delay += self._reorder.draw()
        copied = self._duplicate.draw() if self._duplicate is not None else 0.0
        if not (lost or self._begun):
            self._begin(now_ns)
        if lost or (self._outage is not None and self._outage.end_ns(now_ns) is not None):
            self.dropped += 1
            return
        self._hold(now_ns + round(delay * 1e9), message)
        if copied:
            self.duplicated += 1
            self._hold(now_ns + round((delay + copied) * 1e9), message)

    def pop_due(self, now_ns: int) -> list[T]:
        """Messages that are due by `now_ns`, earliest first."""
        due: list[T] = []
        waiting, overtaking = self._waiting, self._overtaking
        while overtaking and overtaking[0][0] <= now_ns:
            while waiting and waiting[0] < overtaking[0]:
                due.append(waiting.popleft()[2])
            due.append(heapq.heappop(overtaking)[2])
        while waiting and waiting[0][0] <= now_ns:
            due.append(waiting.popleft()[2])
        return due

    def _begin(self, now_ns: int) -> None:
        """Outages and stalls count their time from the first message that is not lost by chance."""
        self._begun, self._epoch_ns = True, now_ns
        for spells in (self._outage, self._stall):
            if spells is not None:
                spells.epoch_ns = now_ns

    def _hold(self, due_ns: int, message: T) -> None:
        if len(self._waiting) + len(self._overtaking) >= MOST_HELD:
            self.dropped += 1
            return
        if self._stall is not None and (end_ns := self._stall.end_ns(due_ns)) is not None:
            due_ns = end_ns
        self._count += 1
        if self._waiting and due_ns < self._waiting[-1][0]:
            heapq.heappush(self._overtaking, (due_ns, self._count, message))
        else:
            self._waiting.append((due_ns, self._count, message))


class _Extra:
    """A further delay for a share of messages.

    A generator of its own, asked twice for every message: whose turn it is depends on the seed and the message's
    number alone, and of two shares the larger takes the messages of the smaller and more.
    """

    def __init__(self, name: str, share: float, bounds: tuple[float, float], seed: int) -> None:
        self._share = share
        self._least, self._range = bounds[0], bounds[1] - bounds[0]
        self._random = random.Random(f"{seed}/{name}").random

    def draw(self) -> float:
        """The next message's further delay [s], 0 if it is not among the share."""
        chance, part = self._random(), self._random()
        return self._least + self._range * part if chance < self._share else 0.0


class _Spells:
    """One spell of the same length at a seeded moment within every `SPELL_SPACING` seconds; they never overlap.

    A generator for each: when spells happen depends on the seed, not on how many messages were sent.
    """

    def __init__(self, name: str, length: float, seed: int, epoch_ns: int) -> None:
        self.epoch_ns = epoch_ns
        self._name = f"{seed}/{name}"
        self._length = length
        self._window = -1
        self._start = self._end = 0.0

    def end_ns(self, moment_ns: int) -> int | None:
        """End [ns] of the spell that goes on at `moment_ns`, None between spells."""
        elapsed = (moment_ns - self.epoch_ns) * 1e-9
        window = int(elapsed // SPELL_SPACING)
        if window != self._window:
            moment = random.Random(f"{self._name}/{window}").random()
            self._window = window
            self._start = window * SPELL_SPACING + moment * (SPELL_SPACING - self._length)
            self._end = self._start + self._length
        return self.epoch_ns + round(self._end * 1e9) if self._start <= elapsed < self._end else None
