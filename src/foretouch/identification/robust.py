"""What mends least squares on measured contact, each part on its own; all of it off by default."""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification.conditioning import ContactSample
from foretouch.identification.estimator import Status

__all__ = [
    "REFERENCE_DEPTH",
    "REFERENCE_VELOCITY",
    "SMALLEST_DEPTH",
    "SMALLEST_FORCE",
    "RobustOptions",
    "require_choice",
]

SMALLEST_FORCE = 1e-3
"""Forces below this [N] have no usable logarithm: the sensor's noise is larger."""

SMALLEST_DEPTH = 1e-5
"""Depths below this [m] have no usable logarithm: encoders do not resolve them."""

REFERENCE_DEPTH = 0.01
"""Depth [m] that scaled regressors are measured by."""

REFERENCE_VELOCITY = 0.05
"""Velocity [m/s] that scaled regressors are measured by."""


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
        require("gate_force", self.gate_force, at_least=0.0)
        require("gate_depth", self.gate_depth, at_least=0.0)
        for name in ("largest_rate", "weight_force", "covariance_limit"):
            value = getattr(self, name)
            if value is not None:
                require(name, value, above=0.0)

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
        share = force / self.weight_force
        return min(max(share * share, 1e-12), 1e12)

    def bounded_rate(self, velocity: float, depth: float) -> float:
        """Velocity over depth, v / x [1/s], within its bound."""
        rate = velocity / depth
        return rate if self.largest_rate is None else min(max(rate, -self.largest_rate), self.largest_rate)


def require_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    """Raise `SettingError` unless the value is one of the choices."""
    if value not in choices:
        raise SettingError(name, value, f"must be one of {', '.join(choices)}")
