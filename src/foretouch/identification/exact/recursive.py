"""The package's own estimator: a recursive one on the exact law (4), with standard errors."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel
from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification.conditioning.conditioner import ContactSample, ContactSamples
from foretouch.identification.estimator import Estimator, Status, status_indices
from foretouch.identification.exact.belief import (
    DRIFT,
    FEWEST_UPDATES,
    FIRST_ERROR,
    LEARNING_TIME,
    SURFACE_NOISE,
    Settings,
    clear,
)
from foretouch.identification.exact.kernel import (
    CHANGED,
    FAILED,
    FREE_AIR,
    HELD,
    LEARNT,
    UNUSABLE,
    Filter,
    move_surface,
    run,
    take,
)
from foretouch.identification.exact.law import EXACT_LAWS
from foretouch.models import ContactModel

Array = NDArray[np.float64]

EXPONENT_PRIOR = math.sqrt(1.0 / 12.0)
"""Standard deviation of an exponent of which only the range is known, which has the length 1."""


@dataclass(frozen=True, slots=True)
class ExactOptions:
    """One set of defaults for all materials; lengths are relative to the depths pressed, forces to those felt.

    Args:
        surface_prior: That of the surface, relative to the reference depth; 0 trusts the surface that is given.
        drift: Random walk of the law in one second, in the standard deviations of the beginning.
        ignorance_time: Time for which the first noise is remembered [s of motion in contact].
        surface_noise: Standard deviation of each depth, relative to the reference depth; nothing is learnt from samples
            that are nearer to the surface.
    """

    surface_prior: float = FIRST_ERROR
    drift: float = DRIFT
    ignorance_time: float = LEARNING_TIME
    surface_noise: float = SURFACE_NOISE

    def __post_init__(self) -> None:
        for field in fields(self):
            require(field.name, getattr(self, field.name), at_least=0.0)
        require("ignorance_time", self.ignorance_time, above=0.0)


_STATUS = {
    LEARNT: Status.LEARNT,
    CHANGED: Status.CHANGED,
    HELD: Status.HELD,
    UNUSABLE: Status.UNUSABLE,
    FAILED: Status.RESTARTED,
    FREE_AIR: Status.FREE_AIR,
}
_INDICES = status_indices(_STATUS[code] for code in range(len(_STATUS)))


_take = Kernel(take, "(Filter[::1], f8, f8, f8, f8)")


class _ExactFilter(Estimator):
    """The filter that `ExactContinuousSwitching` explains, for each law of the family (4).

    Attributes:
        changes: Number of sudden changes detected since the last reset.
    """

    name: ClassVar[str] = "exact"

    def __init__(self, options: ExactOptions | None = None) -> None:
        self.options = ExactOptions() if options is None else options
        self._law = EXACT_LAWS[self.model_name]
        options, s_bounds, alpha_bounds = self.options, self._law.s_bounds, self._law.alpha_bounds
        fixed = (s_bounds[0] == s_bounds[1], alpha_bounds[0] == alpha_bounds[1])
        s_prior, alpha_prior = (0.0 if one else EXPONENT_PRIOR for one in fixed)
        same = {name: getattr(options, name) for name in Settings.layout.names or () if hasattr(options, name)}
        priors = (1.0, 1.0, s_prior, alpha_prior, options.surface_prior)
        settings = Settings.new(**same, priors=priors, s_bounds=s_bounds, alpha_bounds=alpha_bounds)
        self._filters = Filter.new(settings=settings[0])
        self.place_in(self._filters)
        self._take = _take.entry
        move_surface(self._filters, 0.0)
        self.reset()

    def place_in(self, filters: NDArray[np.void]) -> None:
        """Keep the state in an array of one `Filter` from now on, a field of a larger record."""
        filters[:] = self._filters
        self._filters, self._settings, self._belief = filters, filters[0].settings, filters[0].belief[0]

    def reset(self) -> None:
        """Forget all samples."""
        clear(self._filters[0].belief)
        self.updates = 0
        self.changes = 0

    def update(self, sample: ContactSample) -> Status:
        """One step of the filter; see `Estimator.update`."""
        time, depth, velocity, force, in_contact = sample
        if not in_contact:
            return Status.FREE_AIR
        code = self._take(self._filters, time, depth, velocity, force)
        if code <= CHANGED:
            self.updates += 1
            self.changes += code
        elif code == FAILED:
            self.updates = 0
        return _STATUS[code]

    def run(self, samples: ContactSamples) -> NDArray[np.int8]:
        """See `Estimator.run`; one compiled loop."""
        codes = np.empty(len(samples), np.int8)
        run(self._filters, *samples.columns, codes)
        failed = np.flatnonzero(codes == FAILED)
        learnt = codes <= CHANGED
        self.changes += int((codes == CHANGED).sum())
        self.updates = int(learnt[failed[-1] :].sum()) if failed.size else self.updates + int(learnt.sum())
        return _INDICES[codes]

    def trust_surface(self, trusted: bool) -> None:
        """See `Estimator.trust_surface`: a surface that is known is not corrected."""
        self._settings.priors[4] = 0.0 if trusted else self.options.surface_prior

    def move_surface(self, change: float) -> None:
        """See `Estimator.move_surface`."""
        if math.isfinite(change):
            move_surface(self._filters, change)

    @property
    def surface_correction(self) -> float:
        """See `Estimator.surface_correction`."""
        return float(self._belief.theta[4] * self._belief.reference)

    @property
    def surface_error(self) -> float:
        """See `Estimator.surface_error`."""
        return math.sqrt(self._belief.covariance[4, 4]) * float(self._belief.reference)

    @property
    def reference_depth(self) -> float:
        """x0 [m], 0 before the first sample."""
        return float(self._belief.reference)

    @property
    def unknowns(self) -> Array:
        """A copy of (F0, D, s, alpha, zeta), shape (5,)."""
        return np.array(self._belief.theta)

    @property
    def covariance(self) -> Array:
        """A copy of P, that of `unknowns`, shape (5, 5)."""
        return np.array(self._belief.covariance)

    @property
    def model(self) -> ContactModel | None:
        """The law, None before 8 samples."""
        if self._belief.count < FEWEST_UPDATES or self._belief.reference == 0.0:
            return None
        try:
            elastic, viscous, s, alpha, _ = self._belief.theta.tolist()
            return self._law.model(elastic, viscous, s, alpha, float(self._belief.reference))
        except (SettingError, OverflowError):  # depths and forces so extreme that k leaves the floating point numbers
            return None

    @property
    def parameters(self) -> dict[str, float | None]:
        """The law's numbers by name; None where the samples do not determine them.

        A strength is undetermined while its standard error is larger than itself, an exponent while its standard error
        is above 0.2.
        """
        model, errors = self.model, self.standard_errors
        if model is None or errors is None:
            return {}
        known = zip(model.parameter_names, model.parameters, strict=True)
        return {name: None if errors[name] is None else value for name, value in known}

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Of the law's numbers by name, by the delta method from P; None before there is a model.

        Undetermined parameters have none: the delta method is for small errors.
        """
        model = self.model
        if model is None:
            return None
        elastic, viscous, s, alpha, _ = self._belief.theta.tolist()
        sensitivities = np.array(self._law.sensitivities(elastic, viscous, s, alpha, float(self._belief.reference)))
        variances = np.diag(sensitivities @ self._belief.covariance[:4, :4] @ sensitivities.T)
        errors = np.sqrt(np.maximum(variances, 0.0)).tolist()
        result: dict[str, float | None] = {}
        for name, value, error in zip(model.parameter_names, model.parameters, errors, strict=True):
            limit = FIRST_ERROR if name in ("exponent", "switching") else value
            result[name] = error if error <= limit else None
        return result

    @property
    def standard_errors_with_surface(self) -> dict[str, float | None] | None:
        """See `Estimator.standard_errors_with_surface`: the surface is an unknown as the others are."""
        return self.standard_errors


