"""One law by one estimator on one recording: everything that is measured of it.

It learns once, predicts under many delays, is fitted to the whole file, and is scored on a part of the samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from time import perf_counter
from typing import Any, Final

import numpy as np

from foretouch.comparison.cases import Case, Loaded, load
from foretouch.comparison.result import LocalStiffness, Prediction, Result
from foretouch.comparison.truth import Truth, convergence, local_stiffness, parameter_errors, unforeseeable
from foretouch.errors import ForetouchError, SettingError
from foretouch.errors.checks import require
from foretouch.identification import ContactSample, Learner, LearntModel, identify, make_estimator
from foretouch.identification.estimator import Estimator
from foretouch.identification.force_calibration import zero_in_hindsight
from foretouch.models import Predictor
from foretouch.quantities import Array, Flags, Recording
from foretouch.report import Forces, Scores, forces_under_delay, require_delay_within, score_prediction


class OnceLearnt(Learner):
    """A learner that learns a recording once and, fed with the same recording again, says the same from memory.

    So the prediction can be made under many delays for one learning. An estimator that learns for a certain delay
    (`Estimator.horizon`) learns anew for another one, by a fresh one that `make` gives. The contact floor of the
    recording [N] is as in `Learner`; the memory has the models known after each sample up to now.
    """

    def __init__(self, make: Callable[[], Estimator], *, contact_floor: float) -> None:
        super().__init__(make(), contact_floor=contact_floor)
        self._make = make
        self._floor = contact_floor
        self.memory: list[LearntModel] = []
        self._place = -1

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
            self.memory = []
        self._place = -1
        return self

    def update(self, time: float, position: float, force: float, velocity: float | None = None) -> ContactSample:
        """Learn from a sample that is new, recall what was learnt of one that is not."""
        self._place += 1
        if self._place == len(self.memory):
            super().update(time, position, force, velocity)
            self.memory.append(super().learnt())
        return self.sample

    def learnt(self) -> LearntModel:
        """The model after the newest sample."""
        return self.memory[self._place] if self._place >= 0 else super().learnt()


def whole_file_force(recording: Recording, estimator: Estimator, known: Learner) -> Array:
    """Force [N] of a fit of the whole recording along its motion, shape (n,): without delay, and not causal.

    It is 0 where no fit was possible. The estimator is fresh; `known` has learnt the recording: where the surface
    is and what the force in free air is.
    """
    conditioner = known.conditioner
    learner = Learner(
        estimator,
        surface=None if np.isnan(conditioner.surface) else conditioner.surface,
        force_offset=conditioner.force_offset,
        contact_floor=recording.contact_floor,
    )
    for sample in _samples(recording):
        learner.update(*sample)
    estimator.finish()
    learnt, predictor = learner.learnt(), Predictor()
    if learnt.model is not None:
        predictor.adopt(learnt.model, learnt.surface, learnt.model.initial_state())
    return np.array([predictor.update(time, position, speed) for time, position, _, speed in _samples(recording)])


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
    """Score a prediction as `score_prediction` does, on those samples that are not left out, flags of shape (n,).

    The zero of the measured force is found in all samples, errors and contact force in those that stay. Window [s after
    the first sample], contact floor [N] (None for that of the recording) and errors are those of `score_prediction`.
    """
    kept = np.ones(forces.time.size, dtype=np.bool_) if left_out is None else ~left_out
    time = forces.time[kept]
    moved = float(time[0] - forces.time[0]) if time.size else 0.0
    whole = forces.time, forces.measured, forces.position, forces.contact_floor
    zero = zero_in_hindsight(*whole)[0] if forces.time.size else None
    return score_prediction(
        time,
        forces.measured[kept],
        forces.predicted[kept],
        forces.delayed[kept],
        contact_floor=forces.contact_floor if contact_floor is None else contact_floor,
        score_from=score_from - moved,
        score_to=None if score_to is None else score_to - moved,
        delayed_offset=0.0,
        position=forces.position[kept],
        offset=zero,
        skipped=None if forces.skipped is None else forces.skipped[kept],
    )


SWEEP: Final = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0)
"""Delays of the plot of error against delay [s]."""

UNIFORM_SPREAD: Final = 1.0 / math.sqrt(12.0)
"""Standard deviation of a number of which only its range of length 1 is known."""

EXPONENTS: Final = ("exponent", "switching", "s")
"""Parameters whose range has the length 1, by equation (5) of the paper or in practice."""


@dataclass(frozen=True)
class Scoring:
    """Settings of how predictions are scored.

    Attributes:
        delays: Delays of the forces [s], 0 or more, at least one.
        score_from: Start of the window [s after the first sample]; None: 1.5, simulated recordings 3.
        score_to: End of the window, None for the last sample.
        contact_floor: Smallest force that counts as contact [N]; None takes that of the recording.

    Raises:
        SettingError: A value out of range, or no delay.
    """

    delays: tuple[float, ...] = (0.3,)
    score_from: float | None = None
    score_to: float | None = None
    contact_floor: float | None = None

    def __post_init__(self) -> None:
        if not self.delays:
            raise SettingError("delays", self.delays, "must be at least one")
        for delay in self.delays:
            require("delay", delay, at_least=0.0)
        if self.score_from is not None:
            require("score_from", self.score_from)
        if self.score_to is not None:
            require("score_to", self.score_to)
            if self.score_from is not None and self.score_to <= self.score_from:
                raise SettingError("score_to", self.score_to, f"must be later than score_from = {self.score_from:g} s")
        if self.contact_floor is not None:
            require("contact_floor", self.contact_floor, above=0.0)


@dataclass(frozen=True)
class Combination:
    """One law by one estimator on one case, and the scoring: what one worker does at a time."""

    case: Case
    model: str
    estimator: str
    scoring: Scoring


def try_combination(job: Combination) -> Result:
    """Measure one combination; whatever goes wrong is the reason in its result."""
    try:
        return measure(job)
    except ForetouchError as error:
        return failed(job, str(error))
    except Exception as error:  # an estimator's own fault is a result too, and the others go on
        return failed(job, f"{type(error).__name__}: {error}")


def failed(job: Combination, reason: str) -> Result:
    """The result of a combination that gave none; the reason without the recording's name, which the result has."""
    text = " ".join(reason.split()).removeprefix(f"{job.case.path}: ")
    return Result(job.case.name, job.model, job.estimator, "failed", text)


