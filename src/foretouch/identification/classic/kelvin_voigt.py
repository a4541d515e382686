"""The Kelvin-Voigt law by recursive least squares."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.linear.options import REFERENCE_DEPTH, REFERENCE_VELOCITY, RobustOptions
from foretouch.identification.linear.recursion import BROKEN, Recursion
from foretouch.models import KelvinVoigt

FEWEST_UPDATES = 20
"""No force is rendered from fewer samples."""


@dataclass(frozen=True, slots=True)
class KelvinVoigtOptions:
    """Choices of `KelvinVoigtRLS`.

    Args:
        initial_covariance: P_0 = this times I, of (K, B) in N/m and N s/m and a force noise of 1 N: 10^10 lets a
            stiffness of 10^5 N/m be found at once.
        forgetting_factor: mu at each sample, above 0 and at most 1; 1 forgets nothing.
        initial_parameters: theta_0 = (K, B) [N/m, N s/m].
        robust: `weight_force` and `largest_rate` do nothing here: the target is a force, and nothing is divided by x.

    Raises:
        SettingError: A value out of range.
    """

    initial_covariance: float = 1e10
    forgetting_factor: float = 1.0
    initial_parameters: tuple[float, float] = (0.0, 0.0)
    robust: RobustOptions = field(default_factory=RobustOptions)

    def __post_init__(self) -> None:
        require("initial_covariance", self.initial_covariance, above=0.0)
        require("forgetting_factor", self.forgetting_factor, above=0.0, at_most=1.0)
        if len(self.initial_parameters) != 2:
            raise SettingError("initial_parameters", self.initial_parameters, "takes stiffness, damping")
        for value in self.initial_parameters:
            require("initial_parameters", value)


class KelvinVoigtRLS(Estimator):
    r"""Identifies (K, B) of equation (1), `F = K x + B v`, by recursive least squares on the force itself.

    Nothing is linearised, so this is exact; error is in newtons. Where the estimate of B is negative, as it is when
    the force lags behind the position, the law gets B = 0 and the K that fits best with it.

    `standard_errors` are those of independent errors of the force; the misfit of the law is not independent.

    Args:
        options: Its choices.
    """

    name: ClassVar[str] = "rls"
    model_name: ClassVar[str] = "kelvin-voigt"

    def __init__(self, options: KelvinVoigtOptions | None = None) -> None:
        self.options = KelvinVoigtOptions() if options is None else options
        robust = self.options.robust
        self._scales = np.array((REFERENCE_DEPTH, REFERENCE_VELOCITY) if robust.scaled else (1.0, 1.0))
        self._recursion = Recursion(
            np.array(self.options.initial_parameters) * self._scales,
            self.options.initial_covariance,
            trace_limit=robust.trace_limit,
        )
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._recursion.reset()
        self.updates = 0

    def update(self, sample: ContactSample) -> Status:
        """One step; see `Estimator.update`."""
        refusal = self.options.robust.refuse(sample, logarithms=False)
        if refusal is not None:
            return refusal
        depth_scale, velocity_scale = self._scales.tolist()
        regressor = (sample.depth / depth_scale, sample.velocity / velocity_scale)
        if self._recursion.learn(regressor, sample.force, self.options.forgetting_factor) == BROKEN:
            self.reset()
            return Status.RESTARTED
        self.updates += 1
        return Status.LEARNT

    @property
    def unscaled_covariance(self) -> NDArray[np.float64]:
        """A copy of P, shape (2, 2), of the unknowns in the units of the regressors."""
        return self._recursion.covariance.copy()

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Of stiffness [N/m] and damping [N s/m], shape (2, 2); None before it is known."""
        covariance = self._recursion.error_covariance
        return None if covariance is None else covariance / np.outer(self._scales, self._scales)

    @property
    def model(self) -> KelvinVoigt | None:
        """The law (1), None before 20 samples or while its stiffness is not positive."""
        if self.updates < FEWEST_UPDATES:
            return None
        values = at_least_zero(self._recursion.theta, self._recursion.covariance, 1) / self._scales
        stiffness, damping = values.tolist()
        if not (0.0 < stiffness < math.inf and damping < math.inf):
            return None
        return KelvinVoigt(stiffness, max(0.0, damping))

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Of stiffness [N/m] and damping [N s/m], None before there is a model."""
        covariance = self.covariance
        if self.model is None or covariance is None:
            return None
        errors = np.sqrt(np.maximum(0.0, np.diag(covariance)))
        return dict(zip(KelvinVoigt.parameter_names, errors.tolist(), strict=True))


def at_least_zero(theta: NDArray[np.float64], covariance: NDArray[np.float64], index: int) -> NDArray[np.float64]:
    """The unknowns that fit best under the bound that one of them is not negative.

    Least squares with covariance P has its constrained minimum at `theta - P[:, i] / P[i, i] theta[i]`.

    Args:
        theta: Minimum without the bound, shape (n,).
        covariance: P, shape (n, n).
        index: Of the unknown that is bounded.
    """
    if not (theta[index] < 0.0 and covariance[index, index] > 0.0):
        return theta
    share = float(theta[index] / covariance[index, index])
    return theta - covariance[:, index] * share
