"""Which commands of one leader are fresh: by their number, and by how long they travelled, seen from our own clock."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, Any

from numpy.typing import NDArray

from foretouch.core import Held, Record, compiled, kernel
from foretouch.errors.checks import require

MEMORY_NS = 60_000_000_000  # Time over which the smallest transit is taken [ns]
BLOCK_NS = 1_000_000_000  # The smallest transit is kept by blocks of this length [ns]
BLOCKS = 64  # Blocks for which there is room: a few more than that time has

SLACK_NS, CLOCK_SLACK_NS = 1_000_000_000, 10_000_000_000
"""Largest lead of a command's number over its clock, and of its clock over ours [ns]."""

FARTHEST_AHEAD = 1_000_000_000  # Lead of a number that counts as one that is larger still [commands]


class Arrival(IntEnum):
    """Judgement of a command on arrival."""

    FRESH = 0
    STALE = 1
    """It waited somewhere on its way."""
    OVERTAKEN = 2
    """It or a newer one had already arrived: reordered or replayed."""
    FUTURE = 3
    """Its number or its clock is impossibly far ahead."""


FRESH, STALE, OVERTAKEN, FUTURE = map(int, Arrival)


class Judging(Record):
    """State of a `Freshness`."""

    allowance_ns: int  # that a command may have waited on its way [ns]
    period_ns: int  # of the leader [ns]
    number: int  # of the newest fresh command, 0 before the first
    sent_ns: int  # its leader's clock [ns]
    newest_ns: int = -1  # when it came, by our clock [ns]; negative before the first of any leader
    counts: Annotated[NDArray[Any], int, len(Arrival)]  # of commands, by `Arrival`
    first: int  # place of the oldest block in the rings below
    blocks: int  # how many there are
    begun_ns: Annotated[NDArray[Any], int, BLOCKS]  # when each began, a ring [ns]
    transits_ns: Annotated[NDArray[Any], int, BLOCKS]  # smallest of each that no later one has undercut: they grow [ns]


@compiled
def begin(judging: Judging) -> None:
    """See `Freshness.begin`."""
    judging.number = judging.sent_ns = judging.blocks = 0


@compiled
def _remember(judging: Judging, transit: int, now_ns: int) -> None:
    """Keep a transit [ns], where it is the smallest of its block, and no block that it undercuts."""
    while judging.blocks > 0 and judging.transits_ns[(judging.first + judging.blocks - 1) % BLOCKS] >= transit:
        judging.blocks -= 1
    last = (judging.first + judging.blocks - 1) % BLOCKS
    if judging.blocks == BLOCKS or (judging.blocks > 0 and now_ns - judging.begun_ns[last] < BLOCK_NS):
        return
    end = (judging.first + judging.blocks) % BLOCKS
    judging.begun_ns[end], judging.transits_ns[end] = now_ns, transit
    judging.blocks += 1


@kernel("i8(Judging, i8, i8, i8)")
def judge(judging: Judging, sequence: int, sent_ns: int, now_ns: int) -> int:
    """See `Freshness.judge`."""
    transit = now_ns - sent_ns
    while judging.blocks > 0 and judging.begun_ns[judging.first] < now_ns - MEMORY_NS:  # older says nothing
        judging.first = (judging.first + 1) % BLOCKS
        judging.blocks -= 1
    needed = judging.transits_ns[judging.first] if judging.blocks > 0 else transit
    ahead_ns = max(min(sequence - judging.number, FARTHEST_AHEAD), -FARTHEST_AHEAD) * judging.period_ns
    ahead = judging.number != 0 and ahead_ns - SLACK_NS > sent_ns - judging.sent_ns
    if transit < needed - CLOCK_SLACK_NS or ahead:
        result = FUTURE
    else:
        _remember(judging, transit, now_ns)
        if sequence <= judging.number:
            result = OVERTAKEN
        elif transit > needed + judging.allowance_ns:
            result = STALE
        else:
            result = FRESH
            judging.number, judging.sent_ns, judging.newest_ns = sequence, sent_ns, now_ns
    judging.counts[result] += 1
    return result


class Freshness(Held):
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
        judgings: Array of one `Judging` that this one takes, part of another record; None for one of its own.

    Attributes:
        counts: How many commands were what: indexed by `Arrival`.
        newest_ns: When the newest fresh command came [ns]; None before the first.
    """

    def __init__(self, allowance: float, sample_period: float, *, judgings: NDArray[Any] | None = None) -> None:
        require("queueing_allowance", allowance, above=0.0)
        require("sample_period", sample_period, above=0.0)
        super().__init__(Judging.new() if judgings is None else judgings)
        self.records[:] = Judging.new(allowance_ns=round(allowance * 1e9), period_ns=round(sample_period * 1e9))
        self._judge, self._newest = judge.entry, self.records["newest_ns"]

    @property
    def counts(self) -> list[int]:
        """How many commands were what: indexed by `Arrival`."""
        counts: list[int] = self.records["counts"][0].tolist()
        return counts

    @property
    def newest_ns(self) -> int | None:
        """When the newest fresh command came [ns]; None before the first."""
        newest_ns: int = self._newest.item()
        return None if newest_ns < 0 else newest_ns

    def begin(self) -> None:
        """Start again with another leader: the old one's clock does not apply to it."""
        self.number = self.sent_ns = self.blocks = 0

    def begin_way(self) -> None:
        """Start again with another path, as after a change of a simulated delay: the old transit does not apply."""
        self.blocks = 0

    def judge(self, sequence: int, sent_ns: int, now_ns: int) -> Arrival:
        """Judge a command with this number and time of its leader's clock [ns] that arrives now, by our clock [ns]."""
        return _ARRIVALS[self._judge(self.records[0], sequence, sent_ns, now_ns)]


_ARRIVALS = tuple(Arrival)
