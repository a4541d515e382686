"""A contact law with memory: springs and slipping Maxwell branches that engage with depth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.models import ContactModel, ContactState

__all__ = ["Branch", "HystereticContact", "Spring"]

Array = NDArray[np.float64]

Spring = tuple[float, float, float]
"""One spring: start a [m], end b [m], force e [N] from b on."""

Branch = tuple[float, float, float, float, float]
"""One branch: start a [m], end b [m], stiffness k [N/m], slip force r [N], relaxation time tau [s]."""


@dataclass(frozen=True)
class HystereticContact(ContactModel):
    r"""Foam-like contact: elastic backbone, rate-independent hysteresis, relaxation, and a surface that lags.

    Every part engages along a ramp R(y; a, b) = clip((y - a) / (b - a), 0, 1) of the deflection y of the material's
    own surface. With bars for the mean over one step of h seconds from y' to y:

    .. math::
        F(y) &= \sum_i e_i R_i(y) + \sum_m \bar R_m \sigma_m \\
        \sigma_m &= \mathrm{clip}\Big(\frac{\sigma'_m + k_m \bar R_m (y - y')}{1 + h / \tau_m}, -r_m, r_m\Big)

    A branch is a Maxwell element (k, tau) that slips at r; with tau infinite it is a stop element
    (Prandtl-Ishlinskii, Maxwell slip), with r infinite a plain Maxwell element, with a short tau a damper of k tau
    that follows jumps of the velocity smoothly. It acts through the ramp as through a
    lever of varying ratio: what moves it is the area z under the ramp, and what it gives back is scaled alike.

    The probe at depth x only pushes: while F(x) >= 0 the surface is on the probe, y = x, and the force is F. If the
    probe retreats faster than the material recovers, F(x) < 0, the surface stays behind at the y > x with F(y) = 0
    and the force is zero until the probe meets it again.

    Passive by construction, for any path, step length and step size, in the sense that the work
    W = sum_k F_k (x_k - x_{k-1}) put in from the untouched state is never negative:

    1. Springs: e R is not decreasing, so its potential U is convex and F_k (y_k - y_{k-1}) >= U_k - U_{k-1}.
    2. Branches: the force R_bar sigma over y - y' does the work sigma (z - z'), and with the stored energy
       V = sigma^2 / 2k, which is convex, relaxing and clipping towards zero only lose:
       sigma (z - z') >= V - V'. The ramp neither stores nor makes energy.
    3. Loss of contact: x <= y always, and F > 0 is reported only with x_k = y_k, so that
       F (x_k - x_{k-1}) >= F (y_k - y_{k-1}): the probe never gets more than the material gives. Where zero is
       reported instead of F, the surface either stays, or falls while it still pushes, or is pushed in while it
       pulls: the material gives energy away and nobody gets it.

    U >= 0 and V >= 0, so W >= 0 at all times.

    The velocity of the call is not used: the law takes its own from successive depths, so that the two can never
    contradict each other.

    Args:
        springs: Elastic backbone; e > 0.
        branches: Hysteresis, damping and relaxation; k > 0, r > 0, tau > 0; infinite r and tau are allowed.

    Raises:
        SettingError: A start below 0 (the force could jump at the surface), an end not above its start, or a
            strength out of range.

    References:
        Maxwell-slip and stop elements: Visintin (1994), Differential Models of Hysteresis, Springer, chapter III.
        Foam regimes (elastic, plateau, densification): Gibson and Ashby (1997), Cellular Solids, chapter 5.
    """

    law: ClassVar[str] = "hysteretic-contact"
    parameter_names: ClassVar[tuple[str, ...]] = ()  # tables, not named numbers: it does not travel on the wire
    springs: tuple[Spring, ...]
    branches: tuple[Branch, ...] = ()

    def __post_init__(self) -> None:
        for name in ("springs", "branches"):
            for row in getattr(self, name):
                start, end, *strengths = row
                if not (0.0 <= start < end < math.inf):
                    raise SettingError(name, row, "must start at 0 or deeper and end deeper than that")
                positive = all(value > 0.0 for value in strengths)
                if not positive or math.isinf(strengths[0]):
                    raise SettingError(name, row, "strengths must be above 0, and the first one finite")

    def initial_state(self) -> ContactState:
        """Surface at rest and no branch loaded: (y, sigma_1, ..., sigma_m)."""
        return (0.0,) * (1 + len(self.branches))

    @cached_property
    def _compiled(self) -> tuple[Callable[..., Array], Array, int]:
        from foretouch.robot.materials.hysteretic_kernel import hysteretic_step  # Numba is slow to import: only when used

        rows = [(*spring, math.inf, math.inf) for spring in self.springs]
        return hysteretic_step, np.array([*rows, *self.branches], dtype=np.float64).reshape(-1, 5), len(rows)

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        """One step: see `foretouch.models.advance`. A depth that is not finite gives no force and moves nothing."""
        hysteretic_step, table, springs = self._compiled
        values = hysteretic_step(state, depth, sample_period, table, springs).tolist()
        force = values.pop()
        return tuple(values), force, math.nan
