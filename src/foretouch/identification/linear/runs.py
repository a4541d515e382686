"""What linear estimators give of whole recordings, and what they take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import SettingError
from foretouch.identification.estimator import Status
from foretouch.identification.linear.lanes import (
    COUNTS,
    RESULT_SIZE,
    regressors_parallel,
    regressors_serial,
    run_parallel,
    run_serial,
)
from foretouch.identification.linear.options import RESIDUALS, full_covariance
from foretouch.quantities import ByValue

Array = NDArray[np.float64]
Samples = tuple[Array, Array, Array, NDArray[np.bool_]]

STATUSES = (Status.LEARNT, Status.FREE_AIR, Status.UNUSABLE, Status.GATED, Status.RESTARTED, Status.LEARNT)
"""By what the kernel answers; the last is a sample that also tripped the self-perturbing test."""


@dataclass(frozen=True, eq=False, slots=True)
class LinearRun(ByValue):
    """What a linear estimator made of one recording of m samples.

    Attributes:
        theta: (ln k, s, b1, b2) after the last sample, depth in metres, shape (4,).
        codes: What was done with each sample, an index into `STATUSES`, shape (m,); 5 is learnt and perturbed.
        every: Theta after each sample, shape (m, 4), None where it was not asked for.
        updates: Samples learnt from since the estimator last began.
    """

    theta: Array
    codes: NDArray[np.int8]
    every: Array | None
    updates: int

    def count(self, status: Status) -> int:
        """How many samples had this status."""
        return sum(int(np.count_nonzero(self.codes == code)) for code, one in enumerate(STATUSES) if one is status)

    @property
    def perturbations(self) -> int:
        """How often the self-perturbing test tripped."""
        return int(np.count_nonzero(self.codes == len(STATUSES) - 1))


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


def as_arrays(dimensions: int, **arrays: ArrayLike) -> list[Array]:
    """The arrays as the compiled loops take them, all of the shape of the first.

    Raises:
        SettingError: One has another shape than the first, or that not so many dimensions.
    """
    numbers = {name: np.ascontiguousarray(values, np.float64) for name, values in arrays.items()}
    first = next(iter(numbers))
    shape = np.shape(arrays[first])
    if len(shape) != dimensions:
        raise SettingError(f"shape of {first}", shape, f"must be {('(m,)', '(m, n)')[dimensions - 1]}")
    for name, values in numbers.items():
        if values.shape != shape:
            raise SettingError(f"shape of {name}", values.shape, f"must be that of {first}, {shape}")
    return list(numbers.values())


def as_recording(
    dimensions: int, depth: ArrayLike, velocity: ArrayLike, force: ArrayLike, in_contact: ArrayLike | None
) -> Samples:
    """Samples as the compiled loops take them.

    Raises:
        SettingError: One of the arrays has another shape than the depth, or the depth not so many dimensions.
    """
    x, v, f = as_arrays(dimensions, depth=depth, velocity=velocity, force=force)
    touching = np.ones(x.shape, np.bool_) if in_contact is None else np.ascontiguousarray(in_contact, np.bool_)
    if touching.shape != x.shape:
        raise SettingError("shape of in_contact", touching.shape, f"must be that of depth, {x.shape}")
    return x, v, f, touching


def run_columns(
    samples: Samples, packed: Array, scales: tuple[float, float], *, every: bool, parallel: bool
) -> LinearRuns:
    """Each column from the beginning with the same packed options; see `LinearisedEstimator.run_many`."""
    rows, columns = samples[0].shape
    result = np.empty((RESULT_SIZE, columns))
    trace = np.empty((rows if every else 0, 4, columns))
    (run_parallel if parallel else run_serial)(*samples, packed, result, trace)
    return _runs(result, scales, np.moveaxis(trace, 1, 2) if every else None)


def run_regressors(arrays: list[Array], packed: Array, scales: tuple[float, float], *, parallel: bool) -> LinearRuns:
    """The same of ln x, v, v / x, ln F and mu, shape (m, n) each; see `LinearisedEstimator.run_regressors`."""
    log_depth, velocity, rate, log_force, memory = arrays
    result = np.empty((RESULT_SIZE, memory.shape[1]))
    recur = regressors_parallel if parallel else regressors_serial
    recur(log_depth, velocity, rate, log_force, memory, packed, result)
    return _runs(result, scales, None)


def _runs(result: Array, scales: tuple[float, float], every: Array | None) -> LinearRuns:
    updates, restarts, perturbations = result[COUNTS:].astype(np.int64)
    return LinearRuns(
        to_metres(result[:4].T, *scales),
        np.moveaxis(full_covariance(result[4:RESIDUALS]), 2, 0),
        residual_variance(result[RESIDUALS], result[RESIDUALS + 1]),
        updates,
        restarts,
        perturbations,
        None if every is None else to_metres(every, *scales),
    )
