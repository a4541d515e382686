"""An even stream of positions from commands that arrive unevenly, and which commands are fresh.

Freshness goes by a command's number, and by how long it travelled, seen from the receiver's own clock.
"""

from __future__ import annotations

import math
from collections import deque
from enum import IntEnum
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.errors.checks import require
from foretouch.quantities import LARGEST_POSITION
from foretouch.quantities.pose import Vector

MEMORY_NS = 60_000_000_000  # Time over which the smallest transit is taken [ns]
BLOCK_NS = 1_000_000_000  # The smallest transit is kept by blocks of this length [ns]

SLACK_NS, CLOCK_SLACK_NS = 1_000_000_000, 10_000_000_000
"""Largest lead of a command's number over its clock, and of its clock over ours [ns]."""


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
        if transit < needed - CLOCK_SLACK_NS or (self._number and ahead_ns > sent_ns - self._sent_ns + SLACK_NS):
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


ROOM = 1024
"""Commands for which there is room: more than twice the largest lead. They keep their place by the remainder of their
number."""


class Playing(Record):
    """State of a `Playout`."""

    kept: bool  # whether there are commands
    first: int  # number of the oldest command that is kept: the one that is played, or left behind last
    newest: int  # number of the newest
    point: float = math.nan  # what is played, in sequence numbers
    position: float = math.nan  # that is played [m]
    place: Annotated[NDArray[Any], float, 3] = math.nan  # type: ignore[assignment]  # in space [m]
    least: float = math.inf  # smallest lead of the ticks since it began anew
    least_before: float = math.inf  # and of those before
    ticks: int  # since it began anew
    applied: int  # number of the newest command at or before the point
    surface: float = math.nan  # that the leader of that command is known to have, NaN for none [m]
    numbers: Annotated[NDArray[Any], int, ROOM] = -1  # type: ignore[assignment]  # of the commands that are kept
    positions: Annotated[NDArray[Any], float, ROOM]  # theirs [m]
    places: Annotated[NDArray[Any], float, (ROOM, 3)]  # in space [m]
    surfaces: Annotated[NDArray[Any], float, ROOM]  # that their leader had [m]


@compiled
def _keep(playing: Playing, number: int, position: float, place: Vector, surface: float) -> None:
    at = number % ROOM
    playing.numbers[at], playing.positions[at], playing.surfaces[at] = number, position, surface
    playing.places[at, 0], playing.places[at, 1], playing.places[at, 2] = place


@kernel("(Playing[::1], i8, f8, UniTuple(f8, 3), f8)")
def push(playings: NDArray[np.void], number: int, position: float, place: Vector, surface: float) -> None:
    """See `Playout.push`."""
    playing = playings[0]
    if not abs(position) <= LARGEST_POSITION or number <= playing.point:
        return
    older = playing.kept and number < playing.newest
    # Where nothing is played yet, or the playback will be led over an outage, all but the newest is dropped.
    if older and not playing.newest - playing.point <= LARGEST_LEAD:
        return
    if playing.numbers[number % ROOM] == number:
        return
    _keep(playing, number, position, place, surface)
    if not playing.kept:
        playing.first = number
    if not older:
        playing.newest = number
    playing.kept = True


@compiled
def _haste(playing: Playing, lead: float) -> float:
    """Increase of the pace over that of sending, from the smallest lead of the last ticks."""
    playing.least = min(playing.least, lead)
    playing.ticks += 1
    if playing.ticks == LOOK_BACK:
        playing.least_before, playing.least, playing.ticks = playing.least, lead, 0
    if lead <= 1.0:  # one came since the last tick: that is no lead
        return 0.0
    unneeded = min(playing.least, playing.least_before) - 1.0
    return min(LARGEST_HASTE, HASTE_PER_LEAD * unneeded) if 0.0 < unneeded < math.inf else 0.0


