"""Offline least squares on the exact law (4): the reference that all recursive estimators are measured against."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import InputError, UnknownNameError, plural
from foretouch.identification.conditioning.conditioner import ContactSample, ContactSamples, require_columns
from foretouch.identification.estimator import LARGEST_BUFFER, Status, StoringEstimator
from foretouch.identification.exact.law import EXACT_LAWS, REFERENCE_TIME, ExactLaw
from foretouch.models import ContactModel
from foretouch.quantities import ByValue

Array = NDArray[np.float64]

FEWEST_SAMPLES = 20  # Least number of samples of a fit

STARTS = 3  # Number of local searches, from the best points of a grid over s and alpha
GRID_SAMPLES = 400  # Number of samples, spread evenly, that choose the starts, about
HEIGHTS = (0.0, 0.3, 0.8)  # Of the surface above its guess, which is too deep, from which it is looked for [RMS depth]
REACHES = (0.125, 0.25, 0.5, 1.0)  # Depths down to which the foot of a press is fitted, in the deepest
STEP = 0.02  # Height over which the slope of the force is taken [RMS depth]: at n < 1 it is infinite, at n = 0 a jump
UNIFORM_INFORMATION = 12.0  # Inverse variance of an exponent before any data, which is uniform over a range of length 1


@dataclass(frozen=True, eq=False)
class OfflineFit(ByValue):
    """A law fitted to whole arrays.

    Attributes:
        model: The law with its numbers.
        standard_errors: Of the law's parameters by name, from the Jacobian; see `fit_offline`.
        standard_errors_with_surface: The same, with the uncertainty of surface and offset.
        residual: Force less that of the law [N], shape (n,).
        residual_rms: RMS of the residual [N].
        force_rms: RMS of the forces fitted [N].
    """

    model: ContactModel
    standard_errors: dict[str, float]
    standard_errors_with_surface: dict[str, float]
    residual: Array
    residual_rms: float
    force_rms: float


def fit_offline(
    depth: ArrayLike,
    velocity: ArrayLike,
    force: ArrayLike,
    law: str = "continuous-switching",
    *,
    covariance: Array | None = None,
) -> OfflineFit:
    r"""Least squares on the exact law, all samples at once and within the bounds of equation (5).

    .. math:: \min \sum_i \left(F_i - \max(0,\; k x_i^{n+\alpha} + \lambda x_i^n \dot x_i)\right)^2

    For given s and alpha the law is linear in its two strengths; a grid over s and alpha, each with its best strengths,
    gives the starts of three local searches over all unknowns (SciPy, trust region within bounds), and the best wins.
    It is fitted to the whole file at once: a lower bound on the error of estimators, not one of them.

    Standard errors are of the delta method from the Jacobian at the solution, residual variance times the inverse of
    the information, to which a uniform distribution of s and alpha over their ranges is added, so that an exponent that
    the data do not determine shows the spread of its range instead of infinity. Correlated residuals count as fewer: by
    (1 + r) / (1 - r), r the correlation of successive ones. Where surface and offset have a covariance S, that of the
    law is C + G S G', G = -C J' K / variance the shift of the law with both and K the Jacobian by them.

    Args:
        depth: Depths [m]; samples outside the surface are not fitted and have the residual of no force, shape (n,).
        velocity: Velocities [m/s], shape (n,).
        force: Forces less the offset [N], shape (n,).
        law: continuous-switching, kelvin-voigt or hunt-crossley.
        covariance: Of the position of the surface [m] and the offset of the force [N], shape (2, 2); None if both are
            exact.

    Raises:
        UnknownNameError: No such law.
        InputError: Arrays of unlike length or not finite, fewer than 20 samples inside the surface, or no force there.
    """
    if law not in EXACT_LAWS:
        raise UnknownNameError("exact law", law, EXACT_LAWS)
    x, v, f = (np.asarray(values, dtype=np.float64) for values in (depth, velocity, force))
    require_columns("depth, velocity, force", x, v, f)
    if not all(np.isfinite(values).all() for values in (x, v, f)):
        raise InputError("depth, velocity and force must be finite: leave the other samples out")
    inside = x > 0.0
    if inside.sum() < FEWEST_SAMPLES or not f[inside].max() > 0.0:
        there = plural(int(inside.sum()), "sample")
        raise InputError(f"{there} inside the surface: at least {FEWEST_SAMPLES}, with force, are needed")
    return _Problem(EXACT_LAWS[law], x[inside], v[inside], f[inside]).fit(inside, f, covariance)


class Foot(NamedTuple):
    """Position of the surface [m], force in free air [N], covariance of both, shape (2, 2); 0 of what was given."""

    surface: float
    offset: float
    covariance: Array


def find_foot(
    position: Array, velocity: Array, force: Array, guess: tuple[float, float], given: tuple[bool, bool]
) -> Foot | None:
    r"""Surface z_0 and offset F_0 by least squares on the foot of the presses, with the law (4) and free air.

    .. math:: F = F_0 + \max(0,\; k (z - z_0)^{n+\alpha} + \lambda (z - z_0)^n \dot z)

    The law needs to hold near the surface only. It is fitted down to an eighth, a quarter, a half and all of the
    deepest place. A fit counts whose surface, less two standard errors, has free air beyond, and is at most half the
    depth further out than contact was noticed, and a sample deeper; the deepest counts that agrees with all before,
    within three standard errors as if independent (the choice of a bandwidth by Lepskii). Samples are chosen by
    position: the noisy force would move the surface. Standard errors are those of `fit_offline`, or what sums over
    single presses say where that is more (Liang and Zeger): a surface may differ from press to press.

    Args:
        position: Positions z [m], shape (n,).
        velocity: Velocities that do not lag behind the positions [m/s], shape (n,).
        force: Forces F, offset included [N], shape (n,).
        guess: Where contact was noticed [m], and offset [N] to begin with.
        given: Whether each of them is right and stays; not both.

    Returns:
        None where no fit counts, or fewer than 20 samples are inside the surface or outside.

    References:
        Lepskii (1991), Theory of Probability and its Applications 35(3); Liang and Zeger (1986), Biometrika 73(1).
    """
    depth, row, feet = position - guess[0], int(given[0]), list[Foot]()
    step = float(np.abs(np.diff(depth)).max())
    for reach in REACHES:
        chosen = np.flatnonzero((depth <= reach * depth.max()) & (depth >= -depth.max()))
        chosen = chosen[:: 1 + chosen.size // LARGEST_BUFFER]
        if not FEWEST_SAMPLES <= np.count_nonzero(depth[chosen] > 0.0) <= chosen.size - FEWEST_SAMPLES:
            continue
        samples = depth[chosen], velocity[chosen], force[chosen] - guess[1]
        foot = _Problem(EXACT_LAWS["continuous-switching"], *samples, given).foot()
        end = max(depth[chosen].min(), -0.5 * depth.max())
        if foot is None or not end < foot.surface - 2.0 * math.sqrt(foot.covariance[0, 0]) <= step:
            continue
        if any((foot[row] - one[row]) ** 2 > 9.0 * (foot.covariance + one.covariance)[row, row] for one in feet):
            break
        feet.append(foot)
    if not feet:
        return None
    surface, offset, covariance = feet[-1]
    return Foot(guess[0] + surface, guess[1] + offset, covariance)


class _Problem:
    """One fit: F0, D, s and alpha of `ExactLaw`, the height zeta of the true surface above the given one, the offset.

    Forces are relative to the RMS force, lengths to the RMS depth.
    """

    def __init__(
        self, law: ExactLaw, depth: Array, velocity: Array, force: Array, given: tuple[bool, bool] = (True, True)
    ) -> None:
        self.law = law
        self.reference = _rms(depth[depth > 0.0])
        self.scale = _rms(force) or 1.0
        self.depth = depth / self.reference
        self.speed = velocity * (REFERENCE_TIME / self.reference)
        self.force = force / self.scale
        limits = (-self.depth.max(), -self.depth.min()), (-np.inf, np.inf)
        places = [(0.0, 0.0) if known else bounds for known, bounds in zip(given, limits, strict=True)]
        bounds = np.array([(1e-9, np.inf), (0.0, np.inf), law.s_bounds, law.alpha_bounds, *places])
        self.lower, self.upper = bounds.T
        self.free = np.flatnonzero(self.lower < self.upper)

    def fit(self, inside: NDArray[np.bool_], all_force: Array, covariance: Array | None) -> OfflineFit:
        """The law, from the surface and the offset that are given, with their covariance."""
        unknowns = self._search(STARTS)
        elastic, viscous, s, alpha, _, _ = unknowns.tolist()
        family = (elastic * self.scale, viscous * self.scale, s, alpha, self.reference)
        own = self.residual(unknowns)
        residual = all_force.copy()
        residual[inside] = -own * self.scale
        sensitivities = np.array(self.law.sensitivities(*family)) @ np.diag([self.scale, self.scale, 1.0, 1.0])
        own_covariance, gain = self._covariance(unknowns, own)
        shifts = gain @ self.jacobian(unknowns)[:, 4:] @ np.diag([-1.0 / self.reference, 1.0 / self.scale])
        moved = own_covariance if covariance is None else own_covariance + shifts @ covariance @ shifts.T
        rows = sensitivities[:, self.free]
        alone, both = (
            dict(zip(self.law.parameter_names, np.sqrt(np.abs(np.diag(rows @ matrix @ rows.T))).tolist(), strict=True))
            for matrix in (own_covariance, moved)
        )
        return OfflineFit(self.law.model(*family), alone, both, residual, _rms(residual), _rms(all_force))

    def foot(self) -> Foot | None:
        """Surface and offset, counted from those that were given; None with fewer than 20 samples inside or outside."""
        unknowns = self._search(1)
        inside = self.depth + unknowns[4] > 0.0
        if not FEWEST_SAMPLES <= np.count_nonzero(inside) <= inside.size - FEWEST_SAMPLES:
            return None
        residual = self.residual(unknowns)
        covariance, gain = self._covariance(unknowns, residual)
        presses = np.append(0, 1 + np.flatnonzero(np.diff(inside.astype(np.int8)) > 0))
        sums = np.add.reduceat(gain * residual, presses, axis=1)
        row = int((self.free < 4).sum())  # of the surface, or of the offset where that alone is unknown
        ratio = float(sums[row] @ sums[row]) * presses.size / max(1, presses.size - 1) / covariance[row, row]
        whole, scaling = np.zeros((6, 6)), np.diag([-self.reference, self.scale])
        whole[np.ix_(self.free, self.free)] = covariance * max(1.0, ratio)
        surface, offset = (scaling @ unknowns[4:]).tolist()
        return Foot(surface, offset, scaling @ whole[4:, 4:] @ scaling)

    def _search(self, starts: int) -> Array:
        from scipy.optimize import least_squares

        lower, upper = self.lower[self.free], self.upper[self.free]
        best, cost = lower, math.inf
        for _, start in sorted(self._grid(), key=lambda pair: pair[0])[:starts]:
            result = least_squares(
                self._free_residual,
                np.clip(start[self.free], lower, upper),
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
        """Cost and unknowns at grid points of s, alpha and zeta, each with its best strengths and offset."""
        points = []
        some = slice(None, None, max(1, self.force.size // GRID_SAMPLES))
        depth, speed, force = self.depth[some], self.speed[some], self.force[some]
        steps = zip(self.lower[2:5], self.upper[2:5], (6, 4, 1), strict=True)
        s_grid, alpha_grid, _ = (np.unique(np.linspace(*step)) for step in steps)
        zetas = HEIGHTS if self.lower[4] < self.upper[4] else HEIGHTS[:1]
        for s, alpha, zeta in itertools.product(s_grid, alpha_grid, zetas):
            unknowns = np.array([1.0, 0.0, s, alpha, zeta, 0.0])
            _, elastic, viscous = _terms(depth, speed, unknowns)
            columns = (elastic, viscous, np.ones_like(elastic))[: 2 + (self.lower[5] < self.upper[5])]
            best, *_ = np.linalg.lstsq(np.column_stack(columns), force, rcond=None)
            if best[:2].min() > 0.0:
                unknowns[[0, 1, 5][: len(best)]] = best
            else:
                unknowns[0] = max(1e-6, float(elastic @ force / (elastic @ elastic)))
                unknowns[1] = 1e-3 * unknowns[0]
            error = unknowns[0] * elastic + unknowns[1] * viscous + unknowns[5] - force
            points.append((float(error @ error), unknowns))
        return points

    def _whole(self, free: Array) -> Array:
        unknowns = np.array(self.lower)
        unknowns[self.free] = free
        return unknowns

    def _free_residual(self, free: Array) -> Array:
        return self.residual(self._whole(free))

    def _free_jacobian(self, free: Array) -> Array:
        return np.asarray(self.jacobian(self._whole(free))[:, self.free])

    def residual(self, unknowns: Array) -> Array:
        """Force of the law and the offset less the measured force, relative to the RMS force."""
        _, elastic, viscous = _terms(self.depth, self.speed, unknowns)
        law = unknowns[0] * elastic + unknowns[1] * viscous
        return np.asarray(np.maximum(law, 0.0) + (unknowns[5] - self.force))

    def jacobian(self, unknowns: Array) -> Array:
        """Jacobian of the residual by the unknowns; of the law, zero where it gives no force."""
        depth, per_elastic, per_viscous = _terms(self.depth, self.speed, unknowns)
        viscous, log_depth = unknowns[1] * per_viscous, np.log(depth)
        law = unknowns[0] * per_elastic + viscous
        columns = np.column_stack((per_elastic, per_viscous, law * log_depth, -viscous * log_depth))
        step = np.array([0.0, 0.0, 0.0, 0.0, STEP, 0.0])
        slope = (self.residual(unknowns + step) - self.residual(unknowns - step)) / (2.0 * STEP)
        return np.column_stack((np.where(law[:, None] > 0.0, columns, 0.0), slope, np.ones_like(law)))

    def _covariance(self, unknowns: Array, residual: Array) -> tuple[Array, Array]:
        """Covariance of the free unknowns, and their gain: what they change by for a unit more of each residual."""
        jacobian = self.jacobian(unknowns)[:, self.free]
        variance = float(residual @ residual) / max(1, residual.size - len(self.free))
        likeness = likeness_of(residual)
        variance = max(variance * (1.0 + likeness) / (1.0 - likeness), 1e-24)
        ranges = (self.upper - self.lower)[self.free]
        known = np.diag(UNIFORM_INFORMATION / np.square(ranges))  # none of strengths and offset, which have no range
        covariance = np.asarray(np.linalg.pinv(jacobian.T @ jacobian / variance + known, hermitian=True))
        return covariance, -covariance @ jacobian.T / variance


def _terms(depth: Array, speed: Array, unknowns: Array) -> tuple[Array, Array, Array]:
    """Depth below the true surface, 1 outside, and the forces per F0 and per D, 0 outside."""
    _, _, s, alpha, zeta, _ = unknowns
    inside = depth + zeta > 0.0
    deep = np.where(inside, depth + zeta, 1.0)
    log_depth = np.log(deep)
    return deep, np.exp(s * log_depth) * inside, np.exp((s - alpha) * log_depth) * inside * speed


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def likeness_of(residual: Array) -> float:
    """Correlation of successive residuals, 0 to 0.999."""
    likeness = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300)
    return min(max(likeness, 0.0), 0.999)


class _Offline(StoringEstimator):
    """`fit_offline` of the samples in contact. Each model is causal, but a fit takes milliseconds.

    This is the reference for recordings, not an estimator for a control loop.
    """

    name: ClassVar[str] = "offline"
    refit_share: ClassVar[float] = 0.1  # a fit takes milliseconds

    def reset(self) -> None:
        """Forget all samples."""
        super().reset()
        self._fit: OfflineFit | None = None
        self._covariance: Array | None = None

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
                self._fit = fit_offline(depth, velocity, force, self.model_name, covariance=self._covariance)
            except InputError:  # a parameter out of range, or no force: no usable fit
                self._fit = None
        return self._fit

    def refit(self, samples: ContactSamples, covariance: Array) -> bool:
        """See `Estimator.refit`: one `fit_offline` of as many samples as the buffer holds."""
        inside = np.flatnonzero(samples.depth > 0.0)
        columns = np.column_stack((samples.depth, samples.velocity, samples.force))
        self._rows, self._covariance = columns[inside[:: 1 + inside.size // LARGEST_BUFFER]].tolist(), covariance
        self.finish()
        return True

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

    @property
    def standard_errors_with_surface(self) -> dict[str, float | None] | None:
        """See `Estimator.standard_errors_with_surface`; known after `refit`."""
        fit = self.fit
        return None if fit is None or self._covariance is None else {**fit.standard_errors_with_surface}


class OfflineContinuousSwitching(_Offline):
    """Equation (4) by offline least squares within the bounds of (5)."""

    model_name: ClassVar[str] = "continuous-switching"


class OfflineKelvinVoigt(_Offline):
    """Equation (1) by offline least squares."""

    model_name: ClassVar[str] = "kelvin-voigt"


class OfflineHuntCrossley(_Offline):
    """Equation (2) by offline least squares, exponent from 1 to 2."""

    model_name: ClassVar[str] = "hunt-crossley"
