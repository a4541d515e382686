"""Recursive least squares, one compiled step for all linear estimators, with logarithm and exponential of its own.

These are additions, multiplications and one divide, the same bits wherever they are computed. The C library, NumPy's
vectors and another machine round ln x differently in the last digit. Least squares with forgetting can amplify that
digit without bound (a covariance that winds up breaks at the sample where rounding says), so the compiled estimators
compute both with the arithmetic that IEEE 754 determines to the last bit. Without branches and tables, loops over them
become vector instructions; interpreted they give the same.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined

LARGEST_EXPONENT = 708.0  # Arguments of the exponential count as at most this, and as at least minus this

ROOT_HALF_BITS = 0x3FE6A09E00000000  # of sqrt(1/2), rounded down
SHIFT = 0x3FF0000000000000 - ROOT_HALF_BITS
MANTISSA = 0x000FFFFFFFFFFFFF
TWO_52_BITS = 0x4330000000000000  # of 2^52: integers in its mantissa are read as numbers
TWO_52_AND_BIAS = 4503599627370496.0 + 1023.0
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # the first has 32 bits: k times it is exact
INVERSE_LN2 = 1.4426950408889634
ROUNDER = 6755399441055744.0 + 1023.0  # 1.5 * 2^52 + 1023: adding it rounds, and leaves k + 1023 in the lowest bits


@inlined
def bits_of(value: float) -> np.int64:
    """The 64 bits of a number as an integer."""
    return np.float64(value).view(np.int64)


@inlined
def number_of(bits: np.int64) -> float:
    """The number of these 64 bits."""
    return np.int64(bits).view(np.float64)


@inlined
def logarithm(x: float) -> float:
    r"""Natural logarithm of a positive normal number, within one unit in the last place.

    With :math:`x = 2^k (1 + f)`, :math:`1 + f` within :math:`\sqrt{1/2}` to :math:`\sqrt 2`, and
    :math:`s = f / (2 + f)`: :math:`\ln x = k \ln 2 + 2\,(s + s^3/3 + s^5/5 + \dots)`, to the term of :math:`s^{19}`.
    """
    shifted = bits_of(x) + SHIFT
    k = number_of((shifted >> 52) | TWO_52_BITS) - TWO_52_AND_BIAS
    f = number_of((shifted & MANTISSA) + ROOT_HALF_BITS) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = (2.0 / 3.0 + w * (2.0 / 7.0)) + (w * w) * ((2.0 / 11.0 + w * (2.0 / 15.0)) + (w * w) * (2.0 / 19.0))
    even = (2.0 / 5.0 + w * (2.0 / 9.0)) + (w * w) * (2.0 / 13.0 + w * (2.0 / 17.0))
    rest = z * odd + w * even
    half_square = 0.5 * f * f
    return (((s * (half_square + rest) + k * LN2_LOW) - half_square) + f) + k * LN2_HIGH


@inlined
def exponential(x: float) -> float:
    r"""exp(x), within one unit in the last place; arguments count as within -708 to 708, NaN as -708.

    With :math:`x = k \ln 2 + r`, :math:`2^k` times the series of :math:`e^r` to the term of :math:`r^{14}`.
    """
    x = x if x > -LARGEST_EXPONENT else -LARGEST_EXPONENT
    x = x if x < LARGEST_EXPONENT else LARGEST_EXPONENT
    rounded = x * INVERSE_LN2 + ROUNDER
    k = rounded - ROUNDER
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    r2 = r * r
    r4 = r2 * r2
    low = (1.0 / 6.0 + r * (1.0 / 24.0)) + r2 * (1.0 / 120.0 + r * (1.0 / 720.0))
    middle = (1.0 / 5040.0 + r * (1.0 / 40320.0)) + r2 * (1.0 / 362880.0 + r * (1.0 / 3628800.0))
    high = (1.0 / 39916800.0 + r * (1.0 / 479001600.0)) + r2 * (1.0 / 6227020800.0 + r * (1.0 / 87178291200.0))
    tail = low + r4 * (middle + r4 * high)
    scale = number_of((bits_of(rounded) & 0x7FF) << 52)
    return (1.0 + (r + (0.5 * r2 + (r2 * r) * tail))) * scale


Array = NDArray[np.float64]

ErrorUnit = Literal["log", "newton"]
PerturbationMoment = Literal["after", "before"]
PerturbationForm = Literal["add", "reset"]

BROKEN, LEARNT, PERTURBED = 0, 1, 2

LARGEST_TRACE = 1e100
"""A covariance beyond this has nothing left to say, and would overflow soon: the estimator begins again."""

LARGEST_LOG = 600.0  # Logarithms of forces count as at most this where they are turned into newtons: no overflow


@compiled
def _perturb(covariance: Array, perturbation: float, resetting: bool, trace_limit: float) -> None:
    """Enlarge P by delta I, or set it to delta I, as far as the limit of its trace allows."""
    size = covariance.shape[0]
    if resetting:
        covariance[:] = 0.0
    enlargement = min(perturbation, max(0.0, trace_limit - np.trace(covariance)) / size)
    for i in range(size):
        covariance[i, i] += enlargement


@compiled(allocates=True)
def _step(
    theta: Array,
    covariance: Array,
    residuals: Array,
    regressor: Array,
    target: float,
    weight: float,
    forgetting_factor: float,
    rules: tuple[float, float, bool, float],
) -> int:
    """One step in place: see `Recursion.learn`. P is kept symmetric by computing one triangle."""
    sensitivity, perturbation, resetting, trace_limit = rules
    size = theta.size
    innovation = target
    for i in range(size):
        innovation -= regressor[i] * theta[i]
    tripped = perturbation > 0.0 and sensitivity * innovation * innovation >= 1.0
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
    if tripped:
        _perturb(covariance, perturbation, resetting, trace_limit)
    if not (trace / growth < LARGEST_TRACE and np.all(np.isfinite(theta))):
        return BROKEN
    return PERTURBED if tripped else LEARNT


class Recursion:
    r"""Unknowns, covariance and sum of residuals of one recursive least squares problem.

    Args:
        initial: theta_0, shape (n,).
        initial_covariance: P_0 = this times I, positive.
        sensitivity: kappa of the self-perturbing test `kappa e^2 >= 1`.
        perturbation: delta; 0 switches the test off.
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
        form: PerturbationForm = "add",
        trace_limit: float = math.inf,
    ) -> None:
        self._initial = initial
        # Compiled here, before any loop: the first call would otherwise cost a second inside it.
        self._initial_covariance = initial_covariance
        self._rules = (sensitivity, perturbation, form == "reset", trace_limit)
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
        for index, value in enumerate(regressor):  # quicker than a slice
            self._regressor[index] = value
        known = self.theta, self.covariance, self._residuals
        return int(_step(*known, self._regressor, target, weight, forgetting_factor, self._rules))

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