@compiled
def _bridge(playing: Playing) -> None:
    """Move from the robot's position to the newest command, in `LONGEST_BRIDGE` periods."""
    newest, at = playing.newest, playing.newest % ROOM
    position, place = playing.positions[at], (playing.places[at, 0], playing.places[at, 1], playing.places[at, 2])
    playing.numbers[:] = -1
    playing.first = newest - LONGEST_BRIDGE
    playing.point = float(playing.first)
    _keep(playing, newest, position, place, playing.surfaces[at])
    here = playing.place[0], playing.place[1], playing.place[2]
    _keep(playing, playing.first, playing.position, here, playing.surface)
    playing.least = playing.least_before = math.inf
    playing.ticks = 0


@compiled
def _play(playing: Playing) -> None:
    """Interpolate at the playback point, and drop positions before it."""
    numbers, point, newest, first = playing.numbers, playing.point, playing.newest, playing.first
    after = first + 1
    while after <= newest and (after <= point or numbers[after % ROOM] != after):
        if numbers[after % ROOM] == after:
            first = after
        after += 1
    playing.first, at = first, first % ROOM
    playing.applied = max(playing.applied, first)
    playing.position, playing.surface = playing.positions[at], playing.surfaces[at]
    for axis in range(3):
        playing.place[axis] = playing.places[at, axis]
    if after <= newest:
        fraction, then = (point - first) / (after - first), after % ROOM
        playing.position += (playing.positions[then] - playing.position) * fraction
        for axis in range(3):
            playing.place[axis] += (playing.places[then, axis] - playing.place[axis]) * fraction


@kernel("f8(Playing[::1])")
def advance(playings: NDArray[np.void]) -> float:
    """Play one tick: the position [m], NaN before the first command."""
    playing = playings[0]
    if playing.kept:
        newest = playing.newest
        lead = newest - playing.point
        if lead > LARGEST_LEAD:
            _bridge(playing)
        elif lead >= 0.0:
            playing.point = min(playing.point + 1.0 + _haste(playing, lead), float(newest))
        else:  # the first: nothing was played before it
            playing.point, playing.first = float(newest), newest
        _play(playing)
    return float(playing.position)


NOWHERE = (math.nan,) * 3


class Playout:
    """Plays commands in the rhythm in which they were sent, a tick a command, as late as their jitter demands.

    The newest command is taken at once for as long as one comes a tick. Where a tick finds none, the last position is
    held, and from then on the stream is played that much later, so that the same unevenness does not show again: a
    robot that is commanded 0, 1, 0, 2 steps in turn shakes. Missing commands are interpolated. A lead that has not been
    needed for a while is reduced by playing a little faster than sent. Only sequence numbers count; no two clocks are
    compared.

    Args:
        playings: Array of one `Playing` for the state, part of another record; None for one of its own.
    """

    __slots__ = ("_advance", "_applied", "_playings", "_push")

    def __init__(self, playings: NDArray[np.void] | None = None) -> None:
        self._push, self._advance = push.entry, advance.entry
        self._playings = Playing.new() if playings is None else playings
        self._applied = self._playings["applied"]

    @property
    def applied(self) -> int:
        """Sequence number of the newest command at or before the playback point; 0 before the first."""
        result: int = self._applied.item()
        return result

    def restart(self) -> None:
        """Start again with another leader, which counts from 1: nothing is left to play, and the position is NaN."""
        self._playings[:] = Playing.new()

    def forget(self) -> None:
        """Drop all positions not yet played; the position is NaN until the next command comes."""
        playing = self._playings[0]
        playing.kept, playing.numbers, playing.point, playing.position, playing.place = False, -1, *NOWHERE

    def push(self, sequence: int, position: float, place: tuple[float, ...] = (), surface: float = math.nan) -> None:
        """Take one command, whose leader is known to have a surface; dropped if it comes after its turn, or is far."""
        x, y, z = place if len(place) == 3 else NOWHERE
        self._push(self._playings, sequence, position, (x, y, z), surface)

    def advance(self) -> float:
        """Play one tick and return the position [m]."""
        return self._advance(self._playings)