def measure(job: Combination) -> Result:
    """Measure one combination.

    A ForetouchError says that the recording cannot be read, is no longer than a delay, or lets nothing be identified.
    """
    loaded = load(job.case)
    for delay in job.scoring.delays:
        require_delay_within(loaded.recording if loaded.log is None else loaded.log, delay)
    floor = loaded.recording.contact_floor
    learner = Learner(make_estimator(job.model, job.estimator), contact_floor=floor)
    begin = perf_counter()
    fit = identify(loaded.recording, learner)
    seconds = perf_counter() - begin
    residual, contact = fit.residual_rms, fit.contact_force_rms
    once, truth = OnceLearnt(partial(make_estimator, job.model, job.estimator), contact_floor=floor), loaded.truth
    if truth is not None:
        once.learn(loaded.recording)
    floor_force = _floor_force(job, loaded, learner)
    predictions = tuple(_prediction(job, loaded, once, floor_force, delay) for delay in job.scoring.delays)
    return Result(
        job.case.name,
        job.model,
        job.estimator,
        "ok",
        samples=len(loaded.recording),
        contact_samples=int(fit.in_contact.sum()),
        residual_percent=100.0 * residual / contact if contact > 0.0 else None,
        us_per_sample=1e6 * seconds / len(loaded.recording),
        parameters=fit.parameters,
        standard_errors=fit.standard_errors,
        warnings=inseparable(fit.parameters, fit.standard_errors),
        predictions=predictions,
        convergence=() if truth is None else convergence(loaded.recording, truth, once.memory),
        parameter_errors={} if truth is None else parameter_errors(job.model, fit.parameters, truth),
        local_stiffness=None if truth is None else _local_stiffness(learner, truth),
    )


