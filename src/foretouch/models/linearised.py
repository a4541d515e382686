"""The continuous switching law as the paper identifies and renders it: equation (18)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from foretouch.errors.checks import require
from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState
from foretouch.models.way_out import way_out

__all__ = ["LARGEST_LOG_FORCE", "SMALLEST_DEPTH", "LinearisedContinuousSwitching"]

SMALLEST_DEPTH = 3e-4
"""Depth [m] below which (18) is replaced by a straight line to zero: its term b2 v / x has no bound as x goes to 0.
The paper says nothing about small depths; at a guard of 10 um simulations with the law diverged, at 0.3 mm not."""

LARGEST_LOG_FORCE = math.log(1e6)
"""Bound on ln F: an estimate that has diverged then still gives a finite, absurd force, and the report shows it."""


@dataclass(frozen=True, slots=True)
class LinearisedContinuousSwitching(ContactModel):
    r"""Continuous switching law, linearised by a logarithm.

    .. math:: \ln F = \ln k + s \ln x + b_1 \dot x + b_2 \dot x / x

    Below x0 = 0.3 mm the force is F(x0) x / x0, so that it is continuous and zero at the surface (departure from the
    paper, which leaves small depths open); ln F is bounded by ln(10^6 N).

    Args:
        ln_k: ln k, k in N/m^s with depth in metres.
        s: Exponent of depth [-].
        b1: [s/m].
        b2: [s].

    Raises:
        SettingError: A parameter that is not finite.

    References:
        The paper, equation (18).
    """

    law: ClassVar[str] = "linearised-continuous-switching"
    parameter_names: ClassVar[tuple[str, ...]] = ("ln_k", "s", "b1", "b2")
    ln_k: float
    s: float
    b1: float
    b2: float

    def __post_init__(self) -> None:
        for name in self.parameter_names:
            require(name, getattr(self, name))

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        """One step: see `foretouch.models.advance`."""
        if depth <= 0.0:
            return NO_STATE, 0.0, float("nan")
        x = max(depth, SMALLEST_DEPTH)
        log_force = self.ln_k + self.s * math.log(x) + self.b1 * velocity + self.b2 * velocity / x
        return NO_STATE, math.exp(min(log_force, LARGEST_LOG_FORCE)) * (depth / x), float("nan")

    def exit_work(
        self, state: ContactState, depth: float, offset: float = 0.0, largest: float = math.inf
    ) -> tuple[float, float]:
        """See `ContactModel.exit_work`."""

        def force_at(depth: float) -> float:
            x = depth if depth > SMALLEST_DEPTH else SMALLEST_DEPTH
            log_force = self.ln_k + self.s * math.log(x)
            return math.exp(log_force if log_force < LARGEST_LOG_FORCE else LARGEST_LOG_FORCE) * (depth / x)

        return way_out(force_at, depth, offset, largest)
