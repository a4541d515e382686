"""Measured, predicted and delayed force of a recording: what a prediction is scored on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from foretouch.comparison.cases import Loaded
from foretouch.identification import ContactSample, Learner, LearntModel, predict
from foretouch.identification.estimator import Estimator
from foretouch.quantities import Recording
from foretouch.report import CONTACT_FLOOR, Scores, delayed, lowest_mean, pair, score
from foretouch.session import replay

__all__ = ["Forces", "OnceLearnt", "forces_under_delay", "score_outside"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Forces:
    """Columns of shape (n,): those of the recording, or of a session at equal command.

    Attributes:
        time: [s].
        position: Of the probe [m].
        measured: As the sensor gives it [N].
        predicted: [N].
        delayed: What the receiver knows [N].
        contact_floor: Smallest force that counts as contact [N].
    """

    time: Array
    position: Array
    measured: Array
    predicted: Array
    delayed: Array
    contact_floor: float


class OnceLearnt(Learner):
    """A learner that learns a recording once and, fed with the same recording again, says the same from memory.

    So the prediction can be made under many delays for one learning.

    Args:
        estimator: Fresh.
        contact_floor: Of the recording [N], as `Learner`.
    """

    def __init__(self, estimator: Estimator, *, contact_floor: float) -> None:
        super().__init__(estimator, contact_floor=contact_floor)
        self._memory: list[LearntModel] = []
        self._place = -1

    @property
    def memory(self) -> Sequence[LearntModel]:
        """What was known after each sample of the recording so far."""
        return self._memory

    def learn(self, recording: Recording) -> None:
        """Learn all samples of a recording; predictions alone leave out those that come too late for them."""
        self.again()
        velocities = repeat(None) if recording.velocity is None else recording.velocity.tolist()
        columns = (recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), velocities)
        for sample in zip(*columns, strict=False):
            self.update(*sample)

    def again(self) -> OnceLearnt:
        """Back at the beginning of the recording."""
        self._place = -1
        return self

    def update(self, time: float, position: float, force: float, velocity: float | None = None) -> ContactSample:
        """Learn from a sample that is new, recall what was learnt of one that is not."""
        self._place += 1
        if self._place == len(self._memory):
            super().update(time, position, force, velocity)
            self._memory.append(super().learnt())
        return self.sample

    def learnt(self) -> LearntModel:
        """What was known after the newest sample."""
        return self._memory[self._place] if self._place >= 0 else super().learnt()


def forces_under_delay(loaded: Loaded, learner: OnceLearnt, delay: float) -> Forces:
    """Predict a recording's force, or a session's at the leader's own motion, whose forces are known late.

    Args:
        loaded: The recording.
        learner: Fresh, or one that has learnt this recording.
        delay: Of the forces [s], 0 or more.

    Raises:
        RecordingError: A session with a side missing.
        SettingError: A delay below 0.
    """
    recording, _, log = loaded
    learner.again()
    if log is None:
        known = delayed(recording.time, recording.force - lowest_mean(recording.time, recording.force), delay)
        predicted = predict(recording, learner, delay=delay)
        return Forces(recording.time, recording.position, recording.force, predicted, known, recording.contact_floor)
    again, pairs = replay(log, learner, delay=delay), pair(log)
    ticks = np.searchsorted(log.leader["sequence"], pairs.leader["sequence"])
    return Forces(
        pairs.time,
        pairs.follower["position"],
        pairs.follower["sensor_force"],
        again.predicted[ticks],
        again.delayed[ticks],
        CONTACT_FLOOR,
    )


def score_outside(
    forces: Forces,
    left_out: Flags | None,
    *,
    score_from: float,
    score_to: float | None = None,
    contact_floor: float | None = None,
) -> Scores:
    """Score a prediction as `score` does, on those samples that are not left out.

    The zero of the measured force is found in all samples, errors and contact force in those that stay.

    Args:
        forces: Columns of shape (n,).
        left_out: Flags of shape (n,), None for none.
        score_from: Start of the window [s after the first sample].
        score_to: Its end [s after the first sample], None for the last sample.
        contact_floor: Smallest force that counts as contact [N]; None takes that of the recording.

    Raises:
        SettingError: As `score`.
    """
    kept = np.ones(forces.time.size, dtype=np.bool_) if left_out is None else ~left_out
    time = forces.time[kept]
    moved = float(time[0] - forces.time[0]) if time.size else 0.0
    return score(
        time,
        forces.measured[kept],
        forces.predicted[kept],
        forces.delayed[kept],
        contact_floor=forces.contact_floor if contact_floor is None else contact_floor,
        score_from=score_from - moved,
        score_to=None if score_to is None else score_to - moved,
        position=forces.position[kept],
        offset=lowest_mean(forces.time, forces.measured) if forces.time.size else None,
    )
