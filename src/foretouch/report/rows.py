"""The rows of a session: where the robot was with the commands, and the scored ones at equal command sequence.

Elsewhere it guarded a first touch, did something else than follow, or its sensors failed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from foretouch.errors import ForetouchError
from foretouch.messages import WITH_THE_COMMANDS, ModelUpdate, SessionLog, Status
from foretouch.messages.session_log import believable
from foretouch.models import ContactModel, Predictor, make_model
from foretouch.quantities import Array, ByValue, Flags, Rows

APART_NS = 100_000_000
"""Segments that are nearer to each other than this are one [ns]: about its speed a command comes and goes."""

A_MOMENT_NS = 100_000_000  # A robot that joins the first command within this time [ns] does not count as returned

FOUND_WITHIN_NS = 100_000_000
"""A fault of the sensors is detected within this time after it began [ns], except for steps in contact."""


def runs_of(follower: Rows, flags: Flags) -> list[slice]:
    """Segments of rows from the first to the last that is flagged, those less than 0.1 s apart joined.

    Time without any tick is no time apart: a loop that was late did not do something else meanwhile.
    """
    ticks = np.flatnonzero(flags)
    if not ticks.size:
        return []
    others = np.diff(ticks) > 1
    cuts = np.flatnonzero(others & (np.diff(follower["time_ns"][ticks]) > APART_NS)) + 1
    return [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(ticks, cuts)]


def seconds_of(follower: Rows, flags: Flags) -> float:
    """Time for which the flag was set [s]: from each flagged tick to the next tick, however late that was."""
    lasted = np.diff(follower["time_ns"]) * 1e-9
    last = usual_period(follower) if flags.size and flags[-1] else 0.0  # the last tick's duration is unknown
    return float(lasted[flags[:-1]].sum()) + last


def guarded_runs(follower: Rows) -> list[slice]:
    """As `runs_of`, of the guarded ticks of `SessionLog.follower`."""
    return runs_of(follower, follower["guarded"])


def usual_period(table: Rows) -> float:
    """Usual time from tick to tick [s]."""
    return float(np.median(np.diff(table["time_ns"]))) * 1e-9 if table.size > 1 else 0.0


def since_first(leader: Rows) -> Array:
    """Time of the leader's ticks since its first [s]."""
    return np.asarray((leader["time_ns"] - leader["time_ns"][0]) * 1e-9)


class Segment(NamedTuple):
    """A segment of time [s] in which the robot was not at its commanded position."""

    begin: float
    end: float
    failing: bool
    """Whether its sensors could not be believed."""


def away(follower: Rows) -> Flags:
    """In which rows the robot was not at its commanded position, guarded ones left out: they have separate figures."""
    return np.asarray(~np.isin(follower["status"], WITH_THE_COMMANDS))


def trusted(follower: Rows, rows: Rows) -> Flags:
    """Rows that hold a true force: the sensors are believed, then and in the 0.1 s that a fault may go unnoticed."""
    good = believable(rows)
    failing = follower["validity"] > 0
    faults = follower["time_ns"][failing & np.diff(failing, prepend=False)]
    if faults.size:
        following = np.append(faults, 2 * FOUND_WITHIN_NS + int(rows["time_ns"].max(initial=0)))
        until = following[np.searchsorted(faults, rows["time_ns"])] - rows["time_ns"]
        good &= until > FOUND_WITHIN_NS
    return good


def follower_away(log: SessionLog, start_ns: int) -> list[Segment]:
    """Segments in which one process of the follower was away, or its sensors failed, since a time of its clock [ns]."""
    rows = since_first_command(log.follower)
    failing = rows["validity"] > 0
    gone = away(rows) & ~joining(rows)
    segments = []
    for flags, kind in ((gone & ~failing, False), (failing, True)):
        for run in runs_of(rows, flags):
            times = (rows["time_ns"][run] - start_ns) * 1e-9
            segments.append(Segment(float(times[0]), float(times[-1]), kind))
    return segments


def since_first_command(follower: Rows) -> Rows:
    """Rows from the first that carries out a command."""
    begun = np.flatnonzero(follower["command_sequence"] > 0)
    return follower[begun[0] :] if begun.size else follower[:0]


def joining(rows: Rows) -> Flags:
    """The way to the first command, where it takes no longer than a moment."""
    returning = rows["status"] == Status.RETURNING
    flags = np.zeros(rows.size, dtype=np.bool_)
    if rows.size and returning[0]:
        end = rows.size if returning.all() else int(np.argmin(returning))
        flags[:end] = rows["time_ns"][end - 1] - rows["time_ns"][0] < A_MOMENT_NS
    return flags