def inseparable(
    parameters: Mapping[str, float | None], standard_errors: Mapping[str, float | None] | None
) -> tuple[str, ...]:
    """One sentence for each parameter that the samples do not tell from the others.

    That is one that is undetermined, a strength whose standard error is larger than itself, and an exponent whose
    standard error is larger than that of a number of which only its range of length 1 is known.
    """
    sentences = []
    for name, value in parameters.items():
        error = (standard_errors or {}).get(name)
        if value is None:
            sentences.append(f"{name} is undetermined")
        elif error is None:
            continue
        elif name in EXPONENTS and not error <= UNIFORM_SPREAD:
            sentences.append(f"{name} has the standard error {error:.2g}: more than if nothing were known of it")
        elif name in ("stiffness", "damping") and not error <= abs(value):
            sentences.append(f"{name} has the standard error {error:.2g}: more than itself")
    return tuple(sentences)


def _floor_force(job: Combination, loaded: Loaded, learner: Learner) -> Forces | None:
    """Force of a fit of the whole recording, where the estimator is of that kind; None for all others."""
    if not learner.estimator.offline:
        return None
    recording = loaded.recording
    force = whole_file_force(recording, make_estimator(job.model, job.estimator), learner)
    return Forces(recording.time, recording.position, recording.force, force, recording.force, recording.contact_floor)


def _prediction(
    job: Combination, loaded: Loaded, learner: OnceLearnt, whole_file: Forces | None, delay: float
) -> Prediction:
    scoring = job.scoring
    window: dict[str, Any] = {
        "score_from": job.case.score_from if scoring.score_from is None else scoring.score_from,
        "score_to": scoring.score_to,
        "contact_floor": scoring.contact_floor,
    }

    def floor(left_out: Flags | None) -> float | None:
        return None if whole_file is None else score_outside(whole_file, left_out, **window).prediction_error_percent

    if loaded.log is None:
        forces = forces_under_delay(loaded.recording, learner.again(delay), delay)
    else:  # a session tells the estimator its own delays as they come
        fresh = Learner(make_estimator(job.model, job.estimator), contact_floor=loaded.recording.contact_floor)
        forces = forces_under_delay(loaded.log, fresh, delay)
    scores = score_outside(forces, None, **window)
    plain = Prediction(
        delay,
        scores.prediction_error_percent,
        scores.delayed_force_error_percent,
        scores.within_jnd_percent,
        scores.status,
        whole_file_error_percent=floor(None),
        **forces.perception(scores),
    )
    if loaded.truth is None:
        return plain
    hidden = unforeseeable(forces.time, loaded.truth.depth, delay, loaded.truth.changes)
    foreseeable = score_outside(forces, hidden, **window)
    return replace(
        plain,
        unforeseeable_percent=100.0 * float(hidden.mean()),
        foreseeable_prediction_error_percent=foreseeable.prediction_error_percent,
        foreseeable_delayed_force_error_percent=foreseeable.delayed_force_error_percent,
        foreseeable_whole_file_error_percent=floor(hidden),
    )


def _local_stiffness(learner: Learner, truth: Truth) -> LocalStiffness | None:
    if truth.law is None:
        return None
    depth = 0.5 * float(truth.depth.max())
    true = local_stiffness(truth.law, depth)
    model = learner.learnt().model
    if model is None:
        return LocalStiffness(depth, None, true, None)
    estimated = local_stiffness(model, depth)
    return LocalStiffness(depth, estimated, true, 100.0 * (estimated / true - 1.0))
