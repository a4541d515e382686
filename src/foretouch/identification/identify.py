"""Identification from a recording, sample by sample, and causal prediction of its force under a delay."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError, RecordingError, plural
from foretouch.errors.checks import require
from foretouch.identification.conditioning.conditioner import ContactSamples
from foretouch.identification.estimator import Estimator
from foretouch.identification.exact.recursive import ExactContinuousSwitching
from foretouch.identification.force_calibration import is_zero_unobservable
from foretouch.identification.learner import Learner, LearntModel, RawSamples, learner_of, run_by_sample
from foretouch.identification.offline import Foot, find_foot
from foretouch.models import ContactMapModel, ContactModel, Predictor
from foretouch.quantities import ByValue, Columns, Recording

Array = NDArray[np.float64]

FEWEST_CONTACT_SAMPLES = 50  # Least number of samples in contact: fewer do not determine four parameters
HALF_SLOPE = 5e-3  # Time to either side over which a velocity is the slope of the positions [s]
MOST_SAMPLES = 1 << 18  # Largest number of samples, about, that are looked at in hindsight


@dataclass(frozen=True)
class Identification(Columns):
    """Result of identification from a recording.

    Attributes:
        parameters: The law's numbers by name, learnt from `surface` and `force_offset`; None for one that is
            undetermined. For a contact map those of law (4) by `ExactContinuousSwitching`.
        standard_errors: Standard errors by name, None where the estimator has none; those of the law alone, given
            `surface` and `force_offset`: where the surface is uncertain, the parameters are more so.
        standard_errors_with_surface: The same, with the uncertainty of both; None where the estimator cannot say it.
        surface: Position of the surface [m], as the model counts from it: as given, or as `find_foot` finds it in the
            whole recording.
        force_offset: Force in free air [N], given or found likewise.
        in_contact: The conditioner's judgement at every sample, shape (n,).
        residual: Measured force less the force of the model learnt before that sample [N]; NaN outside contact and
            before there was a model, shape (n,).
        contact_force_rms: RMS of the force over the samples that have a residual [N].
        history: Parameters after every sample by name, as they were learnt from the surface that was known by then, NaN
            before there was a model and where undetermined, shape (n,) each; empty where it was not asked for.
        model: Model that has `parameters`.
        surface_error: Standard error of where contact begins [m]: 0 for a surface that was given, NaN where the
            recording does not tell it, as where it never leaves contact; then `surface` is where contact was noticed.
        sensor_lag: Least lag of the force [s], beyond the lag that was given; None where it cannot be estimated.
        sensor_lag_error: Standard error of that lag [s].
        standard_deviation: That of the force at the last sample that has a residual [N], NaN where the model has none.
        time: Sample times [s], shape (n,).
    """

    parameters: dict[str, float | None]
    standard_errors: dict[str, float | None] | None
    standard_errors_with_surface: dict[str, float | None] | None
    surface: float
    force_offset: float
    in_contact: NDArray[np.bool_]
    residual: Array
    contact_force_rms: float
    history: dict[str, Array]
    model: ContactModel
    surface_error: float
    sensor_lag: float | None
    sensor_lag_error: float | None
    standard_deviation: float
    time: Array

    @property
    def residual_rms(self) -> float:
        """RMS of the one-step residual [N], NaN where there is none."""
        values = self.residual[np.isfinite(self.residual)]
        return float(np.sqrt(np.mean(np.square(values)))) if values.size else math.nan

    def columns(self) -> dict[str, NDArray[Any]]:
        """Time, residual, contact, and the history of every parameter that was kept."""
        return {"time_s": self.time, "residual_N": self.residual, "in_contact": self.in_contact} | self.history


def identify(
    recording: Recording, learner: Learner | Estimator | None = None, *, keep_history: bool = False
) -> Identification:
    """Feed a recording to a learner, and compare each force with that of the model learnt before it.

    Sample by sample, a surface is noticed late. Once the recording is known, it and the force in free air are found by
    `find_foot`, unless they were given, and the law is learnt again from there; not where the material has changed.

    Args:
        recording: Recording of presses.
        learner: Fresh; or an estimator alone, which finds surface and offset; None for a `ContactMap`.
        keep_history: Whether the parameters after every sample are kept, which takes longer than learning them.

    Raises:
        RecordingError: Fewer than 50 samples in contact, or never enough for a model.
        InputError: The learner has learnt before.
        ArgumentTypeError: An argument is not a recording, or not a learner.
    """
    learner = learner_of(recording, learner)
    if not math.isnan(learner.sample.time):
        raise InputError("the learner has learnt from samples before: make a fresh one for each recording")
    estimator = learner.estimator
    history = defaultdict[str, Array](lambda: np.full(len(recording), math.nan))  # columns as names turn up
    columns = recording.time, recording.position, recording.force, recording.velocity

    def note(index: int) -> None:
        for name, value in estimator.parameters.items():
            history[name][index] = math.nan if value is None else value

    result = run_by_sample(learner, RawSamples(*columns), note) if keep_history else learner.run(*columns)
    contacts = int(result.in_contact.sum())
    if contacts < FEWEST_CONTACT_SAMPLES:
        raise RecordingError(
            recording.name,
            f"{plural(contacts, 'sample')} in contact, at least {FEWEST_CONTACT_SAMPLES} are needed for a model",
        )
    estimator.finish()
    surface_error, law = _learn_in_hindsight(recording, learner)
    model = estimator.model
    if model is None:
        raise RecordingError(recording.name, f"{estimator.name} found no model: {learner.learnt().reason}")
    return Identification(
        law.parameters,
        law.standard_errors,
        law.standard_errors_with_surface or (law.standard_errors if surface_error == 0.0 else None),
        learner.conditioner.surface - estimator.surface_correction,
        learner.conditioner.force_offset,
        result.in_contact,
        result.residual,
        result.contact_force_rms,
        dict(history),
        model,
        surface_error,
        learner.lag.lag,
        learner.lag.standard_error,
        result.standard_deviation,
        recording.time,
    )


def _learn_in_hindsight(recording: Recording, learner: Learner) -> tuple[float, Estimator]:
    """Find what was not given of surface and offset, and learn again from there.

    A map needs no surface and stays where it is: its depths count from elsewhere, and the law alone is learnt again.

    Returns:
        Standard error of the surface [m], and the estimator of the law's numbers.
    """
    estimator, conditioner = learner.estimator, learner.conditioner
    given, lag = (conditioner.surface_given, conditioner.offset_error == 0.0), conditioner.lag
    guess = conditioner.surface, conditioner.force_offset
    time, position, velocity, force = _without_lag(recording, lag)

    def refit(foot: Foot) -> bool:
        samples = ContactSamples(time, position - foot.surface, velocity, force - foot.offset)
        return estimator.refit(samples, foot.covariance)

    if all(given):
        refit(Foot(*guess, np.zeros((2, 2))))
        return 0.0, estimator
    tells = estimator.changes == 0 and not is_zero_unobservable(recording)
    foot = find_foot(position, velocity, force, guess, given) if tells else None
    if foot is None:
        return 0.0 if given[0] else math.nan, estimator
    stays = estimator.model_name == ContactMapModel.law
    if stays:
        estimator.move_surface(foot.surface - guess[0])
        estimator.move_offset(foot.offset - guess[1])
        stays = estimator.has_model  # a map that was moved far begins anew
    law = ExactContinuousSwitching() if stays else estimator
    surface, offset, _ = foot
    known = Learner(law, surface=surface, force_offset=offset, contact_floor=conditioner.floor, sensor_lag=lag)
    law.trust_surface(given[0])
    if stays or not refit(foot):
        law.reset()
        known.run(recording.time, recording.position, recording.force, recording.velocity)
    learner.conditioner = known.conditioner
    return estimator.surface_error or math.sqrt(foot.covariance[0, 0]), law


def _without_lag(recording: Recording, lag: float) -> tuple[Array, Array, Array, Array]:
    """Time, position, velocity and force of evenly chosen samples, neither position nor velocity late or early.

    Args:
        recording: Its velocity is taken where it was measured, else slopes of the position to both sides.
        lag: Of the forces behind the positions [s].
    """
    clock = recording.time
    chosen = slice(None, None, 1 + clock.size // MOST_SAMPLES)
    instants = np.clip(clock[chosen] - lag, clock[0], clock[-1])
    if recording.velocity is not None:
        velocity = np.interp(instants, clock, recording.velocity)
    else:
        ends = np.clip((instants - HALF_SLOPE, instants + HALF_SLOPE), clock[0], clock[-1])
        velocity = np.diff(np.interp(ends, clock, recording.position), axis=0)[0] / np.diff(ends, axis=0)[0]
    return clock[chosen], np.interp(instants, clock, recording.position), velocity, recording.force[chosen]


TIME_TOLERANCE = 1e-7
"""Difference below which times count as equal [s]: sample times in files are rounded."""


@dataclass(frozen=True)
class Motion(ByValue):
    """The operator's motion, where it differs from the probe's, and when models reached the operator.

    Attributes:
        time: Sample times [s], increasing, shape (m,).
        position: Positions [m], in the frame of the probe, shape (m,).
        published: Indices of the recording's samples after which a model was sent, not decreasing, shape (k,).
        arrived: When each of these models could be used [s], in the time of the motion; inf for a lost one, shape (k,).
        ticks: Number of the sample of this motion, from 1, that the probe had reached when the model was sent,
            shape (k,).
        expected: Delay [s] that is passed to the estimator at each sample of the recording, NaN where none is; None
            where none is passed at all.
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
        force: Force [N]; 0 before the first model.
        standard_deviation: Standard deviation of that force [N], NaN where the model has none.
        jump: Force less that of the model before, had it been kept, at each sample from which on another model
            predicts [N]; 0 at all other samples.
        time: Sample times [s].
    """

    force: Array
    standard_deviation: Array
    jump: Array
    time: Array

    def columns(self) -> dict[str, Array]:
        """Time, force, its standard deviation, and its jumps at new models."""
        return {
            "time_s": self.time,
            "force_N": self.force,
            "standard_deviation_N": self.standard_deviation,
            "jump_N": self.jump,
        }


def predict(recording: Recording, learner: Learner | Estimator | None = None, *, delay: float) -> PredictedForce:
    """Force that a leader would have rendered for the recorded motion, had the forces arrived with a delay.

    At time t the motion is known up to t and the forces up to t - delay: the model that predicts at t was learnt from
    samples no later than t - delay. A model is sent after every sample.

    Args:
        recording: Recording of the follower.
        learner: Fresh, as of `identify`; it is fed the recording sample by sample.
        delay: Delay of the forces [s], not negative.

    Returns:
        The prediction at each sample of the recording.

    Raises:
        SettingError: delay is negative or not finite.
        ArgumentTypeError: An argument is not a recording, a learner, or a number.
    """
    learner = learner_of(recording, learner)
    require("delay", delay, at_least=0.0)
    learner.estimator.expect_delay(delay)
    models = ((time + delay, index + 1, learner.learnt()) for index, time in enumerate(_learn(recording, learner)))
    return _run(recording.time, recording.position, _velocities(recording), models)


def predict_motion(recording: Recording, learner: Learner, motion: Motion) -> PredictedForce:
    """Force that a leader would have rendered for its own motion, learning from the follower's recording.

    Args:
        recording: Recording of the follower.
        learner: Fresh; it is fed the recording sample by sample, as far as the models that arrive need.
        motion: The operator's motion.

    Returns:
        The prediction at each sample of the motion.
    """
    models = _sent(_learn(recording, learner, motion.expected), learner, motion)
    return _run(motion.time, motion.position, repeat(None), models)


def _sent(learnt: Iterator[float], learner: Learner, motion: Motion) -> Iterator[tuple[float, int, LearntModel]]:
    """Every model that arrives, as it was learnt when it was sent, with the time from which on it may be used."""
    sent = zip(motion.published.tolist(), motion.arrived.tolist(), motion.ticks.tolist(), strict=True)
    index = -1
    for position, arrival, tick in sent:
        if not arrival < math.inf:
            continue
        while index < position:
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
    for index, (now, point, speed) in enumerate(zip(time.tolist(), position.tolist(), velocity, strict=False)):
        newest: tuple[float, int, LearntModel] | None = None
        while upcoming is not None and upcoming[0] <= now + TIME_TOLERANCE:
            newest = upcoming
            upcoming = next(models, None)
        if newest is not None:
            _, tick, learnt = newest
            predictor.adopt(learnt.model, learnt.surface, learnt.state, tick)
        forces[index] = predictor.update(now, point, speed)
        deviations[index] = predictor.standard_deviation
        jumps[index] = predictor.jump
    return PredictedForce(forces, deviations, jumps, time)


def _learn(recording: Recording, learner: Learner, expected: Array | None = None) -> Iterator[float]:
    """Feed the recording to the learner; yields the time of each sample once it is learnt."""
    reported = repeat(math.nan) if expected is None else expected.tolist()
    columns = (recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), _velocities(recording))
    for time, position, force, velocity, delay in zip(*columns, reported, strict=False):
        if not math.isnan(delay):
            learner.estimator.expect_delay(delay)
        learner.update(time, position, force, velocity)
        yield time


def _velocities(recording: Recording) -> Iterable[float | None]:
    return repeat(None) if recording.velocity is None else recording.velocity.tolist()
