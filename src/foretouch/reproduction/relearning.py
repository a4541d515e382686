"""Learning again from a session's log: by another estimator, with other choices, from fewer samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar, TypeVar

import numpy as np

from foretouch.identification import (
    FPRLS,
    ContactSample,
    Estimator,
    FPRLSOptions,
    Learner,
    RobustFPRLS,
    Status,
    make_estimator,
)
from foretouch.identification.linear.recursion import ErrorUnit
from foretouch.messages import SessionLog
from foretouch.models import ContactModel
from foretouch.quantities import Array, Brief
from foretouch.report import session_figures
from foretouch.reproduction.experiment import FORCE_DELAY
from foretouch.reproduction.section import Outcome
from foretouch.session import replay

FIELDS = (
    *("time", "iteration", "depth", "velocity", "force"),
    *("ln_k", "s", "b1", "b2", "damping", "exponent", "switching"),
)
"""Columns that `Watched` notes."""

RECOVERY_SPACING = 0.02
"""Period at which the numbers of law (4) are recovered from those of (18) [s], which is slower than learning."""


class Watched(Estimator):
    """Another estimator, fresh, given every so-many-th sample, with everything noted that it found.

    There is a row for each sample that was learnt from once there was a model, with the columns of `FIELDS`.
    """

    name: ClassVar[str] = "watched"
    model_name: ClassVar[str] = "continuous-switching"

    def __init__(self, estimator: Estimator, every: int = 1) -> None:
        self.estimator, self.every = estimator, every
        self.reset()

    def reset(self) -> None:
        """Forget all samples and notes."""
        self.estimator.reset()
        self.rows: list[tuple[float, ...]] = []
        self.updates = 0
        self._samples = 0
        self._status = Status.FREE_AIR
        self._model: ContactModel | None = None
        self._recovered: tuple[float, ...] = (math.nan,) * 3
        self._next_recovery = -math.inf

    def update(self, sample: ContactSample) -> Status:
        """Pass the sample on if it is its turn; the status is that of the newest sample that was passed on."""
        turn = self._samples % self.every == 0
        self._samples += 1
        if turn:
            before = self.estimator.updates
            self._status = self.estimator.update(sample)
            if self.estimator.updates != before:
                self.updates += 1
                self._model = self.estimator.model
                self._note(sample)
        return self._status

    def _note(self, sample: ContactSample) -> None:
        if self._model is None:
            return
        if sample.time >= self._next_recovery:
            self._next_recovery = sample.time + RECOVERY_SPACING
            result = self.estimator.parameters
            values = (result[name] for name in ("damping", "exponent", "switching"))
            self._recovered = tuple(math.nan if value is None else value for value in values)
        first, second, third, fourth = self._model.parameters
        if self._model.parameter_names[0] != "ln_k":  # law (4) itself: k, lambda, n, alpha
            first, second, third, fourth = math.log(max(first, 1e-300)), third + fourth, math.nan, math.nan
        row = (sample.time, float(self.updates), sample.depth, sample.velocity, sample.force)
        self.rows.append((*row, first, second, third, fourth, *self._recovered))

    def trust_surface(self, trusted: bool) -> None:
        """See `Estimator.trust_surface`."""
        self.estimator.trust_surface(trusted)

    def move_surface(self, change: float) -> None:
        """See `Estimator.move_surface`."""
        self.estimator.move_surface(change)

    @property
    def surface_correction(self) -> float:
        """See `Estimator.surface_correction`."""
        return self.estimator.surface_correction

    @property
    def model(self) -> ContactModel | None:
        """The law as it was known after the newest sample that was learnt from."""
        return self._model

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Those of the estimator."""
        return self.estimator.standard_errors

    @property
    def history(self) -> dict[str, Array]:
        """The notes by column, units SI; `iteration` counts the samples learnt from."""
        table = np.array(self.rows, dtype=np.float64).reshape(-1, len(FIELDS))
        return dict(zip(FIELDS, table.T.copy(), strict=True))


@dataclass(frozen=True)
class Choice:
    """An estimator with one answer to each question that the paper leaves open."""

    name: str  # for people
    every: int  # decimation of the samples at 1 kHz: 1 for all, 10 for a tenth of them
    make: Callable[[], Estimator]  # gives a fresh estimator
    test: ErrorUnit | None = None  # what the self-perturbing test sees, where that is a choice


