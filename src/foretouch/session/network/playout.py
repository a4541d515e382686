"""An even stream of positions from commands that arrive unevenly."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel, Record, compiled, kernel
from foretouch.quantities import LARGEST_POSITION
from foretouch.quantities.pose import Vector

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
def forget(playing: Playing) -> None:
    """See `Playout.forget`."""
    playing.kept = False
    playing.numbers[:] = -1
    playing.point = playing.position = math.nan
    playing.place[:] = math.nan


@compiled
def restart(playing: Playing) -> None:
    """See `Playout.restart`."""
    forget(playing)
    playing.first = playing.newest = playing.ticks = playing.applied = 0
    playing.least = playing.least_before = math.inf
    playing.surface = math.nan


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


_forget, _restart = Kernel(forget, "(Playing,)"), Kernel(restart, "(Playing,)")

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
        _ = _forget.entry, _restart.entry  # asked for, they are compiled or loaded: nothing of that in the loop
        self._playings = Playing.new() if playings is None else playings
        self._applied = self._playings["applied"]

    @property
    def applied(self) -> int:
        """Sequence number of the newest command at or before the playback point; 0 before the first."""
        result: int = self._applied.item()
        return result

    def restart(self) -> None:
        """Start again with another leader, which counts from 1: nothing is left to play, and the position is NaN."""
        _restart.entry(self._playings[0])

    def forget(self) -> None:
        """Drop all positions not yet played; the position is NaN until the next command comes."""
        _forget.entry(self._playings[0])

    def push(self, sequence: int, position: float, place: tuple[float, ...] = (), surface: float = math.nan) -> None:
        """Take one command, whose leader is known to have a surface; dropped if it comes after its turn, or is far."""
        x, y, z = place if len(place) == 3 else NOWHERE
        self._push(self._playings, sequence, position, (x, y, z), surface)

    def advance(self) -> float:
        """Play one tick and return the position [m]."""
        return self._advance(self._playings)
