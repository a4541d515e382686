"""The parts of a session in which one process of either side was there: numbers are comparable only within one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from foretouch.messages.session_log import SessionLog

__all__ = ["side_seconds", "split_session"]

Epochs = NDArray[np.int64]
Rows = NDArray[np.void]


def split_session(log: SessionLog) -> tuple[SessionLog, ...]:
    """The stretches of a session: see `SessionLog.stretches`."""
    leads, heard = log.leader["epoch"], _filled(log.leader["epoch"], log.leader["run"])
    runs, obeyed = log.follower["run"], _filled(log.follower["run"], log.follower["epoch"])
    # Who never heard the other side may have been heard by it.
    heard, obeyed = _as_heard(leads, heard, obeyed, runs), _as_heard(runs, obeyed, heard, leads)
    keys = list(dict.fromkeys([*_pairs(obeyed, runs), *_pairs(leads, heard)]))
    strangers = not (heard.any() or obeyed.any()) and all(np.unique(own).size <= 1 for own in (leads, runs))
    if len(keys) <= 1 or strangers:
        return (log,)
    first = {run: epoch for epoch, run in reversed(_pairs(obeyed, runs))}
    of_model = [(model.epoch or first.get(model.run, 0), model.run) for model in log.models]
    return tuple(
        replace(
            log,
            leader=log.leader[(leads == epoch) & (heard == run)],
            follower=log.follower[(obeyed == epoch) & (runs == run)],
            models=tuple(model for model, key in zip(log.models, of_model, strict=True) if key == (epoch, run)),
        )
        for epoch, run in keys
    )


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
