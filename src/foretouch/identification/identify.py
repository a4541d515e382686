"""Identification of a whole recording, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, plural
from foretouch.identification.conditioning.layout import SURFACE_THRESHOLD
from foretouch.identification.estimator import Estimator
from foretouch.identification.learner import Learner, RawSamples, require_learning, run_by_sample
from foretouch.models import ContactModel
from foretouch.quantities import Columns, Recording

Array = NDArray[np.float64]

FEWEST_CONTACT_SAMPLES = 50
"""Fewer samples in contact are refused: four parameters from less say nothing."""


@dataclass(frozen=True)
class Identification(Columns):
    """What a recording taught.

    Attributes:
        parameters: The law's numbers by name, after the last sample; None for one that is undetermined.
        standard_errors: By name, None where the estimator has none; those of the law alone, given `surface` and
            `force_offset`: where the surface is not known well, the parameters are less sure than they say.
        standard_errors_with_surface: The same, with how far each parameter moves where the surface lies one
            `surface_error` further out or in added in quadrature; None where the estimator cannot tell.
        surface: Position of the surface found [m], as the model counts from it.
        force_offset: Force in free air found [N].
        in_contact: The conditioner's judgement at every sample, shape (n,).
        residual: Measured force less the force of the model learnt before that sample [N]; NaN outside contact and
            before there was a model, shape (n,).
        contact_force_rms: RMS of the force over the samples that have a residual [N].
        history: Parameters after every sample by name, NaN before there was a model and where undetermined,
            shape (n,) each; empty where it was not asked for.
        model: After the last sample.
        surface_error: Standard error of where contact begins [m], 0 for a surface that was given: the scatter of the
            onsets, and how far out it may lie unnoticed, see `unnoticed_depth`.
        sensor_lag: How late forces are at least [s], beyond the lag that was given; None where nothing tells it.
        sensor_lag_error: Standard error of that [s].
        standard_deviation: Of the force at the last sample that has a residual [N], NaN where the model carries no
            doubt.
        time: Of the samples [s], shape (n,).
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
        return _rms(self.residual[np.isfinite(self.residual)])

    def columns(self) -> dict[str, NDArray[Any]]:
        """Time, residual, contact, and the history of every parameter that was kept."""
        return {"time_s": self.time, "residual_N": self.residual, "in_contact": self.in_contact} | self.history


def identify(recording: Recording, learner: Learner, *, keep_history: bool = False) -> Identification:
    """Feed a recording to a learner, and compare each force with that of the model learnt before it.

    Args:
        recording: Of presses.
        learner: Fresh.
        keep_history: Whether the parameters after every sample are kept, which takes longer than learning them.

    Raises:
        RecordingError: Fewer than 50 samples in contact, or never enough for a model.
        InputError: A learner that has learnt before.
        ArgumentTypeError: No recording, or no learner.
    """
    require_learning(recording, learner)
    learner.require_fresh()
    estimator = learner.estimator
    history = _History(len(recording)) if keep_history else None
    columns = recording.time, recording.position, recording.force, recording.velocity
    if history is None:
        found = learner.run(*columns)
    else:
        samples, kept = RawSamples(*columns), history
        found = run_by_sample(learner, samples, lambda index: kept.note(index, estimator.parameters))
    model, surface = estimator.model, learner.conditioner.surface - estimator.surface_correction
    contacts = int(found.in_contact.sum())
    if contacts < FEWEST_CONTACT_SAMPLES:
        raise RecordingError(
            recording.name,
            f"{plural(contacts, 'sample')} in contact, at least {FEWEST_CONTACT_SAMPLES} are needed for a model",
        )
    if model is None:
        raise RecordingError(recording.name, f"{estimator.name} found no model: {learner.learnt().reason}")
    surface_error = _surface_error(recording, learner, surface)
    return Identification(
        estimator.parameters,
        estimator.standard_errors,
        _errors_with_surface(estimator, surface_error),
        surface,
        learner.conditioner.force_offset,
        found.in_contact,
        found.residual,
        found.contact_force_rms,
        {} if history is None else history.columns,
        model,
        surface_error,
        learner.lag.lag,
        learner.lag.standard_error,
        found.standard_deviation,
        recording.time,
    )


def unnoticed_depth(depth: Array, force: Array, threshold: float) -> float:
    r"""How much further out contact may begin than where it was noticed [m].

    A law without damping, :math:`F = k (x + u)^n`, goes through the force :math:`F_0` that is felt at the depth 0 and
    through that around the threshold, :math:`F_1` at :math:`x_1`; then
    :math:`u = x_1 / ((F_1 / F_0)^{1/n} - 1)`. It grows with n, which is not known, and is given for n = 2, the end of
    the range of (5). Only where the force at the depth 0 is zero does contact begin there for sure.

    Args:
        depth: From where contact was noticed [m], shape (n,).
        force: Less its offset [N], shape (n,).
        threshold: At which contact was noticed [N].

    Returns:
        [m], 0 where there are no samples that tell it.
    """
    near = (depth > 0.0) & (force > 1.5 * threshold) & (force < 2.5 * threshold)
    if not near.any():
        return 0.0
    further, strong = float(depth[near].mean()), float(force[near].mean())
    there = force[np.abs(depth) < 0.1 * further]
    weak = max(float(there.mean()), 0.0) if there.size else 0.5 * threshold
    return further / (np.sqrt(strong / weak) - 1.0) if 0.0 < weak < strong else 0.0


def _surface_error(recording: Recording, learner: Learner, surface: float) -> float:
    """Of the onsets' scatter, and of what is unnoticed: that is at most two standard errors."""
    conditioner = learner.conditioner
    scatter = conditioner.surface_error
    if scatter == 0.0:  # given
        return 0.0
    force = recording.force - conditioner.force_offset
    threshold = float(conditioner.memory[SURFACE_THRESHOLD])
    unnoticed = unnoticed_depth(recording.position - surface, force, threshold)
    return float(np.hypot(scatter, 0.5 * unnoticed))


def _errors_with_surface(estimator: Estimator, surface_error: float) -> dict[str, float | None] | None:
    """A surface is no parameter of these laws: what it does to them is found by moving it."""
    errors = estimator.standard_errors
    if errors is None or surface_error == 0.0:
        return errors
    shifts = estimator.surface_shifts(surface_error)
    if shifts is None:
        return None
    return {name: None if error is None else float(np.hypot(error, shifts[name])) for name, error in errors.items()}


class _History:
    """Columns that grow by name as names turn up."""

    def __init__(self, size: int) -> None:
        self._size = size
        self.columns: dict[str, Array] = {}

    def note(self, index: int, parameters: Mapping[str, float | None]) -> None:
        for name, value in parameters.items():
            if name not in self.columns:
                self.columns[name] = np.full(self._size, np.nan)
            if value is not None:
                self.columns[name][index] = value


def _rms(values: Array) -> float:
    """Root of the mean square; the values are no longer theirs afterwards."""
    return float(np.sqrt(np.mean(np.square(values, out=values)))) if values.size else float("nan")
