"""The contact map fitted to a whole recording at once: the lowest error that the map can reach."""

from __future__ import annotations

import math
from functools import cache
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.contact_map.learning import PERIOD
from foretouch.identification.contact_map.prior import prior
from foretouch.identification.contact_map.scores import trust
from foretouch.identification.estimator import Status, StoringEstimator
from foretouch.identification.offline import OfflineFit, fit_offline
from foretouch.models import ContactMapModel, ContactModel, ContactState
from foretouch.models.contact_map.kernel import experts, features, locate, remember
from foretouch.models.contact_map.layout import GRIDS, LARGEST_FEATURES, LARGEST_FORCE, MEMORY, Grid, Map

Array = NDArray[np.float64]

UNKNOWN = Map.new()[0]  # a map that does not pull: what is remembered of a motion depends on nothing else of a map


class _Samples(NamedTuple):
    """Measured samples, one row for each 4 ms; columns of shape (n,), features of shape (n, f)."""

    place: Array
    velocity: Array
    force: Array
    in_contact: NDArray[np.bool_]
    features: Array


class OfflineContactMap(StoringEstimator):
    r"""The experts of a `foretouch.models.ContactMapModel`, each by least squares over all samples at once.

    For each map, with the prior covariance P and the noise that `ContactMap` learns with,

    .. math:: \min_w\; \sum_i (F_i - h_i^T w)^2 / \sigma^2 + w^T P^{-1} w

    over one sample in 4 ms from the first touch on, in contact and out of it; the law (4) by `fit_offline`. The weights
    are those of the bank, :math:`\pi_i \propto e_i^{-8}`, from the RMS residuals e_i in contact instead of late
    predictions, and the standard deviation is that of the residuals.

    It is evaluated on the samples it was fitted to: a lower bound on the error of these experts, not an estimator for a
    control loop.

    References:
        Wahba (1990), Spline Models for Observational Data.
    """

    name: ClassVar[str] = "offline"
    model_name: ClassVar[str] = "contact-map"
    refit_share: ClassVar[float] = 0.25  # a fit takes a tenth of a second

    def reset(self) -> None:
        """Forget all samples."""
        super().reset()
        self._origin = self._zero = 0.0
        self._memory = np.full(MEMORY, math.nan)
        self._time = self._learnt_at = math.nan
        self._touched = False
        self._model: ContactMapModel | None = None
        self._law: OfflineFit | None = None

    def update(self, sample: ContactSample) -> Status:
        """Store one sample; see `Estimator.update`."""
        time, depth, velocity, force, in_contact = sample
        if not (math.isfinite(depth) and math.isfinite(velocity) and abs(force) < LARGEST_FORCE):
            return Status.FREE_AIR if math.isnan(depth) else Status.UNUSABLE
        if not time > self._time and not math.isnan(self._time):
            return Status.UNUSABLE
        position = depth - self._origin
        remember(UNKNOWN, self._memory, position, 0.0 if math.isnan(self._time) else time - self._time)
        self._time = time
        self._touched = self._touched or in_contact
        if not self._touched:
            return Status.FREE_AIR
        if time - self._learnt_at < PERIOD - 1e-7:
            return Status.GATED
        self._learnt_at = time
        values = np.empty(LARGEST_FEATURES)
        features(self._memory, position, velocity, values)
        self._store((position, velocity, force + self._zero, float(in_contact), *values.tolist()))
        return Status.LEARNT if in_contact else Status.FREE_AIR

    def move_surface(self, change: float) -> None:
        """See `Estimator.move_surface`: the map stays where it is."""
        if math.isfinite(change):
            self._origin -= change

    def move_offset(self, change: float) -> None:
        """See `Estimator.move_offset`: the map keeps the raw forces."""
        if math.isfinite(change):
            self._zero += change

    @property
    def state(self) -> ContactState:
        """See `Estimator.state`."""
        return tuple(self._memory.tolist())

    @property
    def model(self) -> ContactModel | None:
        """The fitted map, None before 20 samples or without contact among them."""
        if self._is_fit_due():
            self._model = self._fit()
        return self._model

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Standard errors of the law's parameters."""
        return None if self._law is None else {**self._law.standard_errors}

    def _fit(self) -> ContactMapModel | None:
        table = np.array(self._rows)
        result = _Samples(table[:, 0], table[:, 1], table[:, 2], table[:, 3] > 0.0, table[:, 4:])
        if not result.in_contact.any():
            return None
        maps = Map.new(origin=self._origin, zero=self._zero, lowest=result.place.min(), reached=result.place.max())
        learnt = maps[0]
        learnt.law_reached = learnt.reached
        learnt.law_speed = np.abs(result.velocity[result.in_contact]).max()
        learnt.felt = max(float((result.force - learnt.zero).max()), 0.0)
        for kind, part in enumerate((learnt.coarse, learnt.fine)):
            _fit_map(part, kind, result, self._stride)
        self._law = _fit_law(learnt, result)
        errors = _errors(learnt, result)
        squared = np.square(errors[result.in_contact]).mean(axis=0)
        if not learnt.law[0] > 0.0:
            squared[0] = math.inf
        weights = np.array([trust(square) for square in squared.tolist()])
        learnt.shares = weights / weights.sum()
        learnt.uncertainty[0] = float(np.square(errors[result.in_contact] @ learnt.shares).mean())
        return ContactMapModel.of(maps)


