"""What all least squares on the linearised law (18) leave open, and how they forget."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification.fprls_layout import OPTIONS_SIZE
from foretouch.identification.recursion import ErrorUnit, PerturbationForm, PerturbationMoment
from foretouch.identification.robust import REFERENCE_DEPTH, REFERENCE_VELOCITY, RobustOptions, require_choice

__all__ = ["NOTHING_FORGOTTEN", "DepthUnit", "FPRLSOptions", "Forgetting", "pack"]

Array = NDArray[np.float64]

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


class Forgetting(NamedTuple):
    r"""How old samples are forgotten, :math:`\mu = f + g e^{-\rho |\Delta x|}`.

    Attributes:
        floor: f.
        share: g; f + g is above 0 and at most 1.
        rate: rho [1/m].
    """

    floor: float = 1.0
    share: float = 0.0
    rate: float = 0.0

    def factor(self, depth_change: float) -> float:
        """Mu after this change of depth [m]."""
        return self.floor + self.share * math.exp(-self.rate * abs(depth_change))


NOTHING_FORGOTTEN = Forgetting()


def pack(options: FPRLSOptions, forgetting: Forgetting, theta: Array) -> Array:
    """The options as the kernel takes them, in its order."""
    depth, velocity = options.scales
    robust = options.robust
    packed = np.array(
        [
            math.log(depth),
            1.0 / velocity,
            depth / velocity,
            math.inf if robust.largest_rate is None else robust.largest_rate,
            *forgetting,
            robust.gate_force,
            robust.gate_depth,
            0.0 if robust.weight_force is None else 1.0 / robust.weight_force,
            options.sensitivity,
            options.perturbation,
            options.perturbation_error == "newton",
            options.perturbation_moment == "before",
            options.perturbation_form == "reset",
            robust.trace_limit,
            *theta,
            options.initial_covariance,
        ],
        np.float64,
    )
    assert packed.size == OPTIONS_SIZE
    return packed
