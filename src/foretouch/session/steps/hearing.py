"""What a follower hears, compiled: which command is obeyed, and what is remembered of it, over one record."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.quantities.pose import Vector
from foretouch.session.network.freshness import Judging, begin, judge
from foretouch.session.network.lease import Lease, admit
from foretouch.session.network.model_sender import Sending, surface_of
from foretouch.session.network.playout import Playing, push, restart
from foretouch.session.network.round_trip import note_commanded
from foretouch.session.network.round_trip import restart as restart_trip

_admit, _judge, _push = admit.function, judge.function, push.function

MOST_FELT = 64  # Ticks that the lag of a sensor may have, and some more

NOT_ADMITTED, BEFORE_RELEASE = -2, -1
"""Judgements of a command beside `foretouch.session.network.freshness.Arrival`: its leader has no control; it did not
know yet of the release of an emergency stop."""


class Hearing(Record):
    """What a follower remembers of the commands that came, and of the models that it sent."""

    leases: Annotated[NDArray[Any], Lease, 1]
    judgings: Annotated[NDArray[Any], Judging, 1]
    sendings: Annotated[NDArray[Any], Sending, 1]
    run: int  # epoch of this process
    guards: bool  # whether this side's settings guard first touches
    guarded: bool  # whether they are guarded: by these, or because a command of this leader asks for it
    released_tick: int  # number of the first telemetry behind the newest release, 0 before the first release
    before_release: int  # commands refused because their leader did not know of it
    asked: Annotated[NDArray[Any], float, 3] = math.nan  # type: ignore[assignment]  # place of the newest command [m]
    felt_room: int = 1  # ticks that lie between a tick and the one whose command its sensor shows, and one more
    felt_count: int  # of them that are known
    felt: Annotated[NDArray[Any], int, MOST_FELT]  # commands applied in the newest ticks that were learnt from


@kernel("i8(Hearing, Playing[::1], UniTuple(i8, 6), i8)", Playing)
def hear(
    hearing: Hearing, playings: NDArray[np.void], command: tuple[int, int, int, int, int, int], now_ns: int
) -> int:
    """Judge a command that arrives now [ns]: an `Arrival`, `NOT_ADMITTED` or `BEFORE_RELEASE`.

    Args:
        hearing: Written.
        playings: An array of one `Playing`, which begins anew with another leader.
        command: Number of its holder's name (`foretouch.session.network.lease.number_of`); then its fields `epoch`,
            `sequence`, `time_ns`, `telemetry_sequence` and `run`.
        now_ns: Time of this tick [ns].
    """
    lease, judging = hearing.leases[0], hearing.judgings[0]
    holder, epoch, sequence, time_ns, telemetry_sequence, run = command
    before, ended = lease.epoch, lease.number
    if not _admit(lease, holder, epoch, now_ns):
        return NOT_ADMITTED
    if lease.epoch != before or lease.number != ended:  # nothing of another leader is still valid
        begin(judging)
        restart(playings[0])
        restart_trip(hearing.sendings[0].trip)
        hearing.felt_count, hearing.guarded = 0, hearing.guards
    unaware = run != hearing.run or telemetry_sequence < hearing.released_tick
    if hearing.released_tick > 0 and unaware:
        hearing.before_release += 1
        return BEFORE_RELEASE
    return int(_judge(judging, sequence, time_ns, now_ns))


@kernel("(Hearing, Playing[::1], i8, f8, UniTuple(f8, 3), UniTuple(f8, 3), i8, b1)", Playing)
def obey(
    hearing: Hearing,
    playings: NDArray[np.void],
    sequence: int,
    position: float,
    place: Vector,
    asked: Vector,
    acknowledged: int,
    guarded: bool,
) -> None:
    """Play a fresh command; one without a position is never played.

    Args:
        hearing: Written.
        playings: An array of one `Playing`; written.
        sequence: Number of the command.
        position: Commanded [m]; NaN for none.
        place: The same in space [m]; NaN along a line.
        asked: Where it leads to [m].
        acknowledged: Number of the model that its leader renders from.
        guarded: Whether it asks that the first touch be guarded.
    """
    if math.isfinite(position):
        hearing.asked[0], hearing.asked[1], hearing.asked[2] = asked
        sending = hearing.sendings[0]
        _push(playings, sequence, position, place, surface_of(sending, acknowledged))
        note_commanded(sending.trip, sequence, acknowledged)
    if guarded:
        hearing.guarded = True


@compiled
def note_felt(hearing: Hearing, applied: int) -> None:
    """Note which command was applied in a tick that was learnt from."""
    for tick in range(hearing.felt_room - 1, 0, -1):
        hearing.felt[tick] = hearing.felt[tick - 1]
    hearing.felt[0] = applied
    hearing.felt_count = min(hearing.felt_count + 1, hearing.felt_room)


@compiled
def felt_command(hearing: Hearing) -> int:
    """The command that had been applied when the newest sample that was learnt from was felt, 0 before the first."""
    return int(hearing.felt[hearing.felt_count - 1]) if hearing.felt_count > 0 else 0