def _fit_map(part: np.void, kind: int, result: _Samples, weight: int) -> None:
    """Write the weights of one map and the ranges of its features into its record."""
    grid = GRIDS[kind]
    values = result.features[:, : grid.features]
    part["ranges"] = np.stack([values.min(axis=0), values.max(axis=0)], axis=1)
    inside = np.ones(result.place.size, dtype=np.bool_)
    if kind == 1:  # as in the bank, the fine map ends at its reach
        inside = (result.place >= -grid.below * grid.spacing) & (result.place <= grid.above * grid.spacing)
    if not inside.any():
        return
    regressor = _regressors(grid, result.place[inside], values[inside])
    root = _root(kind)
    reduced = regressor @ root
    information = weight * (reduced.T @ reduced) + np.eye(root.shape[0])
    part["weights"] = root @ np.linalg.solve(information, weight * (reduced.T @ result.force[inside]))


@cache
def _root(kind: int) -> Array:
    """L with P = L L': with w = L u the penalty is |u|^2, which needs no inverse of P."""
    values, vectors = np.linalg.eigh(prior(kind))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _regressors(grid: Grid, positions: Array, values: Array) -> Array:
    """The vectors h, shape (n, weights of the map)."""
    splines, matrix = np.empty(4), np.zeros((positions.size, grid.size))
    for row, (position, features_here) in enumerate(zip(positions.tolist(), values.tolist(), strict=True)):
        first = locate(position, grid.spacing, grid.below, grid.knots, splines)
        matrix[row, first : first + 4] = splines
        first = grid.knots + locate(position, grid.feature_spacing, grid.feature_below, grid.feature_knots, splines)
        for feature, value in enumerate(features_here):
            start = first + feature * grid.feature_knots
            matrix[row, start : start + 4] = value * splines
    return matrix


def _fit_law(learnt: Map, result: _Samples) -> OfflineFit | None:
    """Fit the law and write its numbers into the map; None where it cannot be fitted."""
    depth = result.place + learnt.origin
    chosen = result.in_contact & (depth > 0.0)
    try:
        fit = fit_offline(depth[chosen], result.velocity[chosen], result.force[chosen] - learnt.zero)
    except InputError:  # too few samples or no force: the maps go without the law
        return None
    learnt.law[:] = fit.model.parameters
    return fit


def _errors(learnt: Map, result: _Samples) -> Array:
    """Force of each expert less the measured force [N], shape (n, 3)."""
    columns = zip(result.features, result.place.tolist(), result.velocity.tolist(), strict=True)
    forces = np.array([experts(learnt, *column, 0.0, True)[:3] for column in columns])
    return np.asarray(forces - (result.force - learnt.zero)[:, None])
