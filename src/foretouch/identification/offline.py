"""Offline least squares on the exact law (4): the reference that all recursive estimators are measured against."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import InputError, UnknownNameError, plural
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.exact.law import EXACT_LAWS, REFERENCE_TIME, ExactLaw
from foretouch.models import ContactModel
from foretouch.quantities import ByValue

Array = NDArray[np.float64]

FEWEST_SAMPLES = 20  # Least number of samples of a fit

LARGEST_BUFFER = 4096
"""Largest number of samples that the estimator holds; when it is reached, every second one is dropped and only every
second one of those to come is taken, so that the buffer always covers the whole recording evenly."""

STARTS = 3  # Number of local searches, from the best points of a grid over s and alpha
GRID_SAMPLES = 400  # Number of samples, spread evenly, that choose the starts, about
UNIFORM_INFORMATION = 12.0  # Inverse variance of an exponent before any data, which is uniform over a range of length 1


@dataclass(frozen=True, eq=False)
class OfflineFit(ByValue):
    """A law fitted to whole arrays.

    Attributes:
        model: The law with its numbers.
        standard_errors: Of the law's parameters by name, from the Jacobian; see `fit_offline`.
        residual: Force less that of the law [N], shape (n,).
        residual_rms: RMS of the residual [N].
        force_rms: RMS of the forces fitted [N].
    """

    model: ContactModel
    standard_errors: dict[str, float]
    residual: Array
    residual_rms: float
    force_rms: float


def fit_offline(
    depth: ArrayLike, velocity: ArrayLike, force: ArrayLike, law: str = "continuous-switching"
) -> OfflineFit:
    r"""Least squares on the exact law, all samples at once and within the bounds of equation (5).

    .. math:: \min \sum_i \left(F_i - \max(0,\; k x_i^{n+\alpha} + \lambda x_i^n \dot x_i)\right)^2

    For given s and alpha the law is linear in its two strengths; a grid over s and alpha, each with its best strengths,
    gives the starts of three local searches over all unknowns (SciPy, trust region within bounds), and the best wins.
    It is fitted to the whole file at once: a lower bound on the error of estimators, not one of them.

    Standard errors are of the delta method from the Jacobian at the solution, residual variance times the inverse of
    the information, to which a uniform distribution of s and alpha over their ranges is added, so that an exponent that
    the data do not determine shows the spread of its range instead of infinity. Correlated residuals count as fewer: by
    (1 + r) / (1 - r), r the correlation of successive ones.

    Args:
        depth: Depths [m]; samples outside the surface are not fitted and have the residual of no force, shape (n,).
        velocity: Velocities [m/s], shape (n,).
        force: Forces less the offset [N], shape (n,).
        law: continuous-switching, kelvin-voigt or hunt-crossley.

    Raises:
        UnknownNameError: No such law.
        InputError: Arrays of unlike length or not finite, fewer than 20 samples inside the surface, or no force there.
    """
    if law not in EXACT_LAWS:
        raise UnknownNameError("exact law", law, EXACT_LAWS)
    family = EXACT_LAWS[law]
    x, v, f = (np.asarray(values, dtype=np.float64) for values in (depth, velocity, force))
    if x.ndim != 1 or not x.shape == v.shape == f.shape:
        raise InputError(f"depth, velocity and force have shapes {x.shape}, {v.shape}, {f.shape}: give equal lengths")
    if not all(np.isfinite(values).all() for values in (x, v, f)):
        raise InputError("depth, velocity and force must be finite: leave the other samples out")
    inside = x > 0.0
    if inside.sum() < FEWEST_SAMPLES or not f[inside].max() > 0.0:
        there = plural(int(inside.sum()), "sample")
        raise InputError(f"{there} inside the surface: at least {FEWEST_SAMPLES}, with force, are needed")
    return _Problem(family, x[inside], v[inside], f[inside]).fit(inside, f)


class _Problem:
    """One fit, in the unknowns F0, D, s, alpha of `ExactLaw`, both strengths relative to the RMS force."""

    def __init__(self, law: ExactLaw, depth: Array, velocity: Array, force: Array) -> None:
        self.law = law
        self.reference = float(np.sqrt(np.mean(np.square(depth))))
        self.scale = float(np.sqrt(np.mean(np.square(force))))
        self.log_depth = np.log(depth / self.reference)
        self.speed = velocity * (REFERENCE_TIME / self.reference)
        self.force = force / self.scale
        self.free = [0, 1]
        self.lower, self.upper = np.array([1e-9, 0.0, 0.0, 0.0]), np.array([np.inf, np.inf, 0.0, 0.0])
        for index, bounds in ((2, law.s_bounds), (3, law.alpha_bounds)):
            self.lower[index], self.upper[index] = bounds
            if bounds[0] < bounds[1]:
                self.free.append(index)

    def fit(self, inside: NDArray[np.bool_], all_force: Array) -> OfflineFit:
        unknowns = self._search()
        elastic, viscous, s, alpha = unknowns.tolist()
        family = (elastic * self.scale, viscous * self.scale, s, alpha, self.reference)
        own = self.residual(unknowns)
        residual = all_force.copy()
        residual[inside] = -own * self.scale
        scaling = np.diag([self.scale, self.scale, 1.0, 1.0])[:, self.free]
        sensitivities = np.array(self.law.sensitivities(*family)) @ scaling
        variances = np.diag(sensitivities @ self._covariance(unknowns, own) @ sensitivities.T)
        return OfflineFit(
            self.law.model(*family),
            dict(zip(self.law.parameter_names, np.sqrt(np.maximum(variances, 0.0)).tolist(), strict=True)),
            residual,
            float(np.sqrt(np.mean(np.square(residual)))),
            float(np.sqrt(np.mean(np.square(all_force)))),
        )

    def _search(self) -> Array:
        from scipy.optimize import least_squares

        lower, upper = self.lower[self.free], self.upper[self.free]
        best, cost = lower, math.inf
        for start in sorted(self._grid(), key=lambda pair: pair[0])[:STARTS]:
            result = least_squares(
                self._free_residual,
                np.clip(start[1][self.free], lower, upper),
                jac=self._free_jacobian,
                bounds=(lower, upper),
                xtol=1e-10,
                ftol=1e-10,
                gtol=1e-10,
                max_nfev=100,
            )
            if result.cost < cost:
                best, cost = result.x, result.cost
            if len(self.free) == 2:
                break  # linear: one start finds it
        return self._whole(best)

    def _grid(self) -> list[tuple[float, Array]]:
        """Cost and unknowns at grid points of s and alpha, each with its best strengths."""
        points = []
        some = slice(None, None, max(1, self.force.size // GRID_SAMPLES))
        log_depth, speed, force = self.log_depth[some], self.speed[some], self.force[some]
        for s in np.unique(np.linspace(self.lower[2], self.upper[2], 6)):
            for alpha in np.unique(np.linspace(self.lower[3], self.upper[3], 4)):
                unknowns = np.array([1.0, 0.0, s, alpha])
                elastic = np.exp(s * log_depth)
                viscous = np.exp((s - alpha) * log_depth) * speed
                both, *_ = np.linalg.lstsq(np.column_stack((elastic, viscous)), force, rcond=None)
                if both.min() > 0.0:
                    unknowns[:2] = both
                else:
                    unknowns[0] = max(1e-6, float(elastic @ force / (elastic @ elastic)))
                    unknowns[1] = 1e-3 * unknowns[0]
                error = unknowns[0] * elastic + unknowns[1] * viscous - force
                points.append((float(error @ error), unknowns))
        return points

    def _whole(self, free: Array) -> Array:
        unknowns = self.lower.copy()
        unknowns[self.free] = free
        return unknowns

    def _free_residual(self, free: Array) -> Array:
        return self.residual(self._whole(free))

    def _free_jacobian(self, free: Array) -> Array:
        return self.jacobian(self._whole(free))[:, self.free]

    def residual(self, unknowns: Array) -> Array:
        """Force of the law less the measured one, relative to the RMS force."""
        elastic, viscous, s, alpha = unknowns
        law = elastic * np.exp(s * self.log_depth) + viscous * np.exp((s - alpha) * self.log_depth) * self.speed
        return np.asarray(np.maximum(law, 0.0) - self.force)

    def jacobian(self, unknowns: Array) -> Array:
        """Jacobian of the residual by F0, D, s, alpha; zero where the law gives no force."""
        elastic, viscous, s, alpha = unknowns
        per_elastic = np.exp(s * self.log_depth)
        per_viscous = np.exp((s - alpha) * self.log_depth) * self.speed
        law = elastic * per_elastic + viscous * per_viscous
        columns = (per_elastic, per_viscous, law * self.log_depth, -viscous * per_viscous * self.log_depth)
        return np.where(law[:, None] > 0.0, np.column_stack(columns), 0.0)

    def _covariance(self, unknowns: Array, residual: Array) -> Array:
        """Covariance of the free unknowns."""
        jacobian = self.jacobian(unknowns)[:, self.free]
        variance = float(residual @ residual) / max(1, residual.size - len(self.free))
        likeness = likeness_of(residual)
        variance = max(variance * (1.0 + likeness) / (1.0 - likeness), 1e-24)
        known = np.array([0.0, 0.0, UNIFORM_INFORMATION, UNIFORM_INFORMATION])[self.free]
        return np.asarray(np.linalg.pinv(jacobian.T @ jacobian / variance + np.diag(known), hermitian=True))


def likeness_of(residual: Array) -> float:
    """Correlation of successive residuals, 0 to 0.999."""
    likeness = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300)
    return min(max(likeness, 0.0), 0.999)


class StoringEstimator(Estimator):
    """Stores samples in a buffer that covers all of them evenly, and fits them when asked, not at every sample."""

    offline: ClassVar[bool] = True
    refit_share: ClassVar[float]
    """Fraction of new samples after which the estimator fits again."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self.updates = 0
        self._stride = 1
        self._rows: list[tuple[float, ...]] = []
        self._next_fit = FEWEST_SAMPLES

    def _store(self, row: tuple[float, ...]) -> None:
        if self.updates % self._stride == 0:
            self._rows.append(row)
            if len(self._rows) >= LARGEST_BUFFER:
                self._rows = self._rows[::2]
                self._stride *= 2
        self.updates += 1

    def finish(self) -> None:
        """Fit to the newest samples too."""
        if self.updates >= FEWEST_SAMPLES:
            self._next_fit = self.updates

    def _is_fit_due(self) -> bool:
        """Whether to fit now; the caller does."""
        due = self.updates >= self._next_fit
        if due:
            self._next_fit = self.updates + max(1, round(self.refit_share * self.updates))
        return due


