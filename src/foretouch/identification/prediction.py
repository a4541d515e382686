"""Prediction of a recorded motion's force under a delay, causally."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.identification.learner import Learner, LearntModel, require_learning
from foretouch.models import Predictor
from foretouch.quantities import ByValue, Columns, Recording

Array = NDArray[np.float64]

TIME_TOLERANCE = 1e-7
"""Times closer than this [s] count as equal: sample times in files are rounded."""


@dataclass(frozen=True)
class Motion(ByValue):
    """The operator's motion, where it is another one than the probe's, and when models reached the operator.

    Attributes:
        time: [s], increasing, shape (m,).
        position: [m], in the frame of the probe, shape (m,).
        published: Indices of the recording's samples after which a model was sent, not decreasing, shape (k,).
        arrived: When each of these models could be used [s], in the time of the motion; inf for one that was lost,
            shape (k,).
        ticks: Number of the sample of this motion, from 1, that the probe had reached when the model was sent,
            shape (k,).
        expected: Delay [s] that the estimator is told at each sample of the recording, NaN where it is told none; None
            where it is told none at all.
    """

    time: Array
    position: Array
    published: NDArray[np.int64]
    arrived: Array
    ticks: NDArray[np.int64]
    expected: Array | None = None


@dataclass(frozen=True, eq=False)
class PredictedForce(Columns):
    """A force predicted along a motion, one value a sample; columns of shape (n,).

    Attributes:
        force: [N]; 0 before the first model.
        standard_deviation: Of that force [N], NaN where the model carries no doubt.
        jump: Force less that of the model before, had it been kept, at each sample from which on another model
            predicts [N]; 0 at all other samples.
        time: Of the samples [s].
    """

    force: Array
    standard_deviation: Array
    jump: Array
    time: Array

    def columns(self) -> dict[str, Array]:
        """Time, force, its standard deviation, and what new models changed."""
        return {
            "time_s": self.time,
            "force_N": self.force,
            "standard_deviation_N": self.standard_deviation,
            "jump_N": self.jump,
        }


def predict(recording: Recording, learner: Learner, *, delay: float) -> PredictedForce:
    """Force that a leader would have rendered for the recorded motion, had the forces come under a delay.

    At time t the motion is known up to t and the forces up to t - delay: the model that predicts at t was learnt from
    samples no later than t - delay. A model is sent after every sample.

    Args:
        recording: What the follower felt.
        learner: Fresh; it is fed the recording sample by sample.
        delay: Of the forces [s], not negative.

    Returns:
        At each sample of the recording.

    Raises:
        SettingError: delay is negative or not finite.
        ArgumentTypeError: No recording, no learner, or no number.
    """
    require_learning(recording, learner)
    require("delay", delay, at_least=0.0)
    learner.estimator.expect_delay(delay)
    models = ((time + delay, index + 1, learner.learnt()) for index, time in enumerate(_learn(recording, learner)))
    return _run(recording.time, recording.position, _velocities(recording), models)


def predict_motion(recording: Recording, learner: Learner, motion: Motion) -> PredictedForce:
    """Force that a leader would have rendered for its own motion, learning from what the follower felt.

    Args:
        recording: What the follower felt.
        learner: Fresh; it is fed the recording sample by sample, as far as the models that arrive need.
        motion: The operator's.

    Returns:
        At each sample of the motion.
    """
    models = _sent(_learn(recording, learner, motion.expected), learner, motion)
    return _run(motion.time, motion.position, repeat(None), models)


def _sent(learnt: Iterator[float], learner: Learner, motion: Motion) -> Iterator[tuple[float, int, LearntModel]]:
    """Every model that arrives, as it was learnt when it was sent, with the time from which on it may be used."""
    sent = zip(motion.published.tolist(), motion.arrived.tolist(), motion.ticks.tolist(), strict=True)
    index = -1
    for place, arrival, tick in sent:
        if not arrival < math.inf:
            continue
        while index < place:
            next(learnt)
            index += 1
        yield arrival, tick, learner.learnt()


def _run(
    time: Array, position: Array, velocity: Iterable[float | None], models: Iterator[tuple[float, int, LearntModel]]
) -> PredictedForce:
    """Predict along a motion; models come with the time from which they may be used and the sample they belong to."""
    predictor = Predictor()
    upcoming = next(models, None)
    forces, deviations, jumps = np.empty((3, time.size))
    for index, (now, place, speed) in enumerate(zip(time.tolist(), position.tolist(), velocity, strict=False)):
        newest: tuple[float, int, LearntModel] | None = None
        while upcoming is not None and upcoming[0] <= now + TIME_TOLERANCE:
            newest = upcoming
            upcoming = next(models, None)
        if newest is not None:
            _, tick, learnt = newest
            predictor.adopt(learnt.model, learnt.surface, learnt.state, tick)
        forces[index] = predictor.update(now, place, speed)
        deviations[index] = predictor.standard_deviation
        jumps[index] = predictor.jump
    return PredictedForce(forces, deviations, jumps, time)


def _learn(recording: Recording, learner: Learner, expected: Array | None = None) -> Iterator[float]:
    """Feed the recording to the learner; yields the time of each sample once it is learnt."""
    told = repeat(math.nan) if expected is None else expected.tolist()
    columns = (recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), _velocities(recording))
    for time, position, force, velocity, delay in zip(*columns, told, strict=False):
        if not math.isnan(delay):
            learner.estimator.expect_delay(delay)
        learner.update(time, position, force, velocity)
        yield time


def _velocities(recording: Recording) -> Iterable[float | None]:
    return repeat(None) if recording.velocity is None else recording.velocity.tolist()
