"""The rows of a session that are scored: leader and follower at equal command sequence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import ForetouchError
from foretouch.messages import ModelUpdate, SessionLog
from foretouch.models import ContactModel, Predictor, make_model
from foretouch.quantities import ByValue, Rows
from foretouch.report.statuses import away, trusted

Array = NDArray[np.float64]


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


def not_scored(pairs: Pairs) -> NDArray[np.bool_]:
    """Rows in which the robot was not where the command said, or the hand did not lead it.

    It guarded a first touch or did something else than follow (`foretouch.report.statuses.away`), the clutch was
    pressed, or the device gave no position: robot and model then stay where they are, and a
    prediction there is easy and reaches no hand.
    """
    led = pairs.leader["engaged"] & ~nowhere(pairs.leader)
    return np.asarray(pairs.follower["guarded"] | away(pairs.follower) | ~led)


def nowhere(leader: Rows) -> NDArray[np.bool_]:
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
    state that its message carried, which is that of the command that the follower had applied then.

    Returns:
        Force [N], shape (n,).
    """
    sent = {model.sequence: model for model in log.models}
    predictor = Predictor()
    newest, commands = 0, np.ascontiguousarray(pairs.leader["sequence"])  # as a column it is copied at every search
    forces = np.zeros(pairs.time.size)
    columns = (
        pairs.time.tolist(),
        pairs.follower["position"].tolist(),
        pairs.follower["velocity"].tolist(),
        pairs.leader["model_sequence"].tolist(),
    )
    for index, (time, position, velocity, sequence) in enumerate(zip(*columns, strict=True)):
        if sequence != newest:
            newest = sequence
            update = sent.get(sequence)
            if update is None:
                predictor.adopt(None, 0.0)
            else:
                row = int(np.searchsorted(commands, update.command_sequence, side="right"))
                predictor.adopt(model_of(update), update.surface, update.state, row)
        forces[index] = predictor.update(time, position, velocity)
    return forces