class _Offline(StoringEstimator):
    """Stores samples and fits them when asked: see `fit_offline`.

    Samples in contact go into a buffer of at most 4,096 that covers all of them evenly; `model` fits when 10 % of new
    samples have come since the last fit. Each model is causal, but a fit takes milliseconds: this is the reference for
    recordings, not an estimator for a control loop.
    """

    name: ClassVar[str] = "offline"
    refit_share: ClassVar[float] = 0.1  # a fit takes milliseconds

    def reset(self) -> None:
        """Forget all samples."""
        super().reset()
        self._fit: OfflineFit | None = None

    def update(self, sample: ContactSample) -> Status:
        """Store one sample; see `Estimator.update`."""
        if not sample.in_contact:
            return Status.FREE_AIR
        _, depth, velocity, force, _ = sample
        if not (1e-9 < depth < 1e6 and abs(velocity) < 1e6 and abs(force) < 1e9):
            return Status.UNUSABLE
        self._store((depth, velocity, force))
        return Status.LEARNT

    @property
    def fit(self) -> OfflineFit | None:
        """The newest fit, None before 20 samples or while none is possible."""
        if self._is_fit_due():
            try:
                depth, velocity, force = np.array(self._rows).T
                self._fit = fit_offline(depth, velocity, force, self.model_name)
            except InputError:  # a parameter out of range, or no force: no usable fit
                self._fit = None
        return self._fit

    @property
    def model(self) -> ContactModel | None:
        """The fitted law."""
        fit = self.fit
        return None if fit is None else fit.model

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Standard errors of the newest fit."""
        fit = self.fit
        return None if fit is None else {**fit.standard_errors}

    def surface_shifts(self, surface_error: float) -> dict[str, float] | None:
        """Shifts by two more fits; see `Estimator.surface_shifts`."""
        fit = self.fit
        if fit is None:
            return None
        depth, velocity, force = np.array(self._rows).T
        try:
            moved = [
                fit_offline(depth + shift, velocity, force, self.model_name).model.parameters
                for shift in (-surface_error, surface_error)
            ]
        except InputError:  # too few samples are left inside the surface
            return None
        shifts = np.abs(np.subtract(moved, fit.model.parameters)).max(axis=0)
        return dict(zip(fit.standard_errors, shifts.tolist(), strict=True))


class OfflineContinuousSwitching(_Offline):
    """Equation (4) by offline least squares within the bounds of (5)."""

    model_name: ClassVar[str] = "continuous-switching"


class OfflineKelvinVoigt(_Offline):
    """Equation (1) by offline least squares."""

    model_name: ClassVar[str] = "kelvin-voigt"


class OfflineHuntCrossley(_Offline):
    """Equation (2) by offline least squares, exponent from 1 to 2."""

    model_name: ClassVar[str] = "hunt-crossley"
