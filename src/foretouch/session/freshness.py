"""Whether a command is fresh: by its number, and by how long it travelled, seen from the receiver's own clock."""

from __future__ import annotations

from collections import deque
from enum import IntEnum

from foretouch.errors.checks import require

__all__ = ["Arrival", "Freshness"]

MEMORY_NS = 60_000_000_000
"""The smallest transit is that of so long [ns]."""

BLOCK_NS = 1_000_000_000
"""It is kept by blocks of this length [ns]."""

SLACK_NS = 1_000_000_000
"""A command's number may be ahead of its clock by so much [ns], and its clock ahead of ours by ten times that."""


class Arrival(IntEnum):
    """What a command is, when it arrives."""

    FRESH = 0
    STALE = 1
    """It waited somewhere."""
    OVERTAKEN = 2
    """A newer one was here before it, or it was itself: reordered or replayed."""
    FUTURE = 3
    """Its number or its clock is ahead of what can be."""


FRESH, STALE, OVERTAKEN, FUTURE = Arrival


class Freshness:
    r"""Judges the commands of one leader as they arrive.

    With the leader's clock t_s in a command and ours t_r when it comes, the transit is :math:`t_r - t_s`, in which the
    unknown difference of both clocks is always the same. The smallest transit of the last minute is what the network
    needs; a command is stale when its own exceeds that by more than the queueing allowance. So no two clocks are
    compared, and a network that has become slower for good is believed after a minute.

    A leader makes one command a tick: a number that is ahead of the newest by more than its clock says has passed, and
    a second, is from the future. So is a transit that is shorter than the smallest by more than 10 s: no network that
    foretouch is meant for was ever that slow.

    Args:
        allowance: Time that a command may have waited on its way [s], positive.
        sample_period: Of the leader [s], positive.

    Attributes:
        counts: How many commands were what: indexed by `Arrival`.
        newest_ns: When the newest fresh command came [ns]; None before the first.
    """

    __slots__ = ("_allowance_ns", "_number", "_period_ns", "_sent_ns", "_smallest", "counts", "newest_ns")

    def __init__(self, allowance: float, sample_period: float) -> None:
        require("queueing_allowance", allowance, above=0.0)
        require("sample_period", sample_period, above=0.0)
        self._allowance_ns = round(allowance * 1e9)
        self._period_ns = round(sample_period * 1e9)
        self.counts = [0] * len(Arrival)
        self.newest_ns: int | None = None
        self.begin()

    def begin(self) -> None:
        """Another leader, with a clock of its own: what was known of the old one says nothing."""
        self._number = self._sent_ns = 0
        self.begin_way()

    def begin_way(self) -> None:
        """Another way, as where a simulated delay was set anew: what the old one needed says nothing."""
        self._smallest: deque[tuple[int, int]] = deque()  # (begin of the block, transit), transits growing [ns]

    def judge(self, sequence: int, sent_ns: int, now_ns: int) -> Arrival:
        """What a command is that comes now.

        Args:
            sequence: Its number.
            sent_ns: The leader's clock in it [ns].
            now_ns: Our clock [ns].
        """
        smallest, transit = self._smallest, now_ns - sent_ns
        while smallest and smallest[0][0] < now_ns - MEMORY_NS:  # what is older says nothing, whatever comes
            smallest.popleft()
        needed = smallest[0][1] if smallest else transit
        ahead_ns = (sequence - self._number) * self._period_ns
        if transit < needed - 10 * SLACK_NS or (self._number and ahead_ns > sent_ns - self._sent_ns + SLACK_NS):
            found = FUTURE
        else:
            while smallest and smallest[-1][1] >= transit:  # the smallest of each block that no later one has undercut
                smallest.pop()
            if not smallest or now_ns - smallest[-1][0] >= BLOCK_NS:
                smallest.append((now_ns, transit))
            if sequence <= self._number:
                found = OVERTAKEN
            elif transit > needed + self._allowance_ns:
                found = STALE
            else:
                found = FRESH
                self._number, self._sent_ns, self.newest_ns = sequence, sent_ns, now_ns
        self.counts[found] += 1
        return found
