"""What least squares on the linearised law (18) leave open: how they forget, and what mends them on measured contact.

Each part of what mends them stands on its own, and all of it is off by default.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from foretouch.core.records import Record
from foretouch.errors import SettingError
from foretouch.errors.checks import require, require_fields
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.estimator import Status
from foretouch.identification.linear.recovery import BINS_PER_DECADE, DECADES
from foretouch.identification.linear.recursion import ErrorUnit, PerturbationForm, PerturbationMoment

SMALLEST_FORCE = 1e-3  # Forces below this [N] have no usable logarithm: the sensor's noise is larger
SMALLEST_DEPTH = 1e-5  # Depths below this [m] have no usable logarithm: encoders do not resolve them
REFERENCE_DEPTH = 0.01  # Depth [m] that scaled regressors are measured by
REFERENCE_VELOCITY = 0.05  # Velocity [m/s] that scaled regressors are measured by


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustOptions:
    r"""Departures from the printed methods, all off by default.

    Args:
        gate_force: Samples with less force [N] are left out, 0 for no gate: near the surface the logarithm of a noisy
            force is mostly noise, and the error of the surface is largest against the depth.
        gate_depth: Samples at less depth [m] are left out, for the same reason.
        largest_rate: Bound [1/s] on the regressor v / x, None for none. In the first millimetre v / x is hundreds,
            and b2 would be learnt there alone.
        weight_force: Force [N] at which a sample of a logarithm has weight 1, None for equal weights. A force noise
            sigma gives ln F the variance (sigma / F)^2, so weights are (F / weight_force)^2: errors then count about
            as they do in newtons. A target that is a force itself has equal weights already, and this does nothing.
        scaled: Regressors are measured by 10 mm and 0.05 m/s, so that all are near 1 and one P_0 suits all unknowns;
            in metres they differ by a factor of 10^3 and more. `depth_unit` then has no effect.
        covariance_limit: Bound on the trace of P, None for none: where samples carry no news (a held position),
            forgetting stops at the bound instead of taking P to infinity, and a perturbation ends at it. P is that
            of the regressors in use, so a limit is for scaled ones.

    Raises:
        SettingError: A value out of range.
    """

    gate_force: float = 0.0
    gate_depth: float = 0.0
    largest_rate: float | None = None
    weight_force: float | None = None
    scaled: bool = False
    covariance_limit: float | None = None

    def __post_init__(self) -> None:
        require_fields(self, "gate_force", "gate_depth", at_least=0.0)
        for name in ("largest_rate", "weight_force", "covariance_limit"):
            value = getattr(self, name)
            if value is not None:
                require(name, value, above=0.0)

    @property
    def scales(self) -> tuple[float, float]:
        """Depth [m] and velocity [m/s] that regressors are measured by."""
        return (REFERENCE_DEPTH, REFERENCE_VELOCITY) if self.scaled else (1.0, 1.0)

    @property
    def trace_limit(self) -> float:
        """The bound on the trace of P, inf for none."""
        return math.inf if self.covariance_limit is None else self.covariance_limit

    def refuse(self, sample: ContactSample, *, logarithms: bool) -> Status | None:
        """Why a sample is not learnt from, None where it is.

        Args:
            sample: To be judged.
            logarithms: Whether the method takes logarithms of depth and force.
        """
        if not sample.in_contact:
            return Status.FREE_AIR
        smallest_depth, smallest_force = (SMALLEST_DEPTH, SMALLEST_FORCE) if logarithms else (0.0, -math.inf)
        _, depth, velocity, force, _ = sample
        if not (smallest_depth <= depth < math.inf and smallest_force <= force < math.inf and math.isfinite(velocity)):
            return Status.UNUSABLE
        shut = (self.gate_force > 0.0 and force < self.gate_force) or depth < self.gate_depth
        return Status.GATED if shut else None

    def weight(self, force: float) -> float:
        """Weight of the logarithm of a force [N]."""
        if self.weight_force is None:
            return 1.0
        weight = force / self.weight_force
        return min(max(weight * weight, 1e-12), 1e12)


Array = NDArray[np.float64]

LEARNT, FREE_AIR, UNUSABLE, GATED, RESTARTED, PERTURBED = range(6)
"""What was done with a sample; the last one learnt from it too."""

BINS = BINS_PER_DECADE * DECADES


class State(Record):
    """State of one recording."""

    numbers: Annotated[NDArray[Any], float, 16]  # theta; P's lower triangle; sums of squared residuals and of weights
    last_depth: float  # of the newest sample that was not refused [m], NaN after free air
    gain: float  # weight of a new sample in the histogram of depths; grows instead of shrinking all bins
    bins: Annotated[NDArray[Any], float, BINS]
    updates: int  # samples learnt from since the last restart
    restarts: int
    perturbations: int


class Packed(Record):
    """Options of one recording, in the units of the regressors."""

    log_scale: float  # ln of the depth that regressors are measured by
    velocity_factor: float  # what v is multiplied by
    rate_factor: float  # what v / x is multiplied by
    largest_rate: float  # [1/s], inf for none
    floor: float  # mu = floor + share exp(-rate dx)
    share: float
    rate: float
    gate_force: float  # [N]
    gate_depth: float  # [m]
    weight: float  # 1 / weight_force [1/N], 0 for equal weights
    sensitivity: float
    perturbation: float
    trace_limit: float
    first_theta: Annotated[NDArray[Any], float, 4]
    first_covariance: float
    newtons: bool
    before: bool
    resetting: bool


class Recording(Record):
    """What one call needs of a recording: a call with one array is quick."""

    state: State
    options: Packed


def full_covariance(triangle: Array) -> Array:
    """P of its lower triangle, shape (10, ...), row by row: shape (4, 4, ...)."""
    rows, columns = np.tril_indices(4)
    covariance = np.empty((4, 4, *triangle.shape[1:]))
    covariance[rows, columns] = covariance[columns, rows] = triangle
    return covariance


DepthUnit = Literal["m", "mm"]

CHOICES = {
    "depth_unit": get_args(DepthUnit),
    "perturbation_error": get_args(ErrorUnit),
    "perturbation_moment": get_args(PerturbationMoment),
    "perturbation_form": get_args(PerturbationForm),
}
"""What those of `FPRLSOptions` may be that are words."""


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
        require_fields(self, "perturbation", "sensitivity", "forgetting_rate", at_least=0.0)
        if len(self.initial_parameters) != 4:
            raise SettingError("initial_parameters", self.initial_parameters, "takes ln_k, s, b1, b2")
        for value in self.initial_parameters:
            require("initial_parameters", value)
        for name, choices in CHOICES.items():
            if getattr(self, name) not in choices:
                raise SettingError(name, getattr(self, name), f"must be one of {', '.join(choices)}")

    @property
    def scales(self) -> tuple[float, float]:
        """Depth [m] and velocity [m/s] that regressors are measured by."""
        return (1e-3, 1e-3) if self.depth_unit == "mm" and not self.robust.scaled else self.robust.scales


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


def pack(options: FPRLSOptions, forgetting: Forgetting, theta: Array) -> NDArray[np.void]:
    """The options as the kernel takes them, with theta_0 in the units of the regressors: an array of one `Packed`."""
    depth, velocity = options.scales
    robust = options.robust
    return Packed.new(
        **forgetting._asdict(),
        log_scale=math.log(depth),
        velocity_factor=1.0 / velocity,
        rate_factor=depth / velocity,
        largest_rate=math.inf if robust.largest_rate is None else robust.largest_rate,
        gate_force=robust.gate_force,
        gate_depth=robust.gate_depth,
        weight=0.0 if robust.weight_force is None else 1.0 / robust.weight_force,
        sensitivity=options.sensitivity,
        perturbation=options.perturbation,
        trace_limit=robust.trace_limit,
        first_theta=theta,
        first_covariance=options.initial_covariance,
        newtons=options.perturbation_error == "newton",
        before=options.perturbation_moment == "before",
        resetting=options.perturbation_form == "reset",
    )
