"""A whole session in memory: the states of leader and follower, tick by tick, and the segments that compare.

A segment is a part in which one process of either side was there; a part of it has the same settings throughout.
Numbers are comparable only within one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.messages.hellos import SettingsReport, settings_at
from foretouch.messages.schema import VERSION, EmergencyStop, Message, ModelUpdate
from foretouch.messages.states import (
    CameraImage,
    FieldUpdate,
    FixtureBelief,
    FollowerRow,
    FollowerSpace,
    LeaderRow,
    LeaderSpace,
    LeaderState,
    Telemetry,
    in_space,
)
from foretouch.quantities import ByValue, Columns, Rows

ONE_CHANGE_NS = 1_000_000_000
"""Changes of settings that are nearer to each other than this are one [ns]: what a console sets, both sides say, each
once in half a second."""

Epochs = NDArray[np.int64]


def split_session(log: SessionLog) -> tuple[SessionLog, ...]:
    """The segments of a session: see `SessionLog.segments`."""
    leads, runs = log.leader["epoch"], log.follower["run"]
    seen = _filled(leads, log.leader["run"], leads, log.leader["run"])
    obeyed = _filled(runs, log.follower["epoch"], runs, log.follower["epoch"])
    # A process that never received the other side may have been received by it.
    by_robot, by_leader = (np.where(epochs > 0, epochs, -1) for epochs in (obeyed, seen))
    seen, obeyed = _filled(leads, seen, by_robot, runs), _filled(runs, obeyed, by_leader, leads)
    keys = list(dict.fromkeys([*_pairs(obeyed, runs), *_pairs(leads, seen)]))
    strangers = not (seen.any() or obeyed.any()) and all(np.unique(own).size <= 1 for own in (leads, runs))
    if len(keys) <= 1 or strangers:
        epoch, run = keys[0] if len(keys) == 1 else (0, 0)
        return (_with_own_settings(log, epoch, run),)
    first = {run: epoch for epoch, run in reversed(_pairs(obeyed, runs))}
    of_model = [(model.epoch or first.get(model.run, 0), model.run) for model in log.models]
    parts = []
    for epoch, run in keys:
        leader = log.leader[(leads == epoch) & (seen == run)]
        follower = log.follower[(obeyed == epoch) & (runs == run)]
        models = tuple(model for model, key in zip(log.models, of_model, strict=True) if key == (epoch, run))
        parts.append(_with_own_settings(replace(log, leader=leader, follower=follower, models=models), epoch, run))
    return tuple(parts)


def split_by_settings(segment: SessionLog) -> tuple[SessionLog, ...]:
    """The parts of a segment in which no setting changed: see `SessionLog.phases`."""
    if not segment.reports:
        return (segment,)
    # The leader's and the follower's process, 0 for a side that is not there.
    epoch = int(segment.leader["epoch"][0]) if segment.leader.size else 0
    run = int(segment.follower["run"][0]) if segment.follower.size else 0
    first = settings_at(segment.reports, epoch, run, _first_ns(segment.leader), _first_ns(segment.follower))
    changes = _changes(segment, epoch, run)
    if not changes:
        return (replace(segment, settings=first, reports=()),)
    begins = [0, *(sequence for sequence, _, _ in changes)]
    ends = [*begins[1:], int(np.iinfo(np.int64).max)]
    settings = [first, *(settings_at(segment.reports, epoch, run, *times) for _, *times in changes)]
    return tuple(_cut(segment, *part) for part in zip(begins, ends, settings, strict=True))


def _with_own_settings(log: SessionLog, epoch: int, run: int) -> SessionLog:
    """A segment with the settings of its own processes; itself where it has them."""
    if not log.reports:
        return log
    last = (int(rows["time_ns"][-1]) if rows.size else None for rows in (log.leader, log.follower))
    settings = settings_at(log.reports, epoch, run, *last)
    return log if settings == log.settings else replace(log, settings=settings)


def _changes(segment: SessionLog, epoch: int, run: int) -> list[tuple[int, int, int]]:
    """Changes of settings: the first command after each, and the newest change of the leader and of the follower."""
    leader, follower = segment.leader, segment.follower
    sides = {("leader", epoch): (leader, "sequence", 0), ("follower", run): (follower, "command_sequence", 1)}
    every: list[tuple[int, str, int]] = []
    for one in segment.reports:
        rows, column, after = sides.get((one.role, one.process), (leader[:0], "", 0))
        if rows.size and one.since_ns > rows["time_ns"][0]:
            row = min(int(np.searchsorted(rows["time_ns"], one.since_ns)), rows.size - 1)
            every.append((int(rows[column][row]) + after, one.role, one.since_ns))
    changes: list[tuple[int, int, int]] = []
    newest, began_ns = {"leader": _first_ns(leader), "follower": _first_ns(follower)}, 0
    for sequence, role, since_ns in sorted(every):
        newest[role] = since_ns
        row = min(int(np.searchsorted(leader["sequence"], sequence)), leader.size - 1)
        time_ns = int(leader["time_ns"][row]) if leader.size else since_ns
        if changes and time_ns - began_ns < ONE_CHANGE_NS:
            changes.pop()
        else:
            began_ns = time_ns
        changes.append((sequence, newest["leader"], newest["follower"]))
    return changes


def _first_ns(rows: Rows) -> int:
    return int(rows["time_ns"][0]) if rows.size else 0


def _cut(segment: SessionLog, begin: int, end: int, settings: dict[str, str]) -> SessionLog:
    """The part that belongs to the commands from `begin` on and before `end`."""
    leader, follower = segment.leader, segment.follower
    leader = leader[(leader["sequence"] >= begin) & (leader["sequence"] < end)]
    follower = follower[(follower["command_sequence"] >= begin) & (follower["command_sequence"] < end)]
    # The model that is rendered at first was sent before.
    oldest = int(leader["model_sequence"][0]) if leader.size and begin else 0
    models = tuple(one for one in segment.models if one.sequence >= oldest and one.command_sequence < end)
    return replace(segment, leader=leader, follower=follower, models=models, settings=settings, reports=())


def side_seconds(rows: Rows) -> float:
    """Time from the first to the last tick of one side [s], 0 without any."""
    return float(np.ptp(rows["time_ns"])) * 1e-9 if rows.size else 0.0


def _filled(own: Epochs, other: Epochs, theirs: Epochs, epochs: Epochs) -> Epochs:
    """Give ticks of a process before its first reception the first of `epochs` that `theirs` pairs with the process."""
    filled = other.copy()
    for process in np.unique(own[other == 0]):
        known = epochs[(theirs == process) & (epochs > 0)]
        if known.size:
            filled[(own == process) & (other == 0)] = known[0]
    return filled


def _pairs(epochs: Epochs, runs: Epochs) -> list[tuple[int, int]]:
    """Each pair once, in the order in which they come."""
    changes = np.ones(epochs.size, dtype=np.bool_)
    changes[1:] = (np.diff(epochs) != 0) | (np.diff(runs) != 0)
    return list(dict.fromkeys(zip(epochs[changes].tolist(), runs[changes].tolist(), strict=True)))


_CODES = {float: "f8", bool: "?"}


def _dtype(kind: type[Message]) -> np.dtype[np.void]:
    """Structured dtype with the fields of a message class, without version and space; counts are whole numbers."""
    fields = [field for field in msgspec.structs.fields(kind) if field.name not in ("version", "space")]
    return np.dtype([(field.name, _CODES.get(field.type, "i8")) for field in fields])


_SHOWN = {
    "hand_position": "m",
    "position": "m",
    "velocity": "m_s",
    "predicted_force": "N",
    "standard_deviation": "N",
    "rendered_force": "N",
    "delayed_force": "N",
}
"""Columns of the leader in `SessionLog.columns`, with their units."""

LEADER_DTYPE = _dtype(LeaderState)
"""Columns of `SessionLog.leader`: the fields of `LeaderState`."""

FOLLOWER_DTYPE = _dtype(Telemetry)
"""Columns of `SessionLog.follower`: the fields of `Telemetry`."""

LEADER_SPACE_DTYPE = _dtype(LeaderRow)
"""Columns of `SessionLog.leader_space`: the fields of `LeaderRow`."""

FOLLOWER_SPACE_DTYPE = _dtype(FollowerRow)
"""Columns of `SessionLog.follower_space`: the fields of `FollowerRow`."""


_TIMING = frozenset({"compute_ns"})
"""Columns that say how long the computer took."""


S = TypeVar("S", Telemetry, LeaderState)


def _state(kind: Callable[..., S], record: type[msgspec.Struct], rows: Rows, space: Rows, row: int) -> S:
    """A row as its message, with what the newest row in space up to its number says."""
    last = int(np.searchsorted(space["sequence"], rows["sequence"][row], side="right")) - 1
    known = space[last].tolist()[2 : 2 + len(record.__struct_fields__)] if last >= 0 else None
    return kind(VERSION, *rows[row].tolist(), None if known is None else record(*known))


@dataclass(frozen=True)
class SessionRows(ByValue):
    """One row per command sequence number that the follower applied: the first tick that applied it.

    All arrays have the same length and are ordered by command sequence, segment by segment (`SessionLog.segments`).
    Two are equal as logs are.

    Attributes:
        leader: Rows of `SessionLog.leader`.
        follower: Rows of `SessionLog.follower`.
        never_applied: Commands that were sent and not applied by any tick; counted, not scored.
    """

    _timing = _TIMING
    leader: Rows
    follower: Rows
    never_applied: int


@dataclass(frozen=True)
class SessionLog(Columns):
    """The record of a session.

    Two are equal if all messages agree; ``==`` leaves out how long the computer took (``compute_ns``), so that a
    simulated session equals its repetition.

    Attributes:
        leader: One row per `LeaderState`, structured as `LEADER_DTYPE`.
        follower: One row per `Telemetry`, structured as `FOLLOWER_DTYPE`.
        models: Every `ModelUpdate`, by the follower's process and in order of sequence.
        settings: The session's settings as text, as last reported in the `Hello` messages; of a segment those
            that its own two processes reported last, of a phase those of all of it.
        counts: Counters of both sides at the end, for example ``"undecodable"``, summed over the processes of each.
        emergencies: Every `EmergencyStop`.
        news: News of the sides while it lasted, by name of `foretouch.messages.NEWS`: each text once.
        leader_space: In three dimensions, one row per `LeaderState`: what it says in space; else empty.
        follower_space: The same, per `Telemetry`.
        fields: Every `FieldUpdate`.
        images: Every `CameraImage`.
        beliefs: Every `FixtureBelief`.
        reports: Settings that each process reported, and the times from which they hold.
    """

    _timing = _TIMING
    leader: Rows
    follower: Rows
    models: tuple[ModelUpdate, ...]
    settings: dict[str, str] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    emergencies: tuple[EmergencyStop, ...] = ()
    news: dict[str, tuple[str, ...]] = field(default_factory=dict)
    leader_space: Rows = field(default_factory=lambda: np.empty(0, LEADER_SPACE_DTYPE))
    follower_space: Rows = field(default_factory=lambda: np.empty(0, FOLLOWER_SPACE_DTYPE))
    fields: tuple[FieldUpdate, ...] = ()
    images: tuple[CameraImage, ...] = ()
    beliefs: tuple[FixtureBelief, ...] = ()
    reports: tuple[SettingsReport, ...] = ()

    @classmethod
    def from_messages(
        cls, messages: Iterable[Message], settings: dict[str, str] | None = None, counts: dict[str, int] | None = None
    ) -> SessionLog:
        """Log from the messages themselves, those of each kind in their order; what a log does not hold is left out."""
        kinds: dict[type, list[Any]] = defaultdict(list)
        for message in messages:
            for one in (message, *in_space(message)):
                kinds[type(one)].append(one)

        def rows(kind: type, dtype: np.dtype[np.void]) -> Rows:
            columns = slice(1, 1 + len(dtype.fields or ()))  # without the version, and what a state says in space
            return np.array([msgspec.structs.astuple(message)[columns] for message in kinds[kind]], dtype=dtype)

        return cls(
            rows(LeaderState, LEADER_DTYPE),
            rows(Telemetry, FOLLOWER_DTYPE),
            in_order(kinds[ModelUpdate]),
            settings or {},
            counts or {},
            leader_space=rows(LeaderRow, LEADER_SPACE_DTYPE),
            follower_space=rows(FollowerRow, FOLLOWER_SPACE_DTYPE),
            fields=tuple(kinds[FieldUpdate]),
            images=tuple(kinds[CameraImage]),
            beliefs=tuple(kinds[FixtureBelief]),
        )

    def telemetry(self, row: int) -> Telemetry:
        """The message of a row of `follower`, of a log of one process of either side."""
        return _state(Telemetry, FollowerSpace, self.follower, self.follower_space, row)

    def leader_state(self, row: int) -> LeaderState:
        """The same, of a row of `leader`."""
        return _state(LeaderState, LeaderSpace, self.leader, self.leader_space, row)

    def messages(self) -> list[Message]:
        """What both sides and the camera said, in time; of what was said in one tick, the follower's first."""
        follower, leader = (
            map(self.telemetry, range(self.follower.size)),
            map(self.leader_state, range(self.leader.size)),
        )
        messages = [*follower, *self.models, *self.fields, *self.images, *self.beliefs, *leader]
        return sorted(messages, key=lambda message: message.time_ns)

    def segments(self) -> tuple[SessionLog, ...]:
        """The parts in which one process of the leader and one of the follower had to do with each other.

        A side that ends and begins again counts its messages from 1 again; `epoch` and `run` tell its processes apart.
        What a process sent before it received the other side belongs to the segment that follows; what it sent
        after it was left alone, to the one before. A leader that the follower does not obey has a segment of its own.

        Returns:
            Logs with the rows, models and settings of each, in the order in which they began; what else is not recorded
            tick by tick is in all of them. A session without a restart is its own only segment.
        """
        return split_session(self)

    def longest(self) -> SessionLog:
        """The segment in which both sides were present longest."""
        return _longest(self.segments())

    def phases(self) -> tuple[SessionLog, ...]:
        """The parts of all segments in which no setting changed: a network can change while the same processes go on.

        A segment is cut at a command: what was sent before a change belongs to what was before. Changes of both sides
        within a second are one.

        Returns:
            Logs as of `segments`, in time; each has the settings that held in all of it.
        """
        return tuple(phase for segment in self.segments() for phase in split_by_settings(segment))

    def longest_phase(self) -> SessionLog:
        """The part without a change of any setting in which both sides were present longest."""
        return _longest(self.phases())

    def columns(self) -> dict[str, NDArray[Any]]:
        """Forces and positions at equal command: what the leader did in a tick, and what the robot then felt of it.

        Commands that the robot never carried out are left out, so times can be uneven.
        """
        paired = self.rows()
        leader, follower = paired.leader, paired.follower
        began = int(self.leader["time_ns"][0]) if self.leader.size else 0
        columns: dict[str, NDArray[Any]] = {"time_s": (leader["time_ns"] - began) * 1e-9}
        for name, unit in _SHOWN.items():
            columns[f"{name}_{unit}"] = leader[name]
        return columns | {
            "robot_position_m": follower["position"],
            "sensor_force_N": follower["sensor_force"],
            "in_contact": follower["in_contact"],
        }

    def rows(self) -> SessionRows:
        """Pair each applied command with the first follower tick that applied it, within each segment."""
        parts = []
        for segment in self.segments():
            applied = segment.follower[segment.follower["command_sequence"] > 0]
            sequences, first = np.unique(applied["command_sequence"], return_index=True)
            sent = segment.leader["sequence"]
            _, of_leader, of_applied = np.intersect1d(sent, sequences, assume_unique=True, return_indices=True)
            parts.append((segment.leader[of_leader], applied[first[of_applied]]))
        leader, follower = (np.concatenate([part[side] for part in parts]) for side in (0, 1))
        return SessionRows(leader, follower, int(self.leader.size - leader.size))


def believable(follower: Rows) -> NDArray[np.bool_]:
    """Flags of the rows of `SessionLog.follower` with trusted sensor samples: valid, and finite."""
    finite = np.isfinite(follower["sensor_force"]) & np.isfinite(follower["position"])
    return np.asarray((follower["validity"] == 0) & finite)


def _longest(logs: Iterable[SessionLog]) -> SessionLog:
    """That in which both sides were present longest, and of equal ones either."""
    return max(logs, key=lambda log: sorted((side_seconds(log.leader), side_seconds(log.follower))))


def in_order(models: list[ModelUpdate]) -> tuple[ModelUpdate, ...]:
    """Models by the process that sent them, and then by sequence."""
    return tuple(sorted(models, key=lambda model: (model.run, model.sequence)))
