"""Recursive least squares, one compiled step that all linear estimators share."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

__all__ = [
    "BROKEN",
    "LARGEST_LOG",
    "LEARNT",
    "PERTURBED",
    "ErrorUnit",
    "PerturbationForm",
    "PerturbationMoment",
    "Recursion",
]

Array = NDArray[np.float64]

ErrorUnit = Literal["log", "newton"]
PerturbationMoment = Literal["after", "before"]
PerturbationForm = Literal["add", "reset"]

BROKEN, LEARNT, PERTURBED = 0, 1, 2

LARGEST_TRACE = 1e100
"""A covariance beyond this has nothing left to say, and would overflow soon: the estimator begins again."""

LARGEST_LOG = 600.0
"""Logarithms of forces count as at most this where they are turned into newtons: no overflow."""


def _perturb(covariance: Array, perturbation: float, resetting: bool, trace_limit: float) -> None:
    """Enlarge P by delta I, or set it to delta I, as far as the limit of its trace allows."""
    size = covariance.shape[0]
    trace = 0.0
    for i in range(size):
        if resetting:
            covariance[i, :] = 0.0
        trace += covariance[i, i]
    enlargement = min(perturbation, max(0.0, trace_limit - trace) / size)
    for i in range(size):
        covariance[i, i] += enlargement


_compiled_perturb = compiled(_perturb)


def _step(
    theta: Array,
    covariance: Array,
    residuals: Array,
    regressor: Array,
    target: float,
    weight: float,
    forgetting_factor: float,
    sensitivity: float,
    perturbation: float,
    in_newtons: bool,
    before: bool,
    resetting: bool,
    trace_limit: float,
) -> int:
    """One step in place: see `Recursion.learn`.

    Returns 0 when P was no longer a covariance (then the caller begins again), 1 otherwise, 2 when the
    self-perturbing test tripped. P is kept symmetric by computing one triangle.
    """
    size = theta.size
    innovation = target
    for i in range(size):
        innovation -= regressor[i] * theta[i]
    error = innovation
    if in_newtons:
        error = math.exp(min(target, LARGEST_LOG)) - math.exp(min(target - innovation, LARGEST_LOG))
    tripped = perturbation > 0.0 and sensitivity * error * error >= 1.0
    if tripped and before:
        _compiled_perturb(covariance, perturbation, resetting, trace_limit)
    projected = np.empty(size)  # P Phi
    denominator = forgetting_factor / weight
    for i in range(size):
        total = 0.0
        for j in range(size):
            total += covariance[i, j] * regressor[j]
        projected[i] = total
        denominator += regressor[i] * total
    if not (denominator > 0.0 and math.isfinite(denominator) and math.isfinite(innovation)):
        return BROKEN
    trace = 0.0
    for i in range(size):
        trace += covariance[i, i] - projected[i] / denominator * projected[i]
    # Where the limit is infinite this is the forgetting factor itself; else no more is forgotten than the limit allows.
    growth = min(1.0, max(forgetting_factor, trace / trace_limit))
    for i in range(size):
        gain = projected[i] / denominator
        theta[i] += gain * innovation
        for j in range(i + 1):
            value = (covariance[i, j] - gain * projected[j]) / growth
            covariance[i, j] = value
            covariance[j, i] = value
    residuals[0] = forgetting_factor * residuals[0] + innovation * innovation * forgetting_factor / denominator
    residuals[1] = forgetting_factor * residuals[1] + 1.0
    if tripped and not before:
        _compiled_perturb(covariance, perturbation, resetting, trace_limit)
    if not (trace / growth < LARGEST_TRACE and np.all(np.isfinite(theta))):
        return BROKEN
    return PERTURBED if tripped else LEARNT


_compiled_step = compiled(_step)


class Recursion:
    r"""Unknowns, covariance and sum of residuals of one recursive least squares problem.

    Args:
        initial: theta_0, shape (n,).
        initial_covariance: P_0 = this times I, positive.
        sensitivity: kappa of the self-perturbing test `kappa e^2 >= 1`.
        perturbation: delta; 0 switches the test off.
        error_unit: Whether e is the innovation itself (`log`, for the targets are logarithms of forces) or the
            difference of the forces (`newton`).
        moment: Whether P is enlarged `before` the gain of the sample that trips the test, or `after` it.
        form: Whether delta I is added to P (`add`) or takes its place (`reset`).
        trace_limit: Neither forgetting nor perturbation takes the trace of P beyond it; inf for none. P_0 may lie
            beyond: then nothing is forgotten until samples have brought P below.

    Attributes:
        theta: Newest estimate, shape (n,); not to be changed from outside.
        covariance: P, shape (n, n); not to be changed from outside.
    """

    def __init__(
        self,
        initial: Array,
        initial_covariance: float,
        *,
        sensitivity: float = 0.0,
        perturbation: float = 0.0,
        error_unit: ErrorUnit = "log",
        moment: PerturbationMoment = "after",
        form: PerturbationForm = "add",
        trace_limit: float = math.inf,
    ) -> None:
        self._initial = initial
        # Compiled here, before any loop: the first call would otherwise cost a second inside it.
        self._initial_covariance = initial_covariance
        self._choices = (sensitivity, perturbation, error_unit == "newton", moment == "before", form == "reset")
        self._trace_limit = trace_limit
        self._regressor = np.zeros(initial.size)
        self.reset()
        self.learn((0.0,) * initial.size, 0.0)
        self.reset()

    def reset(self) -> None:
        """Back to theta_0 and P_0."""
        self.theta = self._initial.copy()
        self.covariance = self._initial_covariance * np.eye(self._initial.size)
        self._residuals = np.zeros(2)

    def learn(
        self, regressor: tuple[float, ...], target: float, forgetting_factor: float = 1.0, weight: float = 1.0
    ) -> int:
        r"""One step.

        .. math::
            e &= y - \Phi^T \theta, \qquad K = P \Phi \,(\mu / w + \Phi^T P \Phi)^{-1} \\
            \theta &\leftarrow \theta + K e, \qquad
                P \leftarrow \tfrac{1}{\mu} (I - K \Phi^T) P \;[+\; \delta I]

        With w = 1 these are the paper's (20). They minimise the sum of w e^2, each term multiplied by mu once for
        every later sample, plus the pull of theta_0.

        Args:
            regressor: Phi, n numbers.
            target: y.
            forgetting_factor: mu, above 0 and at most 1.
            weight: w, positive: the inverse of the variance of y, up to a common factor.

        Returns:
            0 when the numbers were no longer usable; call `reset` then. 1 when it learnt, 2 when it also perturbed P.
        """
        for index, value in enumerate(regressor):
            self._regressor[index] = value
        return int(
            _compiled_step(
                self.theta,
                self.covariance,
                self._residuals,
                self._regressor,
                target,
                weight,
                forgetting_factor,
                *self._choices,
                self._trace_limit,
            )
        )

    @property
    def residual_variance(self) -> float | None:
        """Variance of a target of weight 1, from the weighted squares of the residuals; None from too few samples.

        Each innovation is turned into the residual that it leaves by its share mu / (mu + w Phi' P Phi).
        """
        total, count = self._residuals.tolist()
        freedom = count - self.theta.size
        return total / freedom if freedom > 0.0 and math.isfinite(total) else None

    @property
    def error_covariance(self) -> Array | None:
        """P times the residual variance, shape (n, n); None from too few samples, or where it says nothing.

        It is the covariance of the estimate where errors of the targets are independent and nothing was perturbed.
        """
        variance = self.residual_variance
        if variance is None or not variance * float(np.trace(self.covariance)) < LARGEST_TRACE:
            return None
        return self.covariance * variance


def error_along(slope: Array, covariance: Array) -> float | None:
    """Standard error of what changes by `slope`, shape (n,), with unknowns of this covariance, shape (n, n).

    None where it is no number.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        variance = float(slope @ covariance @ slope)
    return math.sqrt(max(0.0, variance)) if math.isfinite(variance) else None
