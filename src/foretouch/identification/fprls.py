"""The paper's estimator: recursive least squares with forgetting and self-perturbation (FPRLS), equation (20)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.identification.conditioning import ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.models import LinearisedContinuousSwitching
from foretouch.models.checks import require

__all__ = ["FPRLS", "FPRLSOptions"]

Array = NDArray[np.float64]

SMALLEST_FORCE = 1e-3
"""Forces below this [N] have no usable logarithm: the sensor's noise is larger."""

FEWEST_UPDATES = 20
"""No force is rendered from fewer samples; the paper's simulations settle at the 20th."""


@dataclass(frozen=True, slots=True)
class FPRLSOptions:
    r"""What the paper prints, and what it leaves open.

    Args:
        initial_covariance: P_0 = this times I; the paper names 10^6.
        perturbation: delta, added to the diagonal of P when the self-perturbing test trips; the paper's 10^6.
        sensitivity: kappa of the test kappa e^2 >= 1; the paper's 1.
        forgetting_rate: rho [1/m] of `mu = 0.95 + 0.05 exp(-rho |dx|)`. The paper gives no value. At its 10 Hz a hand
            moves millimetres between samples, so 1000 / m (one per millimetre) lets mu work in the middle of its
            range there. What is forgotten is forgotten by distance moved: at 1 kHz the same motion is cut into
            hundred times smaller steps, each forgetting about as much less.
        initial_parameters: theta_0 = (ln k, s, b1, b2); the paper gives none.

    The self-perturbing test sees the error of the logarithm, as equation (20) defines e; the paper's text speaks of
    1 N instead.
    """

    initial_covariance: float = 1e6
    perturbation: float = 1e6
    sensitivity: float = 1.0
    forgetting_rate: float = 1000.0
    initial_parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        require("initial_covariance", self.initial_covariance, above=0.0)
        require("perturbation", self.perturbation, at_least=0.0)
        require("sensitivity", self.sensitivity, at_least=0.0)
        require("forgetting_rate", self.forgetting_rate, at_least=0.0)
        if len(self.initial_parameters) != 4:
            raise SettingError("initial_parameters", self.initial_parameters, "takes ln_k, s, b1, b2")
        for value in self.initial_parameters:
            require("initial_parameters", value)


def _update(
    theta: Array,
    covariance: Array,
    depth: float,
    velocity: float,
    force: float,
    depth_change: float,
    perturbation: float,
    sensitivity: float,
    forgetting_rate: float,
) -> bool:
    """One step of (20) in place. Returns False when P was no longer a covariance; then nothing was changed.

    The equations are the paper's; P is kept symmetric by computing one triangle.
    """
    regressor = (1.0, math.log(depth), velocity, velocity / depth)
    forgetting_factor = 0.95 + 0.05 * math.exp(-forgetting_rate * abs(depth_change))
    projected = np.empty(4)  # P Phi
    denominator = forgetting_factor
    innovation = math.log(force)
    for i in range(4):
        total = 0.0
        for j in range(4):
            total += covariance[i, j] * regressor[j]
        projected[i] = total
        denominator += regressor[i] * total
        innovation -= regressor[i] * theta[i]
    if not (denominator > 0.0 and math.isfinite(denominator) and math.isfinite(innovation)):
        return False
    enlargement = perturbation if sensitivity * innovation * innovation >= 1.0 else 0.0
    for i in range(4):
        gain = projected[i] / denominator
        theta[i] += gain * innovation
        for j in range(i + 1):
            value = (covariance[i, j] - gain * projected[j]) / forgetting_factor
            covariance[i, j] = value
            covariance[j, i] = value
        covariance[i, i] += enlargement
    return True


_compiled_update = njit(cache=True)(_update)


class FPRLS(Estimator):
    r"""Identifies (ln k, s, b1, b2) of the linearised law (18) by equation (20), as printed.

    .. math::
        K_{k+1} &= P_k \Phi_{k+1} (\mu + \Phi_{k+1}^T P_k \Phi_{k+1})^{-1} \\
        \hat\theta_{k+1} &= \hat\theta_k + K_{k+1} \hat e_k, \quad
            \hat e_k = \ln F_{k+1} - \Phi_{k+1}^T \hat\theta_k \\
        P_{k+1} &= \tfrac{1}{\mu} (I - K_{k+1} \Phi_{k+1}^T) P_k + \delta\, [\kappa \hat e_k^2 \ge 1]\, I \\
        \Phi &= (1, \ln x, \dot x, \dot x / x), \quad
            \mu = 0.95 + 0.05\, e^{-\rho |x_{k+1} - x_k|}

    with depth in metres. Samples with a depth or a force too small for a logarithm are left out (the paper does not
    say what it does with them). A covariance that overflows or loses positive definiteness, which the printed
    equations allow, is set back to P_0 and the update says so.

    Args:
        options: The choices that the paper leaves open.
    """

    name: ClassVar[str] = "fprls"
    model_name: ClassVar[str] = "continuous-switching"
    smallest_depth: ClassVar[float] = 1e-5

    def __init__(self, options: FPRLSOptions | None = None) -> None:
        self.options = FPRLSOptions() if options is None else options
        self.reset()
        # Compiled here, before any loop: the first call would otherwise cost a second inside it.
        _compiled_update(np.zeros(4), np.eye(4), 0.01, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)

    def reset(self) -> None:
        """Forget all samples."""
        self._theta = np.array(self.options.initial_parameters)
        self._covariance = self.options.initial_covariance * np.eye(4)
        self._last_depth = math.nan
        self.updates = 0

    def update(self, sample: ContactSample) -> Status:
        """One step of (20); see `Estimator.update`."""
        if not sample.in_contact:
            self._last_depth = math.nan
            return Status.FREE_AIR
        _, depth, velocity, force, _ = sample
        if not (depth >= self.smallest_depth and force >= SMALLEST_FORCE and math.isfinite(velocity)):
            return Status.UNUSABLE
        depth_change = 0.0 if math.isnan(self._last_depth) else depth - self._last_depth
        self._last_depth = depth
        options = self.options
        if not _compiled_update(
            self._theta,
            self._covariance,
            depth,
            velocity,
            force,
            depth_change,
            options.perturbation,
            options.sensitivity,
            options.forgetting_rate,
        ):
            self.reset()
            return Status.RESTARTED
        self.updates += 1
        return Status.LEARNT

    @property
    def unscaled_covariance(self) -> Array:
        """A copy of P, shape (4, 4)."""
        return self._covariance.copy()

    @property
    def model(self) -> LinearisedContinuousSwitching | None:
        """The law (18), None before 20 samples or while a parameter is not finite."""
        values = self._theta.tolist()
        if self.updates < FEWEST_UPDATES or not all(map(math.isfinite, values)):
            return None
        return LinearisedContinuousSwitching(*values)

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """None: P is not scaled by a noise variance, and forgetting and perturbation take its meaning away."""
        return None
