"""Laws of materials without memory: the one force formula of (1) to (4), and those that are learnt.

The formula stands once for one sample and once for arrays; loops have it compiled. Two more laws stand beside those of
the paper: the continuous switching law as the paper identifies and renders it, equation (18), and one that is linear in
its unknowns, to be learnt at many places at once.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors.checks import require, require_fields
from foretouch.models.contact_model import NO_STATE, Advanced, ContactModel, ContactState

Array = NDArray[np.float64]

Numbers = tuple[float, ...]
General = tuple[float, float, float, float]


class MemorylessLaw(ContactModel):
    r"""A law of depth and velocity alone; each of the paper's is a case of equation (4).

    .. math:: F = \max\left(0,\; x^n (k x^\alpha + \lambda \dot x)\right), \quad F = 0 \text{ for } x \le 0

    (at x = 0 itself the paper's Kelvin-Voigt law gives B times the velocity, here 0). What is vectorised takes floats
    or arrays that broadcast, and returns an array of the shape that they broadcast to (a NumPy float for floats).
    It knows no bounds: depths and velocities are taken as they are, and NaN stays NaN. `advance` has the same
    formula, in scalar arithmetic for the loop.

    Energies are those of a spring and a damper in parallel: what the spring holds comes back, what the damper takes
    does not. Where the force is held at zero (see `tension_depth`) the material comes back by itself, more slowly
    than the probe, and what its spring still gives up goes into its own damper.
    """

    __slots__ = ()
    positive: ClassVar[tuple[str, ...]] = ()
    """Parameters that are above zero; the others are not below."""

    def __post_init__(self) -> None:
        require_fields(self, *self.positive, above=0.0)
        require_fields(self, *(name for name in self.parameter_names if name not in self.positive), at_least=0.0)

    @staticmethod
    @abstractmethod
    def in_general(numbers: Numbers) -> General:
        """The same law as numbers of (4), of its parameters."""

    @property
    def general_form(self) -> General:
        """The same law as numbers of (4): k [N/m^(n + alpha)], lambda [N s/m^(n+1)], n [-], alpha [-]."""
        return self.in_general(self.parameters)

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`."""
        if depth <= 0.0:
            return NO_STATE, 0.0, math.nan
        k, damping, n, alpha = self.general_form
        force = depth**n * (k * depth**alpha + damping * velocity)
        return NO_STATE, force if force > 0.0 else 0.0, math.nan

    def force(self, depth: ArrayLike, velocity: ArrayLike, *, allow_tension: bool = False) -> Array:
        """Force [N], equation (4).

        Args:
            depth: x [m].
            velocity: [m/s], positive while deepening.
            allow_tension: True leaves negative forces as the equation gives them: the material pulls the probe.
        """
        k, damping, n, alpha = self.general_form
        x, v = np.asarray(depth, dtype=np.float64), np.asarray(velocity, dtype=np.float64)
        inside = np.maximum(x, 0.0)
        force = np.where(x <= 0.0, 0.0, inside**n * (k * inside**alpha + damping * v))
        return _plain(force if allow_tension else np.maximum(force, 0.0))

    def stored_energy(self, depth: ArrayLike) -> Array:
        r"""Energy in the spring [J].

        .. math:: E_{store} = k x^{s + 1} / (s + 1), \quad s = n + \alpha

        Args:
            depth: x [m]; outside 0 J.
        """
        k, _, n, alpha = self.general_form
        s = n + alpha
        return _plain(k * np.maximum(np.asarray(depth, dtype=np.float64), 0.0) ** (s + 1.0) / (s + 1.0))

    def dissipated_power(self, depth: ArrayLike, velocity: ArrayLike, *, allow_tension: bool = False) -> Array:
        r"""Power that does not come back [W], never negative: all power less what goes into the spring.

        .. math:: P_{diss} = (F - k x^s) \dot x

        which is :math:`\lambda x^n \dot x^2` unless the force is held at zero.

        Args:
            depth: x [m].
            velocity: [m/s].
            allow_tension: As in `force`.
        """
        elastic = self.force(depth, 0.0)
        damper = self.force(depth, velocity, allow_tension=allow_tension) - elastic
        return _plain(damper * np.asarray(velocity, dtype=np.float64))

    def tension_depth(self, velocity: ArrayLike) -> Array:
        r"""Depth [m] below which the equation pulls, at a velocity.

        .. math:: x_0 = (\lambda |\dot x| / k)^{1 / \alpha}, \quad \dot x < 0

        For Kelvin-Voigt that is :math:`B |\dot x| / K`; for every alpha above 0 it is above 0 at any release. For
        Hunt-Crossley (alpha = 0) it is 0 up to the speed :math:`k / \lambda`, and infinite beyond. `advance` and the
        other methods hold the force at zero there: a hand that lets go is not to be held back.

        Args:
            velocity: [m/s]; nothing pulls while it is positive.
        """
        k, damping, _, alpha = self.general_form
        ratio = damping * np.maximum(-np.asarray(velocity, dtype=np.float64), 0.0) / k
        if alpha == 0.0:
            return _plain(np.where(ratio > 1.0, np.inf, 0.0 * ratio))
        with np.errstate(over="ignore"):
            return _plain(ratio ** (1.0 / alpha))

    def validity(self) -> tuple[str, ...]:
        """Sentences that say which parts of the paper's range (5) the numbers break; empty where they keep to it."""
        _, _, n, alpha = self.general_form
        s, broken = n + alpha, []
        if not 1.0 <= s < 2.0:
            broken.append(f"the exponent of depth s = n + alpha = {s:.6g} is outside [1, 2) of the paper's range (5)")
        if not 0.0 <= alpha <= 1.0:
            broken.append(f"the switching alpha = {alpha:.6g} is outside [0, 1] of the paper's range (5)")
        return tuple(broken)


def _plain(values: Array) -> Array:
    """An array as it is; without dimensions, its number."""
    number_or_array: Array = np.asarray(values)[()]
    return number_or_array


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

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`."""
        if depth <= 0.0:
            return NO_STATE, 0.0, float("nan")
        x = max(depth, SMALLEST_DEPTH)
        log_force = self.ln_k + self.s * math.log(x) + self.b1 * velocity + self.b2 * velocity / x
        return NO_STATE, math.exp(min(log_force, LARGEST_LOG_FORCE)) * (depth / x), float("nan")
