"""Learning once and predicting under many delays, the fit of a whole file, and scoring a part of the samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import ContactSample, Learner, LearntModel
from foretouch.identification.estimator import Estimator
from foretouch.models import Predictor
from foretouch.quantities import Recording
from foretouch.report import Forces, Scores, lowest_mean, score

__all__ = ["OnceLearnt", "score_outside", "whole_file_force"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class OnceLearnt(Learner):
    """A learner that learns a recording once and, fed with the same recording again, says the same from memory.

    So the prediction can be made under many delays for one learning. An estimator that learns for a certain delay
    (`Estimator.horizon`) learns anew for another one.

    Args:
        make: Makes a fresh estimator.
        contact_floor: Of the recording [N], as `Learner`.
    """

    def __init__(self, make: Callable[[], Estimator], *, contact_floor: float) -> None:
        super().__init__(make(), contact_floor=contact_floor)
        self._make = make
        self._floor = contact_floor
        self._memory: list[LearntModel] = []
        self._place = -1

    @property
    def memory(self) -> Sequence[LearntModel]:
        """What was known after each sample of the recording so far."""
        return self._memory

    def learn(self, recording: Recording) -> None:
        """Learn all samples of a recording; predictions alone leave out those that come too late for them."""
        self._place = -1
        for sample in _samples(recording):
            self.update(*sample)

    def again(self, delay: float) -> OnceLearnt:
        """Back at the beginning of the recording, for predictions so late [s]."""
        learnt_for = self.estimator.horizon
        self.estimator.expect_delay(delay)
        if self.estimator.horizon != learnt_for:
            super().__init__(self._make(), contact_floor=self._floor)
            self.estimator.expect_delay(delay)
            self._memory = []
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


def whole_file_force(recording: Recording, estimator: Estimator, known: Learner) -> Array:
    """Force that a fit of the whole recording gives along its motion: no delay, and nothing causal about it.

    Args:
        recording: n samples.
        estimator: Fresh.
        known: A learner that has learnt the recording: where the surface is and what the force in free air is.

    Returns:
        Force [N], shape (n,); 0 where nothing could be fitted.
    """
    found = known.conditioner
    learner = Learner(
        estimator,
        surface=None if np.isnan(found.surface) else found.surface,
        force_offset=found.force_offset,
        contact_floor=recording.contact_floor,
    )
    for sample in _samples(recording):
        learner.update(*sample)
    estimator.finish()
    learnt = learner.learnt()
    predictor = Predictor()
    if learnt.model is not None:
        predictor.adopt(learnt.model, learnt.surface, learnt.model.initial_state())
    return np.array([predictor.update(time, place, speed) for time, place, _, speed in _samples(recording)])


def _samples(recording: Recording) -> Iterator[tuple[float, float, float, float | None]]:
    velocities: Iterable[float | None] = repeat(None) if recording.velocity is None else recording.velocity.tolist()
    columns = (recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), velocities)
    return zip(*columns, strict=False)


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
        delayed_offset=0.0,
        position=forces.position[kept],
        offset=lowest_mean(forces.time, forces.measured) if forces.time.size else None,
        skipped=None if forces.skipped is None else forces.skipped[kept],
    )