def _fprls(every: int, rate: float, error: ErrorUnit, perturbation: float = 1e6) -> Choice:
    options = FPRLSOptions(forgetting_rate=rate, perturbation_error=error, perturbation=perturbation)
    parts = [f"fprls at {1000 // every} Hz", f"rho = {rate:g} /m", f"test in {error}"]
    if not perturbation > 0.0:
        parts[2] = "delta = 0"
    return Choice(", ".join(parts), every, lambda: FPRLS(options), error)


def _departures(answers: tuple[int, float, ErrorUnit]) -> int:
    every, rate, error = answers
    return (every != 1) + (rate != FPRLSOptions().forgetting_rate) + (error != "log")


_TESTS: tuple[ErrorUnit, ...] = ("log", "newton")
_ANSWERS = sorted(product((1, 10, 100), (1e3, 1e2, 1e4), _TESTS), key=_departures)

CHOICES = tuple(_fprls(*answers) for answers in _ANSWERS)
"""The paper's estimator under every combination of three open choices, the printed defaults first, then by the number
of departures: how many of the 1,000 samples a second it is given, how fast it forgets, and what its test sees."""

AS_PRINTED = CHOICES[0]
"""Every sample of the 1 kHz, rho = 1000 / m, the test on the innovation of ln F as equation (20) has it."""
ROBUST = Choice("robust-fprls", 1, RobustFPRLS)  # the paper's estimator with all that mends it on contact
EXACT = Choice("exact", 1, lambda: make_estimator("continuous-switching", "exact"))  # our own, on the exact law (4)

EVERY = (*CHOICES, ROBUST, EXACT)


def drawn(choice: Choice) -> dict[str, Choice]:
    """The choices that figures draw by a short label: one beside the printed one and the two others."""
    return {"printed": AS_PRINTED, "choice": choice, "robust": ROBUST, "exact": EXACT}


def legend_of(choice: Choice) -> str:
    """Name in a legend."""
    return "fprls, as printed" if choice is AS_PRINTED else choice.name


Found = TypeVar("Found")


def outcomes(
    result: Mapping[str, Found], test: Callable[[Found], tuple[bool, str]], deciding: Sequence[Choice] = CHOICES
) -> tuple[list[Outcome], list[Outcome]]:
    """What a test finds by choice: for the choices that decide a claim and `ROBUST`; and for those reported beside."""

    def of(choices: Iterable[Choice]) -> list[Outcome]:
        return [Outcome(choice.name, *test(result[choice.name])) for choice in choices]

    return of((*deciding, ROBUST)), of((ROBUST, EXACT))


def without_perturbation() -> tuple[Choice, ...]:
    """`CHOICES` with delta = 0."""
    return tuple(_fprls(*answers, perturbation=0.0) for answers in _ANSWERS)


def learn_again(log: SessionLog, choice: Choice) -> dict[str, Array]:
    """What an estimator finds over the whole session (`Watched.history`)."""
    felt = log.follower[log.follower["command_sequence"] > 0]
    watched = Watched(choice.make(), choice.every)
    learner = Learner(watched)
    clock = (felt["time_ns"] - felt["time_ns"][0]) * 1e-9
    for row in zip(clock.tolist(), felt["position"].tolist(), felt["sensor_force"].tolist(), strict=True):
        learner.update(*row)
    return watched.history


@dataclass(frozen=True, eq=False)
class Prediction(Brief):
    """A session as it would have been with another estimator; the operator is open loop and moves the same."""

    log: SessionLog  # the session with the other predicted force
    report: dict[str, Any]  # figures of the session (`foretouch.report.session_figures`)
    history: dict[str, Array]  # what the estimator found

    def error_from(self, time: float | None = None) -> float:
        """Error of the predicted force, perhaps scored from a time [s] on [% of the RMS of the contact force].

        It is inf where the error has no bound.
        """
        report = self.report if time is None else session_figures(self.log, score_from=time)
        return _bounded(report["prediction_error_percent"])

    @property
    def error(self) -> float:
        """Error of the predicted force over the whole session."""
        return self.error_from()

    @property
    def delayed_error(self) -> float:
        """Error of the delayed force over the same samples [%]."""
        return _bounded(self.report["delayed_force_error_percent"])


def _bounded(value: float | None) -> float:
    return math.inf if value is None else value


def predict_again(log: SessionLog, choice: Choice) -> Prediction:
    """Learn again and predict on the operator's motion, under the session's own delays."""
    watched = Watched(choice.make(), choice.every)
    predicted = replay(log, Learner(watched), delay=FORCE_DELAY).predicted
    leader = log.leader.copy()
    leader["predicted_force"], leader["model_jump"] = predicted.force, predicted.jump
    other = replace(log, leader=leader)
    return Prediction(other, session_figures(other), watched.history)
