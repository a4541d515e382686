"""The parts of a session in which one process of either side was there, and of these the parts under the same settings.

Numbers are comparable only within one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from foretouch.messages.said import settings_at
from foretouch.quantities import Rows

if TYPE_CHECKING:
    from foretouch.messages.session_log import SessionLog

__all__ = ["side_seconds", "split_by_settings", "split_session"]

ONE_CHANGE_NS = 1_000_000_000
"""Changes of settings that are nearer to each other than this are one [ns]: what a console sets, both sides say, each
once in half a second."""

Epochs = NDArray[np.int64]


def split_session(log: SessionLog) -> tuple[SessionLog, ...]:
    """The stretches of a session: see `SessionLog.stretches`."""
    leads, heard = log.leader["epoch"], _filled(log.leader["epoch"], log.leader["run"])
    runs, obeyed = log.follower["run"], _filled(log.follower["run"], log.follower["epoch"])
    # Who never heard the other side may have been heard by it.
    heard, obeyed = _as_heard(leads, heard, obeyed, runs), _as_heard(runs, obeyed, heard, leads)
    keys = list(dict.fromkeys([*_pairs(obeyed, runs), *_pairs(leads, heard)]))
    strangers = not (heard.any() or obeyed.any()) and all(np.unique(own).size <= 1 for own in (leads, runs))
    if len(keys) <= 1 or strangers:
        epoch, run = keys[0] if len(keys) == 1 else (0, 0)
        return (_with_own_settings(log, epoch, run),)
    first = {run: epoch for epoch, run in reversed(_pairs(obeyed, runs))}
    of_model = [(model.epoch or first.get(model.run, 0), model.run) for model in log.models]
    return tuple(
        _with_own_settings(
            replace(
                log,
                leader=log.leader[(leads == epoch) & (heard == run)],
                follower=log.follower[(obeyed == epoch) & (runs == run)],
                models=tuple(model for model, key in zip(log.models, of_model, strict=True) if key == (epoch, run)),
            ),
            epoch,
            run,
        )
        for epoch, run in keys
    )


def split_by_settings(stretch: SessionLog) -> tuple[SessionLog, ...]:
    """The parts of a stretch in which no setting changed: see `SessionLog.phases`."""
    if not stretch.said:
        return (stretch,)
    epoch, run = _processes(stretch)
    first = settings_at(stretch.said, epoch, run, _first_ns(stretch.leader), _first_ns(stretch.follower))
    changes = _changes(stretch, epoch, run)
    if not changes:
        return (replace(stretch, settings=first, said=()),)
    begins = [0, *(sequence for sequence, _, _ in changes)]
    ends = [*begins[1:], int(np.iinfo(np.int64).max)]
    settings = [first, *(settings_at(stretch.said, epoch, run, *times) for _, *times in changes)]
    return tuple(_cut(stretch, *part) for part in zip(begins, ends, settings, strict=True))


def _with_own_settings(log: SessionLog, epoch: int, run: int) -> SessionLog:
    """A stretch with what its own processes said; itself where it has that."""
    if not log.said:
        return log
    last = (int(rows["time_ns"][-1]) if rows.size else None for rows in (log.leader, log.follower))
    settings = settings_at(log.said, epoch, run, *last)
    return log if settings == log.settings else replace(log, settings=settings)


def _processes(stretch: SessionLog) -> tuple[int, int]:
    """The leader's and the follower's process of a stretch, 0 for a side that is not there."""
    epoch = int(stretch.leader["epoch"][0]) if stretch.leader.size else 0
    return epoch, int(stretch.follower["run"][0]) if stretch.follower.size else 0


def _changes(stretch: SessionLog, epoch: int, run: int) -> list[tuple[int, int, int]]:
    """Where settings changed: the first command after it, and the newest change of the leader and of the follower."""
    leader, follower = stretch.leader, stretch.follower
    found: list[tuple[int, str, int]] = []
    sides = (
        ("leader", epoch, leader, "sequence", 0),
        ("follower", run, follower, "command_sequence", 1),
    )
    for role, process, rows, column, after in sides:
        for one in stretch.said:
            if (one.role, one.process) == (role, process) and rows.size and one.since_ns > rows["time_ns"][0]:
                row = min(int(np.searchsorted(rows["time_ns"], one.since_ns)), rows.size - 1)
                found.append((int(rows[column][row]) + after, role, one.since_ns))
    changes: list[tuple[int, int, int]] = []
    newest, began_ns = {"leader": _first_ns(leader), "follower": _first_ns(follower)}, 0
    for sequence, role, since_ns in sorted(found):
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


def _cut(stretch: SessionLog, begin: int, end: int, settings: dict[str, str]) -> SessionLog:
    """What belongs to the commands from `begin` on and before `end`."""
    leader, follower = stretch.leader, stretch.follower
    leader = leader[(leader["sequence"] >= begin) & (leader["sequence"] < end)]
    follower = follower[(follower["command_sequence"] >= begin) & (follower["command_sequence"] < end)]
    # The model that is rendered at first was sent before.
    oldest = int(leader["model_sequence"][0]) if leader.size and begin else 0
    models = tuple(one for one in stretch.models if one.sequence >= oldest and one.command_sequence < end)
    return replace(stretch, leader=leader, follower=follower, models=models, settings=settings, said=())


def side_seconds(rows: Rows) -> float:
    """Time from the first to the last tick of one side [s], 0 without any."""
    return float(np.ptp(rows["time_ns"])) * 1e-9 if rows.size else 0.0


def _filled(own: Epochs, other: Epochs) -> Epochs:
    """What each process had not heard yet is what it heard first."""
    filled = other.copy()
    for process in np.unique(own[other == 0]):
        known = other[(own == process) & (other > 0)]
        if known.size:
            filled[(own == process) & (other == 0)] = known[0]
    return filled


def _as_heard(own: Epochs, other: Epochs, theirs: Epochs, who: Epochs) -> Epochs:
    """What a process never heard is whoever first heard it: `theirs` is what the others heard, `who` they are."""
    filled = other.copy()
    for process in np.unique(own[other == 0]):
        hearing = who[theirs == process]
        if process and hearing.size:
            filled[(own == process) & (other == 0)] = hearing[0]
    return filled


def _pairs(epochs: Epochs, runs: Epochs) -> list[tuple[int, int]]:
    """Each pair once, in the order in which they come."""
    changes = np.ones(epochs.size, dtype=np.bool_)
    changes[1:] = (np.diff(epochs) != 0) | (np.diff(runs) != 0)
    return list(dict.fromkeys(zip(epochs[changes].tolist(), runs[changes].tolist(), strict=True)))
