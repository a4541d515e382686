"""Time from sending a model until it is used, by the follower's own clock."""

from __future__ import annotations

import math
from typing import Annotated, Any

from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled

PERIOD_NS = 1_000_000_000  # Interval over which the smallest round trip is taken, and after which it is reported [ns]
ROOM = 4096  # Models and commands for which there is room, by the remainder of their number
NEVER_NS = 2**62  # Where nothing has come back yet [ns]


class Trip(Record):
    """State of a `RoundTrip`."""

    current: int  # model that the leader of the newest applied command rendered from; 0 for none
    applied: int  # newest command
    used: int  # newest model that is known to be used
    smallest_ns: int = NEVER_NS
    due_ns: int = -1  # when that is reported; negative before the first tick
    commands: Annotated[NDArray[Any], int, ROOM] = -1  # type: ignore[assignment]  # that have come
    models: Annotated[NDArray[Any], int, ROOM]  # that their leader had
    sent: Annotated[NDArray[Any], int, ROOM] = -1  # type: ignore[assignment]  # models
    sent_ns: Annotated[NDArray[Any], int, ROOM]  # when they were sent [ns]


@compiled
def restart(trip: Trip) -> None:
    """See `RoundTrip.restart`."""
    trip.commands[:] = -1
    trip.applied = trip.current = 0
    trip.smallest_ns = NEVER_NS


@compiled
def note_sent(trip: Trip, model: int, now_ns: int) -> None:
    """See `RoundTrip.sent`."""
    trip.sent[model % ROOM], trip.sent_ns[model % ROOM] = model, now_ns


@compiled
def note_commanded(trip: Trip, command: int, model: int) -> None:
    """See `RoundTrip.commanded`."""
    if command > trip.applied:
        trip.commands[command % ROOM], trip.models[command % ROOM] = command, model


@compiled
def note_applied(trip: Trip, command: int, now_ns: int) -> float:
    """See `RoundTrip.applied`; NaN in place of None."""
    for number in range(max(trip.applied, command - ROOM) + 1, command + 1):
        at = number % ROOM
        if trip.commands[at] != number:
            continue
        trip.commands[at] = -1
        trip.current = model = trip.models[at]
        # One that is not newer was heard of before; one that was not sent is of another process of the follower.
        if model > trip.used and trip.sent[model % ROOM] == model:
            trip.used = model
            trip.smallest_ns = min(trip.smallest_ns, now_ns - trip.sent_ns[model % ROOM])
    trip.applied = max(trip.applied, command)
    if trip.due_ns < 0:
        trip.due_ns = now_ns + PERIOD_NS
    if now_ns < trip.due_ns:
        return math.nan
    trip.due_ns = now_ns + PERIOD_NS
    smallest_ns, trip.smallest_ns = trip.smallest_ns, NEVER_NS
    return smallest_ns * 1e-9 if smallest_ns < NEVER_NS else math.nan


_restart = Kernel(restart, "(Trip,)")
_sent, _commanded = Kernel(note_sent, "(Trip, i8, i8)"), Kernel(note_commanded, "(Trip, i8, i8)")
_applied = Kernel(note_applied, "f8(Trip, i8, i8)")


class RoundTrip(Held):
    """Time from sending a model to applying the first command of a leader that had it.

    It is how far the motion that a model is used on is ahead of the motion that it was learnt from: the delay in both
    directions together. Both ends are ticks of the follower, so no two clocks are compared. The smallest of a second
    is taken: a larger one includes waiting. The newest 4,096 models and commands are known: a leader that never answers
    fills no memory.

    Args:
        trips: Array of one `Trip` that this one takes, part of another record; None for one of its own.

    Attributes:
        current: Model that the leader of the newest applied command rendered from; 0 for none.
    """

    current: int

    def __init__(self, trips: NDArray[Any] | None = None) -> None:
        super().__init__(Trip.new() if trips is None else trips)
        for kernel in (_restart, _sent, _commanded, _applied):
            kernel.entry  # noqa: B018  # asked for, it is compiled or loaded: nothing of that in the loop

    def restart(self) -> None:
        """Start again with another leader, which counts from 1 again and has no model yet."""
        _restart.entry(self.records[0])

    def sent(self, model: int, now_ns: int) -> None:
        """A model with this sequence number is sent [ns]."""
        _sent.entry(self.records[0], model, now_ns)

    def commanded(self, command: int, model: int) -> None:
        """A command has arrived whose leader had this model; one that comes after its turn adds nothing."""
        _commanded.entry(self.records[0], command, model)

    def applied(self, command: int, now_ns: int) -> float | None:
        """One tick [ns] after this newest applied command: once a second its smallest round trip [s], else None."""
        delay = _applied.entry(self.records[0], command, now_ns)
        return None if math.isnan(delay) else delay