@dataclass(frozen=True, eq=False)
class Pairs(ByValue):
    """One row per command that the follower applied, in the order of the follower's ticks.

    Attributes:
        time: Time of the follower's tick since the first row [s], shape (n,). The force was measured then; the
            leader's tick was one position delay earlier.
        leader: The leader's tick that sent the command, shape (n,).
        follower: The first follower tick that applied it, shape (n,).
        never_applied: Commands that no tick applied.
    """

    time: Array
    leader: Rows
    follower: Rows
    never_applied: int


def pair(log: SessionLog) -> Pairs:
    """Pair the applied commands of a log, of its longest segment where a side began again (`SessionLog.longest`).

    A tick whose sensors are not to be trusted is left out, and so are those of the 0.1 s before, in which the fault may
    have begun: the true force is unknown there.
    """
    segment = log.longest()
    rows = segment.rows()
    clock = rows.follower["time_ns"]
    _, order = np.unique(clock, return_index=True)
    order = order[trusted(segment.follower, rows.follower)[order]]
    leader, follower = rows.leader[order], rows.follower[order]
    since = follower["time_ns"] - follower["time_ns"][0] if order.size else follower["time_ns"]
    return Pairs(since * 1e-9, leader, follower, rows.never_applied)


def not_scored(pairs: Pairs) -> Flags:
    """Rows in which the robot was not at its commanded position, or the hand did not lead it.

    It guarded a first touch or did something else than follow (`foretouch.report.statuses.away`), the clutch was
    pressed, or the device gave no position: robot and model then stay where they are, and a
    prediction there is easy and reaches no hand.
    """
    led = pairs.leader["engaged"] & ~nowhere(pairs.leader)
    return np.asarray(pairs.follower["guarded"] | away(pairs.follower) | ~led)


def nowhere(leader: Rows) -> Flags:
    """Rows in which the operator's device gave no position.

    There are none in a recording of old, which has commands and no hand.
    """
    known = np.isfinite(leader["hand_position"])
    recorded = known.any() or not np.isfinite(leader["position"]).any()
    return np.asarray(~known & recorded)


def model_of(update: ModelUpdate) -> ContactModel | None:
    """The contact model of a message, None where it is not valid or not a law that is known here."""
    if not update.valid:
        return None
    try:
        return make_model(update.law, update.parameters, update.map)
    except ForetouchError:
        return None


def force_at_follower(log: SessionLog, pairs: Pairs) -> Array:
    """Prediction of the leader's model for the follower's motion: the prediction error less the tracking error.

    In each row the newest model that had arrived at the leader is run at the follower's position and velocity;
    without a valid model the force is 0, as it is at the leader. A law with memory runs on along the rows, from the
    state that its message carried, which is that of the command that the follower had applied then. In space the
    material is as strong as the leader rendered it in that tick. [N], shape (n,).
    """
    sent = {model.sequence: model for model in log.models}
    predictor = Predictor()
    newest, commands = 0, np.ascontiguousarray(pairs.leader["sequence"])  # as a column it is copied at every search
    forces = np.zeros(pairs.time.size)
    depth = _of_tick(log.follower_space, "depth", pairs.follower["sequence"])
    place = pairs.follower["position"] if depth is None else depth  # models count from the believed surface
    motion = pairs.time, place, pairs.follower["velocity"], pairs.leader["model_sequence"]
    rows = zip(*(column.tolist() for column in motion), strict=True)
    for index, (time, position, velocity, sequence) in enumerate(rows):
        if sequence != newest:
            newest = sequence
            update = sent.get(sequence)
            if update is None:
                predictor.adopt(None, 0.0)
            else:
                row = int(np.searchsorted(commands, update.command_sequence, side="right"))
                predictor.adopt(model_of(update), update.surface, update.state, row)
        forces[index] = predictor.update(time, position, velocity)
    scale = _of_tick(log.leader_space, "scale", pairs.leader["sequence"])
    return forces if scale is None else forces * np.nan_to_num(scale, nan=1.0)


def _of_tick(space: Rows, name: str, sequence: Array) -> Array | None:
    """What a side says in space in the ticks of these numbers; None along a line."""
    if not space.size:
        return None
    return np.asarray(space[name][np.minimum(np.searchsorted(space["sequence"], sequence), space.size - 1)])
