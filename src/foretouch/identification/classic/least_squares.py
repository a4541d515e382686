"""The Kelvin-Voigt and the Hunt-Crossley law by recursive least squares.

Hunt-Crossley in two ways: in a single stage by logarithm, and in two stages that feed each other.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require, require_fields
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.estimator import FEWEST_UPDATES, Estimator, Status
from foretouch.identification.linear.options import RobustOptions
from foretouch.identification.linear.recursion import BROKEN, LARGEST_LOG, Recursion, error_along
from foretouch.models import HuntCrossley, KelvinVoigt

Array = NDArray[np.float64]


class _LeastSquares(Estimator):
    """Recursions that a leaf feeds with each usable sample; the second unknown of the first is the damping.

    Args:
        robust: What mends them.
        *begins: theta_0, and P_0 as a multiple of I, of each recursion.
    """

    logarithms: ClassVar[bool] = True

    def __init__(self, robust: RobustOptions, *begins: tuple[ArrayLike, float]) -> None:
        self._robust, (self._depth_scale, self._velocity_scale) = robust, robust.scales
        self._recursions = [
            Recursion(np.array(first, np.float64), p, trace_limit=robust.trace_limit) for first, p in begins
        ]
        self._recursion = self._recursions[0]

    def reset(self) -> None:
        """Forget all samples."""
        for recursion in self._recursions:
            recursion.reset()
        self.updates = 0

    @abstractmethod
    def _learn(self, sample: ContactSample) -> int:
        """Learn from a usable sample; BROKEN where the numbers are no longer usable."""

    def update(self, sample: ContactSample) -> Status:
        """One step; see `Estimator.update`."""
        refusal = self._robust.refuse(sample, logarithms=self.logarithms)
        if refusal is not None:
            return refusal
        if self._learn(sample) == BROKEN:
            self.reset()
            return Status.RESTARTED
        self.updates += 1
        return Status.LEARNT

    @property
    def unscaled_covariance(self) -> Array:
        """A copy of P of all unknowns in the units of the regressors; recursions share nothing."""
        from scipy.linalg import block_diag

        return np.asarray(block_diag(*(recursion.covariance for recursion in self._recursions)))

    def _bounded(self) -> Array:
        """The unknowns of the first recursion that fit best under the bound that the damping is not negative.

        Least squares with covariance P has its constrained minimum at `theta - P[:, i] / P[i, i] theta[i]`.
        """
        theta, covariance = self._recursion.theta, self._recursion.covariance
        if not (theta[1] < 0.0 and covariance[1, 1] > 0.0):
            return theta
        return theta - covariance[:, 1] * float(theta[1] / covariance[1, 1])


@dataclass(frozen=True, slots=True)
class KelvinVoigtOptions:
    """Choices of `KelvinVoigtRLS`.

    Args:
        initial_covariance: P_0 = this times I, of (K, B) in N/m and N s/m and a force noise of 1 N: 10^10 lets a
            stiffness of 10^5 N/m be found at once.
        forgetting_factor: mu at each sample, above 0 and at most 1; 1 forgets nothing.
        robust: `weight_force` and `largest_rate` do nothing here: the target is a force, and nothing is divided by x.

    Raises:
        SettingError: A value out of range.
    """

    initial_covariance: float = 1e10
    forgetting_factor: float = 1.0
    robust: RobustOptions = field(default_factory=RobustOptions)

    def __post_init__(self) -> None:
        require("initial_covariance", self.initial_covariance, above=0.0)
        require("forgetting_factor", self.forgetting_factor, above=0.0, at_most=1.0)


class KelvinVoigtRLS(_LeastSquares):
    r"""Identifies (K, B) of equation (1), `F = K x + B v`, by recursive least squares on the force itself.

    Nothing is linearised, so this is exact; error is in newtons. Where the estimate of B is negative, as it is when
    the force lags behind the position, the law gets B = 0 and the K that fits best with it.

    `standard_errors` are those of independent errors of the force; the misfit of the law is not independent.

    Args:
        options: Its choices.
    """

    name: ClassVar[str] = "rls"
    model_name: ClassVar[str] = "kelvin-voigt"
    logarithms: ClassVar[bool] = False

    def __init__(self, options: KelvinVoigtOptions | None = None) -> None:
        self.options = KelvinVoigtOptions() if options is None else options
        super().__init__(self.options.robust, ((0.0, 0.0), self.options.initial_covariance))

    def _learn(self, sample: ContactSample) -> int:
        regressor = (sample.depth / self._depth_scale, sample.velocity / self._velocity_scale)
        return self._recursion.learn(regressor, sample.force, self.options.forgetting_factor)

    @property
    def covariance(self) -> Array | None:
        """Of stiffness [N/m] and damping [N s/m], shape (2, 2); None before it is known."""
        covariance = self._recursion.error_covariance
        return None if covariance is None else covariance / np.outer(self._robust.scales, self._robust.scales)

    @property
    def model(self) -> KelvinVoigt | None:
        """The law (1), None before 20 samples or while its stiffness is not positive."""
        if self.updates < FEWEST_UPDATES:
            return None
        stiffness, damping = (self._bounded() / self._robust.scales).tolist()
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


class HuntCrossleyLogRLS(_LeastSquares):
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
        ln_k, rate, exponent = self.options.initial_parameters
        depth_scale, velocity_scale = self.options.robust.scales
        first = (ln_k + exponent * math.log(depth_scale), rate * velocity_scale, exponent)
        super().__init__(self.options.robust, (first, self.options.initial_covariance))

    def _learn(self, sample: ContactSample) -> int:
        _, depth, velocity, force, _ = sample
        regressor = (1.0, velocity / self._velocity_scale, math.log(depth / self._depth_scale))
        weight = self._robust.weight(force)
        return self._recursion.learn(regressor, math.log(force), self.options.forgetting_factor, weight)

    @property
    def covariance(self) -> Array | None:
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
        level, rate, exponent = self._bounded().tolist()
        return level - exponent * math.log(self._depth_scale), rate / self._velocity_scale, exponent


LARGEST_EXPONENT = 10.0  # Exponents that stage 1 is computed with stay in -10 to 10: x^n neither overflows nor vanishes


@dataclass(frozen=True, slots=True)
class TwoStageOptions:
    """Choices of `HuntCrossleyTwoStage`.

    Args:
        initial_exponent: n that stage 1 begins with; 1.5 is Hertz's sphere.
        initial_covariance: P_0 of (k, lambda), a force noise of 1 N; 10^12 lets stiffnesses of 10^6 N/m^n be found.
        initial_exponent_covariance: P_0 of n; 1 lets it move by about 1 for an error of ln F of 1.
        forgetting_factor: mu of both stages at each sample, above 0 and at most 1. Below 1 by default: what stage 1
            has learnt with an old n is wrong, and must be forgotten for n to converge.
        robust: `weight_force` acts on stage 2; `largest_rate` does nothing, for nothing is divided by x.

    Raises:
        SettingError: A value out of range.
    """

    initial_exponent: float = 1.5
    initial_covariance: float = 1e12
    initial_exponent_covariance: float = 1.0
    forgetting_factor: float = 0.999
    robust: RobustOptions = field(default_factory=RobustOptions)

    def __post_init__(self) -> None:
        require("initial_exponent", self.initial_exponent, above=0.0, at_most=LARGEST_EXPONENT)
        require_fields(self, "initial_covariance", "initial_exponent_covariance", above=0.0)
        require("forgetting_factor", self.forgetting_factor, above=0.0, at_most=1.0)


class HuntCrossleyTwoStage(_LeastSquares):
    r"""Identifies (k, lambda, n) of equation (2) by two recursive least squares, each with the other's newest result.

    .. math::
        \text{stage 1, given } \hat n: &\quad F = k\, x^{\hat n} + \lambda\, x^{\hat n} \dot x \\
        \text{stage 2, given } \hat k, \hat\lambda: &\quad \ln\frac{F}{\hat k + \hat\lambda \dot x} = n \ln x

    Nothing is approximated, but error feeds back: an error of n makes stage 1 find a k that is wrong by about
    `x^(n - n_hat)` at the depths of the moment; stage 2 divides by it, and sees only what is left over the spread of
    ln x. Both then move together, slowly, along the line on which `k x^n` is the same: the force is right long before
    k and n are. It is worst where ln x is large against its own spread, as in metres (ln 0.01 = -4.6), or where the
    depth hardly changes; with `robust.scaled` ln x is that of x / 10 mm, and both converge within seconds.

    `standard_errors` is None: each stage's covariance takes the other's result as exact.

    Args:
        options: Its choices.

    References:
        Diolaiti, Melchiorri and Stramigioli (2005), Contact impedance estimation for robotic systems,
        IEEE Transactions on Robotics 21(5).
    """

    name: ClassVar[str] = "two-stage"
    model_name: ClassVar[str] = "hunt-crossley"

    def __init__(self, options: TwoStageOptions | None = None) -> None:
        self.options = TwoStageOptions() if options is None else options
        options = self.options
        exponent = ((options.initial_exponent,), options.initial_exponent_covariance)
        super().__init__(options.robust, ((0.0, 0.0), options.initial_covariance), exponent)
        self._exponents = self._recursions[1]

    def _learn(self, sample: ContactSample) -> int:
        """Stage 1, then stage 2."""
        _, depth, velocity, force, _ = sample
        factor = self.options.forgetting_factor
        log_depth, relative_velocity = math.log(depth / self._depth_scale), velocity / self._velocity_scale
        exponent = min(max(self._exponents.theta.item(), -LARGEST_EXPONENT), LARGEST_EXPONENT)
        spring = math.exp(min(exponent * log_depth, LARGEST_LOG))
        done = self._recursion.learn((spring, spring * relative_velocity), force, factor)
        stiffness, damping = self._bounded().tolist()
        at_unit_depth = stiffness + damping * relative_velocity
        if done != BROKEN and 0.0 < at_unit_depth < math.inf:  # else no logarithm: stage 2 waits
            target = math.log(force) - math.log(at_unit_depth)
            done = self._exponents.learn((log_depth,), target, factor, self._robust.weight(force))
        return done

    @property
    def model(self) -> HuntCrossley | None:
        """The law (2), None before 20 samples or while its stiffness or exponent is out of range."""
        if self.updates < FEWEST_UPDATES:
            return None
        exponent = self._exponents.theta.item()
        if not 0.0 < exponent <= LARGEST_EXPONENT:
            return None
        level, damping = self._bounded().tolist()
        unit = self._depth_scale**exponent
        stiffness, damping = level / unit, max(0.0, damping) / (unit * self._velocity_scale)
        if not (0.0 < stiffness < math.inf and damping < math.inf):
            return None
        return HuntCrossley(stiffness, damping, exponent)
