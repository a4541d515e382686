"""What all least squares on the linearised law (18) share: options, regressors, model, recovered law."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.identification.conditioning import ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.recovery import DepthSummary, Recovered, recover
from foretouch.identification.recursion import (
    BROKEN,
    PERTURBED,
    ErrorUnit,
    PerturbationForm,
    PerturbationMoment,
    Recursion,
    error_along,
)
from foretouch.identification.robust import REFERENCE_DEPTH, REFERENCE_VELOCITY, RobustOptions, require_choice
from foretouch.models import LinearisedContinuousSwitching
from foretouch.models.checks import require

__all__ = ["FPRLSOptions", "LinearisedEstimator"]

Array = NDArray[np.float64]

FEWEST_UPDATES = 20
"""No force is rendered from fewer samples; the paper's simulations settle at the 20th."""

DepthUnit = Literal["m", "mm"]


@dataclass(frozen=True, slots=True)
class FPRLSOptions:
    r"""What the paper prints, and what it leaves open; the defaults are (20) as printed, in SI units.

    Args:
        initial_covariance: P_0 = this times I; the paper names 10^6. I is that of the unknowns in `depth_unit`.
        perturbation: delta, added to the diagonal of P when the self-perturbing test trips; the paper's 10^6.
            0 switches the test off.
        sensitivity: kappa of the test `kappa e^2 >= 1`; the paper's 1.
        forgetting_rate: rho [1/m] of `mu = 0.95 + 0.05 exp(-rho |dx|)`. The paper gives no value. At its 10 Hz a hand
            moves millimetres between samples, so 1000 / m (one per millimetre) lets mu work in the middle of its
            range there. See `FPRLS` for what that forgets.
        initial_parameters: theta_0 = (ln k, s, b1, b2), depth in metres whatever `depth_unit`; the paper gives none,
            and 0 (a force of 1 N at every depth) favours nothing.
        depth_unit: Unit of depth in the regressors, `m` or `mm`; velocity then is in m/s or mm/s. The paper gives its
            depths in mm and its stiffness in N/m. The unit changes what P_0 and delta mean (an uncertainty of ln k at
            1 m or at 1 mm, and b1 per m/s or per mm/s), so the path of the estimates, not what they converge to.
            Results are always in metres: ln k = ln k_mm + s ln 1000, b1 = 1000 b1_mm.
        perturbation_error: What the test sees as e: the innovation of ln F (`log`), as the equation defines it, which
            trips when force and estimate differ by a factor of e; or the difference of the forces (`newton`), as the
            text says (1 N).
        perturbation_moment: `after`: P is enlarged after the gain of the sample that trips the test, as (20) prints
            it, so the next sample is the first to profit. `before`: the sample itself is learnt with the enlarged P.
        perturbation_form: `add`: delta I is added to P, as printed. `reset`: P becomes delta I, as the text says ("will
            return back to be big which is set initially").
        robust: Departures from the printed method, off by default.

    Raises:
        SettingError: A value out of range.
    """

    initial_covariance: float = 1e6
    perturbation: float = 1e6
    sensitivity: float = 1.0
    forgetting_rate: float = 1000.0
    initial_parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    depth_unit: DepthUnit = "m"
    perturbation_error: ErrorUnit = "log"
    perturbation_moment: PerturbationMoment = "after"
    perturbation_form: PerturbationForm = "add"
    robust: RobustOptions = field(default_factory=RobustOptions)

    def __post_init__(self) -> None:
        require("initial_covariance", self.initial_covariance, above=0.0)
        require("perturbation", self.perturbation, at_least=0.0)
        require("sensitivity", self.sensitivity, at_least=0.0)
        require("forgetting_rate", self.forgetting_rate, at_least=0.0)
        if len(self.initial_parameters) != 4:
            raise SettingError("initial_parameters", self.initial_parameters, "takes ln_k, s, b1, b2")
        for value in self.initial_parameters:
            require("initial_parameters", value)
        require_choice("depth_unit", self.depth_unit, ("m", "mm"))
        require_choice("perturbation_error", self.perturbation_error, ("log", "newton"))
        require_choice("perturbation_moment", self.perturbation_moment, ("after", "before"))
        require_choice("perturbation_form", self.perturbation_form, ("add", "reset"))

    @property
    def scales(self) -> tuple[float, float]:
        """Depth [m] and velocity [m/s] that regressors are measured by."""
        if self.robust.scaled:
            return REFERENCE_DEPTH, REFERENCE_VELOCITY
        return (1.0, 1.0) if self.depth_unit == "m" else (1e-3, 1e-3)


