"""An even stream of positions from commands that arrive unevenly, and which commands are fresh.

Freshness goes by a command's number, and by how long it travelled, seen from the receiver's own clock.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right, insort
from collections import deque
from collections.abc import Callable
from enum import IntEnum

from foretouch.errors.checks import require
from foretouch.quantities import LARGEST_POSITION

MEMORY_NS = 60_000_000_000  # Time over which the smallest transit is taken [ns]
BLOCK_NS = 1_000_000_000  # The smallest transit is kept by blocks of this length [ns]

SLACK_NS = 1_000_000_000
"""Largest lead of a command's number over its clock [ns]; its clock may lead ours by ten times that."""


class Arrival(IntEnum):
    """Judgement of a command on arrival."""

    FRESH = 0
    STALE = 1
    """It waited somewhere on its way."""
    OVERTAKEN = 2
    """It or a newer one had already arrived: reordered or replayed."""
    FUTURE = 3
    """Its number or its clock is impossibly far ahead."""


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
        """Start again with another leader: the old one's clock does not apply to it."""
        self._number = self._sent_ns = 0
        self.begin_way()

    def begin_way(self) -> None:
        """Start again with another path, as after a change of a simulated delay: the old transit does not apply."""
        self._smallest: deque[tuple[int, int]] = deque()  # (begin of the block, transit), transits growing [ns]

    def judge(self, sequence: int, sent_ns: int, now_ns: int) -> Arrival:
        """Judge a command with this number and time of its leader's clock [ns] that arrives now, by our clock [ns]."""
        smallest, transit = self._smallest, now_ns - sent_ns
        while smallest and smallest[0][0] < now_ns - MEMORY_NS:  # what is older says nothing, whatever comes
            smallest.popleft()
        needed = smallest[0][1] if smallest else transit
        ahead_ns = (sequence - self._number) * self._period_ns
        if transit < needed - 10 * SLACK_NS or (self._number and ahead_ns > sent_ns - self._sent_ns + SLACK_NS):
            result = FUTURE
        else:
            while smallest and smallest[-1][1] >= transit:  # the smallest of each block that no later one has undercut
                smallest.pop()
            if not smallest or now_ns - smallest[-1][0] >= BLOCK_NS:
                smallest.append((now_ns, transit))
            if sequence <= self._number:
                result = OVERTAKEN
            elif transit > needed + self._allowance_ns:
                result = STALE
            else:
                result = FRESH
                self._number, self._sent_ns, self.newest_ns = sequence, sent_ns, now_ns
        self.counts[result] += 1
        return result


LONGEST_BRIDGE = 250
"""Number of periods in which playback reaches the newest command after an outage; commands between are not played."""

LARGEST_LEAD = 2 * LONGEST_BRIDGE  # Lead above which there was an outage [periods]; a smaller one is reduced gradually

LOOK_BACK = 500
"""Number of ticks over one to two times which the smallest lead is taken, which shows how much of it is needed."""

LARGEST_HASTE = 1.0  # Largest increase of the pace: at most twice the pace of sending
HASTE_PER_LEAD = 0.004  # Pace added for each period of lead that was never needed