class ExactContinuousSwitching(_ExactFilter):
    r"""Identifies the exact law (4) by an extended Kalman filter in unknowns of like size.

    .. math::
        F &= F_0 u^s + D u^{s-\alpha} \frac{\dot x T_0}{x_0} + \varepsilon, \quad u = x / x_0 + \zeta \\
        \operatorname{var} \varepsilon &= \sigma^2 + c^2 F^2 + (0.02\, \partial F / \partial \zeta)^2 \\
        S &= H P H^T + \kappa \operatorname{var} \varepsilon, \quad K = P H^T / S, \quad
            H = \partial F / \partial (F_0, D, s, \alpha, \zeta) \\
        \theta &\leftarrow \Pi\left(\theta + K e\right), \quad
            P \leftarrow (I - K H) P (I - K H)^T + K \kappa \operatorname{var} \varepsilon K^T

    F0 is the elastic force at the reference depth x0 and D the damping force at reference depth and speed x0 / T0,
    T0 = 0.1 s; zeta is the height of the true surface above the given one, in x0, for a surface found by a threshold
    is found late. x0 follows the mean depth, and the unknowns are expressed at the new one exactly. Nothing depends on
    units of depth and force.

    - **Noise**: sigma and c are learnt from the residuals (their squares regressed on 1 and F^2, each counted as far as
      the unknowns cannot explain it). What the law cannot explain is not white: kappa = (1 + r) / (1 - r), r the
      correlation of successive residuals, makes such samples count as fewer. Before a second of motion has been seen,
      a rough material is assumed.
    - **Bounds**: equation (5) with s < 2, D >= 0 and at most 20 F0, zeta within three of its first deviations: the
      nearest point in the metric of P.
    - **Sudden change**: if the squared normalised innovations of the last 20 ms have a mean above that of three
      deviations, P is that of the beginning again. One wild sample cannot do that; its gain is cut (as Huber does)
      beyond three deviations.
    - **Gradual change**: a slow random walk.
    - **Frozen** in free air and in a held position: no sample there changes anything.

    Its sums are bounded: P never passes that of the beginning.

    Args:
        options: One set of defaults.

    References:
        Jazwinski (1970), Stochastic Processes and Filtering Theory, chapter 8; Simon (2010), Kalman filtering with
        state constraints, IET Control Theory and Applications 4(8); Huber (1964), Robust estimation of a location
        parameter, Annals of Mathematical Statistics 35(1).
    """

    model_name: ClassVar[str] = "continuous-switching"


class ExactKelvinVoigt(_ExactFilter):
    """The same filter with s = alpha = 1: the Kelvin-Voigt law (1)."""

    model_name: ClassVar[str] = "kelvin-voigt"


class ExactHuntCrossley(_ExactFilter):
    """The same filter with alpha = 0: the Hunt-Crossley law (2)."""

    model_name: ClassVar[str] = "hunt-crossley"
