"""The Hunt-Crossley law in a single stage, by logarithm."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification.conditioning import ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.kelvin_voigt_rls import at_least_zero
from foretouch.identification.recursion import BROKEN, Recursion, error_along
from foretouch.identification.robust import REFERENCE_DEPTH, REFERENCE_VELOCITY, RobustOptions
from foretouch.models import HuntCrossley

__all__ = ["HuntCrossleyLogOptions", "HuntCrossleyLogRLS"]

FEWEST_UPDATES = 20
"""No force is rendered from fewer samples."""


@dataclass(frozen=True, slots=True)
class HuntCrossleyLogOptions:
    """Choices of `HuntCrossleyLogRLS`.

    Args:
        initial_covariance: P_0 = this times I, of (ln k, lambda / k, n).
        forgetting_factor: mu at each sample, above 0 and at most 1; 1 forgets nothing. The source forgets
            exponentially where the material changes.
        initial_parameters: theta_0 = (ln k, lambda / k [s/m], n), depth in metres.
        robust: `largest_rate` does nothing here: nothing is divided by x.

    Raises:
        SettingError: A value out of range.
    """

    initial_covariance: float = 1e6
    forgetting_factor: float = 1.0
    initial_parameters: tuple[float, float, float] = (0.0, 0.0, 0.0)
    robust: RobustOptions = field(default_factory=RobustOptions)

    def __post_init__(self) -> None:
        require("initial_covariance", self.initial_covariance, above=0.0)
        require("forgetting_factor", self.forgetting_factor, above=0.0, at_most=1.0)
        if len(self.initial_parameters) != 3:
            raise SettingError("initial_parameters", self.initial_parameters, "takes ln k, lambda / k, n")
        for value in self.initial_parameters:
            require("initial_parameters", value)


class HuntCrossleyLogRLS(Estimator):
    r"""Identifies (k, lambda, n) of equation (2) by linear least squares on the logarithm of the force.

    .. math::
        \ln F = \ln k + n \ln x + \ln\left(1 + \tfrac{\lambda}{k} \dot x\right)
            \approx \ln k + \tfrac{\lambda}{k} \dot x + n \ln x

    which holds to 5 % of the damping term while `|lambda v / k| < 0.1`. Faster, damping is found too small in
    pressing and too large in releasing. Where it is found negative, the law gets 0 and what fits best with it.

    `standard_errors` are those of independent errors of ln F, and of first order.

    Args:
        options: Its choices.

    References:
        Haddadi and Hashtrudi-Zaad (2012), Real-time identification of Hunt-Crossley dynamic models of contact
        environments, IEEE Transactions on Robotics 28(3).
    """

    name: ClassVar[str] = "log-rls"
    model_name: ClassVar[str] = "hunt-crossley"

    def __init__(self, options: HuntCrossleyLogOptions | None = None) -> None:
        self.options = HuntCrossleyLogOptions() if options is None else options
        scaled = self.options.robust.scaled
        self._depth_scale, self._velocity_scale = (REFERENCE_DEPTH, REFERENCE_VELOCITY) if scaled else (1.0, 1.0)
        ln_k, rate, exponent = self.options.initial_parameters
        self._recursion = Recursion(
            np.array([ln_k + exponent * math.log(self._depth_scale), rate * self._velocity_scale, exponent]),
            self.options.initial_covariance,
            trace_limit=self.options.robust.trace_limit,
        )
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._recursion.reset()
        self.updates = 0

    def update(self, sample: ContactSample) -> Status:
        """One step; see `Estimator.update`."""
        robust = self.options.robust
        refusal = robust.refuse(sample, logarithms=True)
        if refusal is not None:
            return refusal
        _, depth, velocity, force, _ = sample
        regressor = (1.0, velocity / self._velocity_scale, math.log(depth / self._depth_scale))
        factor = self.options.forgetting_factor
        if self._recursion.learn(regressor, math.log(force), factor, robust.weight(force)) == BROKEN:
            self.reset()
            return Status.RESTARTED
        self.updates += 1
        return Status.LEARNT

    @property
    def unscaled_covariance(self) -> NDArray[np.float64]:
        """A copy of P, shape (3, 3), of (ln k, lambda / k, n) in the units of the regressors."""
        return self._recursion.covariance.copy()

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Of ln k, lambda / k [s/m] and n, depth in metres, shape (3, 3); None before it is known."""
        covariance = self._recursion.error_covariance
        if covariance is None:
            return None
        to_metres = np.diag([1.0, 1.0 / self._velocity_scale, 1.0])
        to_metres[0, 2] = -math.log(self._depth_scale)
        return np.asarray(to_metres @ covariance @ to_metres.T)

    @property
    def model(self) -> HuntCrossley | None:
        """The law (2), None before 20 samples or while its stiffness or exponent is out of range."""
        if self.updates < FEWEST_UPDATES:
            return None
        ln_k, rate, exponent = self._unknowns()
        if not (abs(ln_k) < 700.0 and 0.0 < exponent < math.inf):
            return None
        stiffness = math.exp(ln_k)
        damping = stiffness * max(0.0, rate)
        return HuntCrossley(stiffness, damping, exponent) if math.isfinite(damping) else None

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Of stiffness, damping and exponent, None before there is a model."""
        model, covariance = self.model, self.covariance
        if model is None or covariance is None:
            return None
        _, rate, _ = self._unknowns()
        ln_k, per_rate, exponent = np.eye(3)
        slopes = (model.stiffness * ln_k, model.stiffness * (max(0.0, rate) * ln_k + per_rate), exponent)
        errors = (error_along(slope, covariance) for slope in slopes)
        return dict(zip(model.parameter_names, errors, strict=True))

    def _unknowns(self) -> tuple[float, float, float]:
        """Ln k, lambda / k and n, depth in metres."""
        values = at_least_zero(self._recursion.theta, self._recursion.covariance, 1)
        level, rate, exponent = values.tolist()
        return level - exponent * math.log(self._depth_scale), rate / self._velocity_scale, exponent