class Playout:
    """Plays commands in the rhythm in which they were sent, a tick a command, as late as their jitter demands.

    The newest command is taken at once for as long as one comes a tick. Where a tick finds none, the last position is
    held, and from then on the stream is played that much later, so that the same unevenness does not show again: a
    robot that is commanded 0, 1, 0, 2 steps in turn shakes. Missing commands are interpolated. A lead that has not been
    needed for a while is reduced by playing a little faster than sent. Only sequence numbers count; no two clocks are
    compared.

    Args:
        go: In three dimensions: moves towards a position [m], and returns the coordinate [m] reached along the
            surface's normal. It is called with each position that is played.

    Attributes:
        applied: Sequence number of the newest command at or before the playback point; 0 before the first.
        position: Position played now [m]; NaN before the first command.
        place: The same in three dimensions, where commands have positions in space; empty otherwise.
    """

    def __init__(self, go: Callable[[tuple[float, ...]], float] | None = None) -> None:
        self._go = go
        self.restart()

    def restart(self) -> None:
        """Start again with another leader, which counts from 1: nothing is left to play, and the position is NaN."""
        self._commands: list[tuple[float, float]] = []  # (sequence, position), those still needed, in order
        self._positions: dict[float, tuple[float, ...]] = {}  # by sequence, of those still needed
        self._point = math.nan  # what is played, in sequence numbers
        self._least = self._least_before = math.inf
        self._ticks = 0
        self.applied = 0
        self.position = math.nan
        self.place: tuple[float, ...] = ()

    def forget(self) -> None:
        """Drop all positions not yet played; the position is NaN until the next command comes."""
        self._commands.clear()
        self._positions.clear()
        self._point = self.position = math.nan
        self.place = ()

    def push(self, sequence: int, position: float, place: tuple[float, ...] = ()) -> None:
        """Take one command; it is dropped if it comes after its turn, or has no position within a metre."""
        if not abs(position) <= LARGEST_POSITION or sequence <= self._point:
            return
        commands = self._commands
        if not commands or commands[-1][0] < sequence:
            commands.append((sequence, position))
        elif commands[bisect_left(commands, (sequence, -math.inf))][0] != sequence:
            insort(commands, (sequence, position))
        else:
            return
        if place:
            self._positions[sequence] = place

    def advance(self) -> float:
        """Play one tick and return the position [m]."""
        self._advance()
        return self.position if self._go is None or not self.place else self._go(self.place)

    def _advance(self) -> None:
        commands = self._commands
        if not commands:
            return
        newest = commands[-1][0]
        lead = newest - self._point
        if lead > LARGEST_LEAD:
            self._bridge(newest)
        elif lead >= 0.0:
            point = self._point + 1.0 + self._haste(lead)
            self._point = point if point < newest else newest
        else:  # the first: nothing was played before it
            self._point = newest
        self._play(newest)

    def _haste(self, lead: float) -> float:
        """Increase of the pace over that of sending, from the smallest lead of the last ticks."""
        if lead < self._least:
            self._least = lead
        self._ticks += 1
        if self._ticks == LOOK_BACK:
            self._least_before, self._least, self._ticks = self._least, lead, 0
        if lead <= 1.0:  # one came since the last tick: that is no lead
            return 0.0
        unneeded = min(self._least, self._least_before) - 1.0
        return min(LARGEST_HASTE, HASTE_PER_LEAD * unneeded) if 0.0 < unneeded < math.inf else 0.0

    def _bridge(self, newest: float) -> None:
        """Move from the robot's position to the newest command, in `LONGEST_BRIDGE` periods."""
        self._point = newest - LONGEST_BRIDGE
        self._commands[:-1] = [(self._point, self.position)]
        if self.place:
            self._positions = {self._point: self.place, newest: self._positions.get(newest, self.place)}
        self._least = self._least_before = math.inf
        self._ticks = 0

    def _play(self, newest: float) -> None:
        """Interpolate at the playback point, and drop positions before it."""
        commands, positions, point = self._commands, self._positions, self._point
        after = len(commands) if point >= newest else bisect_right(commands, (point, math.inf))
        if not after:
            return
        sequence, self.position = commands[after - 1]
        if sequence > self.applied:
            self.applied = int(sequence)
        if positions:
            self.place = positions.get(sequence, self.place)
        if after < len(commands):
            to, there = commands[after]
            fraction = (point - sequence) / (to - sequence)
            self.position += (there - self.position) * fraction
            self._between(positions.get(to, ()), fraction)
        if after > 1:
            if positions:
                for old, _ in commands[: after - 1]:
                    positions.pop(old, None)
            del commands[: after - 1]

    def _between(self, there: tuple[float, ...], fraction: float) -> None:
        """Interpolate the position in space."""
        if len(there) == len(self.place):
            self.place = tuple(a + (b - a) * fraction for a, b in zip(self.place, there, strict=True))
