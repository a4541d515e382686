"""What rendering makes of a prediction on a recorded motion: what mediation costs, where there is no session."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.identification import TIME_TOLERANCE, Learner
from foretouch.quantities import ByValue, Recording
from foretouch.rendering import Renderer


@dataclass(frozen=True, eq=False)
class MediatedForce(ByValue):
    """A force predicted along a recorded motion and what mediation let in of it; columns of shape (n,).

    Attributes:
        predicted: Of the newest model [N].
        mediated: For the hand, before the limits [N].
        bounded: Whether energy held the force back at this sample or had lowered it before: an offset remains.
        step: Part of the change of `mediated` that models made [N].
    """

    predicted: NDArray[np.float64]
    mediated: NDArray[np.float64]
    bounded: NDArray[np.bool_]
    step: NDArray[np.float64]


def mediate(recording: Recording, learner: Learner, *, delay: float, model_rate: float = 50.0) -> MediatedForce:
    """Render a recorded motion from models that come under a delay, as `foretouch.identification.predict` does.

    The motion is what it was: nobody felt the force.

    Args:
        recording: What the follower felt.
        learner: Fresh.
        delay: Of the models [s], not negative.
        model_rate: Models a second [1/s], positive.

    Raises:
        SettingError: A number out of range.
    """
    require("delay", delay, at_least=0.0)
    require("model_rate", model_rate, above=0.0)
    learner.estimator.expect_delay(delay)
    renderer, arriving = Renderer(), []
    predicted, mediated, step = np.zeros((3, recording.time.size))
    bounded = np.zeros(recording.time.size, dtype=np.bool_)
    speeds = [None] * recording.time.size if recording.velocity is None else recording.velocity.tolist()
    due, before, held = float(recording.time[0]), float(recording.time[0]), False
    rows = zip(recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), speeds, strict=True)
    for index, (time, position, force, speed) in enumerate(rows):
        learner.update(time, position, force, speed)
        if time >= due - TIME_TOLERANCE:
            due += 1.0 / model_rate
            arriving.append((time + delay, index + 1, learner.learnt()))
        while arriving and arriving[0][0] <= time + TIME_TOLERANCE:
            _, tick, learnt = arriving.pop(0)
            renderer.adopt(learnt.model, learnt.surface, learnt.state, tick)
        renderer.update(time, position, time - before)
        before, mediation = time, renderer.mediation
        held = mediation.held_back or (held and mediation.offset < 0.0)
        predicted[index], mediated[index], step[index] = renderer.predictor.force, mediation.force, mediation.step
        bounded[index] = held
    return MediatedForce(predicted, mediated, bounded, step)
