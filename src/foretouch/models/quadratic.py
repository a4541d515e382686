"""The continuous switching law as the paper identifies and renders it: equation (18).

A law that is linear in its unknowns: what is learnt at many places at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from foretouch.errors.checks import require
from foretouch.models.contact_model import NO_STATE, SPEED_STEP, ContactModel, ContactState
from foretouch.models.memoryless_law import way_out

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


@dataclass(frozen=True, slots=True)
class QuadraticContact(ContactModel):
    r"""Spring that stiffens with depth, and damping that grows with depth.

    .. math:: F = \max(0,\; a x + b x^2 + c\, x \dot x), \quad F = 0 \text{ for } x \le 0

    The damping is that of Hunt and Crossley at exponent 1; b lets the exponent of depth be anything between 1 and 2
    over the depths that are pressed. Linear in a, b and c, so that least squares finds them and laws of neighbouring
    places can be blended. All three may be 0, which is a place without material.

    Args:
        stiffness: a [N/m], not negative.
        stiffening: b [N/m^2], not negative.
        damping: c [N s/m^2], not negative.

    Raises:
        SettingError: A parameter out of range.
    """

    law: ClassVar[str] = "quadratic"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "stiffening", "damping")
    stiffness: float
    stiffening: float
    damping: float

    def __post_init__(self) -> None:
        for name in self.parameter_names:
            require(name, getattr(self, name), at_least=0.0)

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        """One step: see `foretouch.models.advance`."""
        if depth <= 0.0:
            return NO_STATE, 0.0, math.nan
        force = depth * (self.stiffness + self.stiffening * depth + self.damping * velocity)
        return NO_STATE, force if force > 0.0 else 0.0, math.nan

    def exit_work(
        self, state: ContactState, depth: float, offset: float = 0.0, largest: float = math.inf
    ) -> tuple[float, float]:
        """See `ContactModel.exit_work`."""
        spring, stiffening = self.stiffness, self.stiffening
        return way_out(lambda x: x * (spring + stiffening * x), depth, offset, largest)

    def local_slopes(self, state: ContactState, depth: float, velocity: float, reach: float) -> tuple[float, float]:
        r"""See `ContactModel.local_slopes`; in closed form where the force is nowhere held at zero.

        .. math:: K = \max_\pm |a + b (2 x \pm h) + c \dot x|, \quad B = c x
        """
        free = depth > reach and self.stiffness + self.damping * (velocity - SPEED_STEP) > 0.0
        if not free:
            return ContactModel.local_slopes(self, state, depth, velocity, reach)
        middle = self.stiffness + 2.0 * self.stiffening * depth + self.damping * velocity
        return middle + self.stiffening * reach, self.damping * depth
