"""Prediction of a recorded motion's force under a delay, causally."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from foretouch.identification.learner import Learner, LearntModel
from foretouch.models import Predictor
from foretouch.models.checks import require
from foretouch.quantities import Recording

__all__ = ["TIME_TOLERANCE", "Motion", "predict"]

Array = NDArray[np.float64]

TIME_TOLERANCE = 1e-7
"""Times closer than this [s] count as equal: sample times in files are rounded."""


@dataclass(frozen=True)
class Motion:
    """The operator's motion, where it is another one than the probe's.

    Attributes:
        time: [s], in the time of the recording, increasing, shape (m,).
        position: [m], in the frame of the probe, shape (m,).
        published: Indices of the recording's samples after which a model was sent, increasing.
    """

    time: Array
    position: Array
    published: NDArray[np.int64]


def predict(recording: Recording, learner: Learner, *, delay: float, motion: Motion | None = None) -> Array:
    """Force that a leader would have rendered, had this recording happened under a delay.

    At time t the motion is known up to t and the forces up to t - delay: the model that predicts at t was learnt from
    samples no later than t - delay. By default the motion is the recording's own, and a model is sent after every
    sample.

    Args:
        recording: What the follower felt.
        learner: Fresh; it is fed the recording sample by sample.
        delay: Of the forces [s], not negative.
        motion: The operator's motion and the moments at which models were sent, or None.

    Returns:
        Predicted force [N] at each sample of the motion; 0 before the first model.

    Raises:
        SettingError: delay is negative or not finite.
    """
    require("delay", delay, at_least=0.0)
    predictor = Predictor()
    models = _published(recording, learner, None if motion is None else motion.published)
    upcoming = next(models, None)
    velocities: Iterable[float | None]
    if motion is None:
        times, positions = recording.time.tolist(), recording.position.tolist()
        velocities = repeat(None) if recording.velocity is None else recording.velocity.tolist()
    else:
        times, positions, velocities = motion.time.tolist(), motion.position.tolist(), repeat(None)
    forces = np.empty(len(times))
    for index, (time, position, velocity) in enumerate(zip(times, positions, velocities, strict=False)):
        newest: LearntModel | None = None
        while upcoming is not None and upcoming[0] + delay <= time + TIME_TOLERANCE:
            newest = upcoming[1]
            upcoming = next(models, None)
        if newest is not None:
            predictor.adopt(newest.model, newest.surface, newest.state)
        forces[index] = predictor.update(time, position, velocity)
    return forces


def _published(
    recording: Recording, learner: Learner, published: NDArray[np.int64] | None
) -> Iterator[tuple[float, LearntModel]]:
    """Times at which models are sent, and the models, learning as far as each needs and no further."""
    wanted = None if published is None else deque(published.tolist())
    velocities = repeat(None) if recording.velocity is None else recording.velocity.tolist()
    samples = zip(
        recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), velocities, strict=False
    )
    for index, (time, position, force, velocity) in enumerate(samples):
        learner.update(time, position, force, velocity)
        if wanted is None:
            yield time, learner.learnt()
        elif wanted and wanted[0] == index:
            wanted.popleft()
            yield time, learner.learnt()