class LinearisedEstimator(Estimator):
    r"""Least squares on (18), `ln F = ln k + s ln x + b1 v + b2 v / x`; the leaves say how old samples are forgotten.

    Samples with a depth or a force too small for a logarithm are left out (the paper does not say what it does with
    them). A covariance that overflows or loses positive definiteness, which the printed equations allow, is set back
    to P_0, and theta to theta_0, and the update says so.

    `parameters` has ln_k, s, b1, b2 and the law (4) that they stand for: stiffness, damping, exponent, switching, where
    they are determined (`foretouch.identification.recovery`).

    Args:
        options: The choices that the paper leaves open.
    """

    model_name: ClassVar[str] = "continuous-switching"
    errors_mean_something: ClassVar[bool] = False

    def __init__(self, options: FPRLSOptions) -> None:
        self.options = options
        depth, velocity = options.scales
        # theta in metres is this matrix times theta of the regressors in use
        self._to_metres = np.diag([1.0, 1.0, 1.0 / velocity, depth / velocity])
        self._to_metres[0, 1] = -math.log(depth)
        self._recursion = Recursion(
            np.linalg.solve(self._to_metres, np.array(options.initial_parameters)),
            options.initial_covariance,
            sensitivity=options.sensitivity,
            perturbation=options.perturbation,
            error_unit=options.perturbation_error,
            moment=options.perturbation_moment,
            form=options.perturbation_form,
            trace_limit=options.robust.trace_limit,
        )
        self._depths = DepthSummary()
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._recursion.reset()
        self._depths.reset()
        self._last_depth = math.nan
        self.updates = 0

    @abstractmethod
    def forgetting_factor(self, depth_change: float) -> float:
        """Mu of a sample whose depth differs by so much [m] from that of the one before."""

    def update(self, sample: ContactSample) -> Status:
        """One step; see `Estimator.update`."""
        robust = self.options.robust
        refusal = robust.refuse(sample, logarithms=True)
        if refusal is not None:
            if refusal is Status.FREE_AIR:
                self._last_depth = math.nan
            return refusal
        _, depth, velocity, force, _ = sample
        factor = self.forgetting_factor(0.0 if math.isnan(self._last_depth) else depth - self._last_depth)
        self._last_depth = depth
        weight = robust.weight(force)
        depth_scale, velocity_scale = self.options.scales
        regressor = (
            1.0,
            math.log(depth / depth_scale),
            velocity / velocity_scale,
            robust.bounded_rate(velocity, depth) * (depth_scale / velocity_scale),
        )
        done = self._recursion.learn(regressor, math.log(force), factor, weight)
        if done == BROKEN:
            self.reset()
            return Status.RESTARTED
        if done == PERTURBED:
            self._depths.reset()
        self._depths.add(depth, velocity, factor, weight)
        self.updates += 1
        return Status.LEARNT

    @property
    def linear_parameters(self) -> tuple[float, float, float, float]:
        """(ln k, s, b1, b2) as they are now, depth in metres; theta_0 before the first sample."""
        return self._linear()

    @property
    def unscaled_covariance(self) -> Array:
        """A copy of P, shape (4, 4), of the unknowns in the units of the regressors."""
        return self._recursion.covariance.copy()

    @property
    def model(self) -> LinearisedContinuousSwitching | None:
        """The law (18), None before 20 samples or while a parameter is not finite."""
        values = self._linear()
        if self.updates < FEWEST_UPDATES or not all(map(math.isfinite, values)):
            return None
        return LinearisedContinuousSwitching(*values)

    @property
    def parameters(self) -> dict[str, float | None]:
        """ln_k, s, b1, b2, then stiffness, damping, exponent, switching; see `Estimator.parameters`."""
        model = self.model
        if model is None:
            return {}
        linear = dict(zip(model.parameter_names, model.parameters, strict=True))
        return {**linear, **recover(self._linear(), self._covariance(), self._depths)._asdict()}

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """By name, None where the estimator has none to give.

        Those of the recovered law follow from the change of each by the four linear numbers.
        """
        model, covariance = self.model, self._covariance()
        if not self.errors_mean_something or model is None or covariance is None:
            return None
        errors: dict[str, float | None] = dict(
            zip(model.parameter_names, np.sqrt(np.maximum(0.0, np.diag(covariance))).tolist(), strict=True)
        )
        return errors | self._recovered_errors(covariance)

    def _recovered_errors(self, covariance: Array) -> dict[str, float | None]:
        centre = np.array(self._linear())
        steps = 1e-3 * np.sqrt(np.maximum(0.0, np.diag(covariance)))
        middle = recover(self._linear(), covariance, self._depths)
        moved = [
            [recover(_tuple(centre + sign * side), covariance, self._depths) for sign in (1.0, -1.0)]
            for side in np.diag(steps)
        ]
        errors: dict[str, float | None] = {}
        for name in Recovered._fields:
            ends = [[getattr(one, name) for one in pair] for pair in moved]
            if getattr(middle, name) is None or not steps.all() or any(None in pair for pair in ends):
                errors[name] = None
                continue
            slope = np.array([pair[0] - pair[1] for pair in ends]) / (2.0 * steps)
            errors[name] = error_along(slope, covariance)
        return errors

    def _linear(self) -> tuple[float, float, float, float]:
        """Theta in metres."""
        return _tuple(self._to_metres @ self._recursion.theta)

    def _covariance(self) -> Array | None:
        """Covariance of theta in metres by the residuals; only an indication where forgetting or perturbation act."""
        covariance = self._recursion.error_covariance
        return None if covariance is None else self._to_metres @ covariance @ self._to_metres.T


def _tuple(values: Array) -> tuple[float, float, float, float]:
    ln_k, s, b1, b2 = values.tolist()
    return ln_k, s, b1, b2
