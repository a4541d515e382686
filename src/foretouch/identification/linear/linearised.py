"""What all least squares on the linearised law (18) share: options, regressors, model, recovered law, and runs."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import SettingError
from foretouch.identification.conditioning.conditioner import ContactSample, ContactSamples
from foretouch.identification.estimator import FEWEST_UPDATES, Estimator, Status, status_indices
from foretouch.identification.linear.kernel import Samples, begin, run, update
from foretouch.identification.linear.options import (
    NOTHING_FORGOTTEN,
    Forgetting,
    FPRLSOptions,
    Recording,
    full_covariance,
    pack,
)
from foretouch.identification.linear.recovery import recover
from foretouch.identification.linear.recursion import LARGEST_TRACE, error_along
from foretouch.models import LinearisedContinuousSwitching
from foretouch.quantities import ByValue

Array = NDArray[np.float64]

STATUSES = (Status.LEARNT, Status.FREE_AIR, Status.UNUSABLE, Status.GATED, Status.RESTARTED, Status.LEARNT)
"""By what the kernel answers; the last is a sample that also tripped the self-perturbing test."""

_INDICES = status_indices(STATUSES)

SIDE_BY_SIDE = 64  # Recordings whose samples are brought into order at once: they stay in the cache


@dataclass(frozen=True, eq=False, slots=True)
class LinearRuns(ByValue):
    """What a linear estimator made of n recordings of m samples.

    Attributes:
        theta: (ln k, s, b1, b2) after the last sample, depth in metres, shape (n, 4).
        unscaled_covariance: P of the unknowns in the units of the regressors, shape (n, 4, 4).
        residual_variance: Of a target of weight 1, NaN from too few samples, shape (n,).
        updates: Samples learnt from since the last restart, shape (n,).
        restarts: How often the covariance broke, shape (n,).
        perturbations: How often the self-perturbing test tripped, shape (n,).
        every: Theta after each sample, shape (m, n, 4), None where it was not asked for.
    """

    theta: Array
    unscaled_covariance: Array
    residual_variance: Array
    updates: NDArray[np.int64]
    restarts: NDArray[np.int64]
    perturbations: NDArray[np.int64]
    every: Array | None


def residual_variance(squares: ArrayLike, count: ArrayLike) -> Array:
    """Weighted squares of residuals over their number less the four unknowns; NaN from too few samples."""
    freedom = np.asarray(count, np.float64) - 4.0
    variance = np.asarray(squares, np.float64) / np.where(freedom > 0.0, freedom, np.nan)
    return np.where(np.isfinite(variance), variance, np.nan)


def to_metres(theta: Array, depth_scale: float, velocity_scale: float) -> Array:
    """(ln k, s, b1, b2) with depth in metres, of those of the regressors in use, shape (..., 4)."""
    in_metres = theta.copy()
    in_metres[..., 0] -= np.log(depth_scale) * theta[..., 1]
    in_metres[..., 2] *= 1.0 / velocity_scale
    in_metres[..., 3] *= depth_scale / velocity_scale
    return in_metres


def as_recordings(depth: ArrayLike, velocity: ArrayLike, force: ArrayLike, in_contact: ArrayLike | None) -> Samples:
    """Samples of recordings side by side as arrays of shape (m, n).

    Raises:
        SettingError: One of the arrays has another shape than the depth, or the depth is not of two dimensions.
    """
    x, v, f = (np.asarray(column, np.float64) for column in (depth, velocity, force))
    touching = np.ones(x.shape, np.bool_) if in_contact is None else np.asarray(in_contact, np.bool_)
    if x.ndim != 2:
        raise SettingError("shape of depth", x.shape, "must be (m, n)")
    for name, values in {"velocity": v, "force": f, "in_contact": touching}.items():
        if values.shape != x.shape:
            raise SettingError(f"shape of {name}", values.shape, f"must be that of depth, {x.shape}")
    return x, v, f, touching


class LinearisedEstimator(Estimator):
    r"""Least squares on (18), `ln F = ln k + s ln x + b1 v + b2 v / x`; the leaves say how old samples are forgotten.

    Samples with a depth or a force too small for a logarithm are left out (the paper does not say what it does with
    them). A covariance that overflows or loses positive definiteness, which the printed equations allow, is set back
    to P_0, and theta to theta_0, and the update says so.

    `parameters` has ln_k, s, b1, b2 and the law (4) that they stand for: stiffness, damping, exponent, switching, where
    they are determined (`foretouch.identification.linear.recovery`).

    `update` takes one sample, `run` a recording, `run_many` many recordings: `foretouch.identification.linear.kernel`.

    Args:
        options: The choices that the paper leaves open.
        forgetting: How old samples are forgotten; by default not at all.
    """

    model_name: ClassVar[str] = "continuous-switching"
    errors_mean_something: ClassVar[bool] = False

    def __init__(self, options: FPRLSOptions, forgetting: Forgetting = NOTHING_FORGOTTEN) -> None:
        self.options = options
        self.forgetting = forgetting
        # theta in metres is this matrix times theta of the regressors in use
        self._to_metres = to_metres(np.eye(4), *options.scales).T.copy()
        theta = np.asarray(np.linalg.solve(self._to_metres, options.initial_parameters), np.float64)
        self._packed = pack(options, forgetting, theta)
        self._recordings = Recording.new(options=self._packed)
        self._state, self._updates = self._recordings[0].state, self._recordings["state"]["updates"]
        self.reset()
        self._update = update.entry

    def reset(self) -> None:
        """Forget all samples."""
        begin(self._recordings)

    def update(self, sample: ContactSample) -> Status:
        """One step; see `Estimator.update`."""
        return STATUSES[self._update(self._recordings, *sample[1:])]

    @property
    def updates(self) -> int:  # type: ignore[override]
        """Samples learnt from since the last reset or restart."""
        return int(self._updates.item())

    @property
    def perturbations(self) -> int:
        """How often the self-perturbing test tripped since the last reset."""
        return int(self._state.perturbations)

    def run(self, samples: ContactSamples) -> NDArray[np.int8]:
        """See `Estimator.run`; one compiled loop."""
        return self._run(samples, np.empty((0, 4)))

    def trajectory(self, samples: ContactSamples) -> Array:
        """`run`, and (ln k, s, b1, b2) after each sample, depth in metres, shape (n, 4)."""
        trace = np.empty((len(samples), 4))
        self._run(samples, trace)
        return to_metres(trace, *self.options.scales)

    def _run(self, samples: ContactSamples, trace: Array) -> NDArray[np.int8]:
        """What was done with each sample; theta after each goes into the trace, if that has rows."""
        codes = np.empty(len(samples), np.int8)
        run(self._recordings, samples.columns[1:], codes, trace)
        return _INDICES[codes]

    def run_many(
        self,
        depth: ArrayLike,
        velocity: ArrayLike,
        force: ArrayLike,
        in_contact: ArrayLike | None = None,
        *,
        every: bool = False,
        parallel: bool = False,
    ) -> LinearRuns:
        """`run` with many recordings, each from theta_0 and P_0; the estimator itself learns nothing.

        The same bits as `run` of a fresh estimator with each column.

        Args:
            depth: Below the surface [m], shape (m, n): m samples of n recordings. Shorter recordings are filled up
                with NaN, which is left out.
            velocity: [m/s], positive while deepening, shape (m, n).
            force: On the probe [N], shape (m, n).
            in_contact: Whether the probe touches, shape (m, n); by default everywhere: what has no usable depth or
                force is left out anyway, but the path through free air then counts as moved.
            every: Whether theta after each sample is wanted too.
            parallel: Whether all cores are used.

        Raises:
            SettingError: Arrays that do not fit together.
        """
        samples = as_recordings(depth, velocity, force, in_contact)
        size, count = samples[0].shape
        recordings = np.repeat(Recording.new(options=self._packed), count)
        begin(recordings)
        trace = np.empty((count, size if every else 0, 4))

        def run_some(first: int) -> None:
            codes = np.empty(size, np.int8)
            columns = (np.ascontiguousarray(column[:, first : first + SIDE_BY_SIDE].T) for column in samples)
            for index, (x, v, f, touching) in enumerate(zip(*columns, strict=True), first):
                run(recordings[index : index + 1], (x, v, f, touching), codes, trace[index])

        firsts = range(0, count, SIDE_BY_SIDE)
        if parallel:
            with ThreadPoolExecutor(os.cpu_count()) as pool:  # a run needs no interpreter
                list(pool.map(run_some, firsts))
        else:
            list(map(run_some, firsts))
        states, scales = recordings["state"], self.options.scales
        numbers = states["numbers"]
        return LinearRuns(
            to_metres(numbers[:, :4], *scales),
            np.moveaxis(full_covariance(numbers[:, 4:14].T), 2, 0),
            residual_variance(numbers[:, 14], numbers[:, 15]),
            states["updates"],
            states["restarts"],
            states["perturbations"],
            np.moveaxis(to_metres(trace, *scales), 0, 1) if every else None,
        )

    @property
    def linear_parameters(self) -> tuple[float, float, float, float]:
        """(ln k, s, b1, b2) as they are now, depth in metres; theta_0 before the first sample."""
        ln_k, s, b1, b2 = to_metres(self._state.numbers[:4], *self.options.scales).tolist()
        return ln_k, s, b1, b2

    @property
    def unscaled_covariance(self) -> Array:
        """A copy of P, shape (4, 4), of the unknowns in the units of the regressors."""
        return full_covariance(self._state.numbers[4:14])

    @property
    def covariance(self) -> Array | None:
        """Of `linear_parameters`, shape (4, 4); None before it is known, and where standard errors mean nothing."""
        return self._covariance() if self.errors_mean_something else None

    @property
    def model(self) -> LinearisedContinuousSwitching | None:
        """The law (18), None before 20 samples or while a parameter is not finite."""
        values = self.linear_parameters
        if self.updates < FEWEST_UPDATES or not all(map(math.isfinite, values)):
            return None
        return LinearisedContinuousSwitching(*values)

    @property
    def parameters(self) -> dict[str, float | None]:
        """ln_k, s, b1, b2, then stiffness, damping, exponent, switching; see `Estimator.parameters`."""
        linear = super().parameters
        return linear and linear | recover(self.linear_parameters, self._covariance(), self._state.bins)._asdict()

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """By name, None where the estimator has none to give.

        Those of the recovered law follow from the change of each by the four linear numbers.
        """
        model, covariance = self.model, self._covariance()
        if not self.errors_mean_something or model is None or covariance is None:
            return None
        errors = np.sqrt(np.maximum(0.0, np.diag(covariance)))
        known = dict(zip(model.parameter_names, errors.tolist(), strict=True))
        centre, bins = np.array(self.linear_parameters), self._state.bins
        ends = [
            [recover((centre + sign * side).tolist(), covariance, bins) for side in np.diag(1e-3 * errors)]
            for sign in (1.0, -1.0)
        ]
        further, nearer = np.array(ends, np.float64)  # NaN where a number is undetermined
        slopes = (further - nearer).T.copy() / np.where(errors > 0.0, 2.0 * (1e-3 * errors), np.nan)
        middle = recover(self.linear_parameters, covariance, bins)._asdict().items()
        return known | {
            name: None if value is None else error_along(slope, covariance)
            for (name, value), slope in zip(middle, slopes, strict=True)
        }

    def _covariance(self) -> Array | None:
        """Covariance of theta in metres by the residuals; only an indication where forgetting or perturbation act."""
        variance, covariance = float(residual_variance(*self._state.numbers[14:])), self.unscaled_covariance
        if not variance * float(np.trace(covariance)) < LARGEST_TRACE:  # nor where the variance is not known: NaN
            return None
        return self._to_metres @ (variance * covariance) @ self._to_metres.T
