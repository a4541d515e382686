"""Contact laws that only simulated materials have: in layers, with fading memory, with hysteresis.

Three layers in series on a stiff base each stiffen and relax on their own; a nonlinear elastic response relaxes in
part; springs and slipping Maxwell branches engage with depth.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.models import ContactModel, ContactState
from foretouch.models.contact_model import LARGEST_DEPTH, Advanced

Layer = tuple[float, float, float, float]
"""One layer: thickness h [m], force p that halves it [N], relaxing fraction g [-], relaxation time tau [s]."""


@dataclass(frozen=True)
class LayeredContact(ContactModel):
    r"""Three layers that are squeezed by the same force, one after the other, down to a stiff base.

    Each layer has an elastic response that grows without bound as the layer becomes thin, and a part of it relaxes:

    .. math::
        E_l(y_l) = \frac{p_l y_l}{h_l - y_l}, \quad F = E_l(y_l) - g_l o_l, \quad
        \dot o_l = \frac{E_l(y_l) - o_l}{\tau_l}, \quad x = \frac{F}{K} + \sum_l y_l

    so that a layer's tangent stiffness rises from p/h by the factor (1 + E/p)^2, the soft layers lock first, and in
    the end the base K is felt. All layers bear F, and y_l = h_l u / (p_l + u) with u = F + g_l o_l: the depth is an
    increasing, concave function of F, and Newton's method finds F.

    The probe at depth x only pushes: where the free layers (F = 0) reach deeper than the probe, it meets nothing.

    Passive by construction, for any path, step length and step size, by the argument of `RelaxingContact`, which holds
    for each layer: every o moves towards the E of the deflection before, which only loses; then the layers move with
    o held, and F (y_l after - y_l before) is at least what layer l stores more, since its store is convex with
    the slope F. The sum over the layers and the base is F times the way of the surface, and the probe is never
    deeper than the surface.

    The velocity of the call is not used. The state is (F, g_1 o_1, g_2 o_2, g_3 o_3).

    Args:
        layers: Layers from the surface down; h, p and tau above 0, g from 0 to below 1.
        base_stiffness: K [N/m], above 0.

    Raises:
        SettingError: A number out of range.
    """

    law: ClassVar[str] = "layered-contact"
    layers: tuple[Layer, Layer, Layer]
    base_stiffness: float

    def __post_init__(self) -> None:
        require("base_stiffness", self.base_stiffness, above=0.0)
        if len(self.layers) != 3:
            raise SettingError("layers", self.layers, "must be three: skin, fat and muscle, say")
        for row in self.layers:
            thickness, halving, fraction, time = row
            if not (all(0.0 < value < math.inf for value in (thickness, halving, time)) and 0.0 <= fraction < 1.0):
                raise SettingError("layers", row, "h, p and tau must be above 0, and g from 0 to below 1")

    def initial_state(self) -> ContactState:
        """No force, nothing relaxed."""
        return (0.0, 0.0, 0.0, 0.0)

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air."""
        layered_step, table = self._compiled
        after = layered_step(state, min(depth, LARGEST_DEPTH), sample_period, 1.0 / self.base_stiffness, table)
        return after, after[0], math.nan

    @cached_property
    def _compiled(self) -> tuple[Callable[..., ContactState], NDArray[np.float64]]:
        from foretouch.robot.materials.kernels import layered_step  # Numba is slow to import: only when used

        return layered_step, np.array(self.layers, dtype=np.float64)


Relaxation = tuple[float, float]
"""One part of the memory: fraction g of the response [-], relaxation time tau [s]."""


def check_relaxation(relaxation: tuple[Relaxation, ...]) -> None:
    """Refuse fractions and times that no relaxation has."""
    for row in relaxation:
        if not (row[0] > 0.0 and 0.0 < row[1] < math.inf):
            raise SettingError("relaxation", row, "fractions and times must be above 0")
    if not sum(fraction for fraction, _ in relaxation) < 1.0:
        raise SettingError("relaxation", relaxation, "the fractions must be below 1 together")


USUAL_PERIOD = 5e-4  # of the arm's physics [s]: what it needs of exponentials is kept
SMALLEST_RATIO = 1e-6  # of stress to flow force: below it sinh(z) / z is 1
LARGEST_RATIO = 50.0  # beyond it a part has flowed within any step


class ElasticResponse(ABC):
    """Force of a material that is deflected and has no time to relax. Leaves are frozen dataclasses."""

    __slots__ = ()

    @abstractmethod
    def force(self, deflection: float) -> float:
        """E(y) [N] at a deflection y [m] from 0 to 1: 0 at 0, finite, strictly increasing."""


@dataclass(frozen=True)
class RelaxingContact(ContactModel):
    r"""Elastic response less what of it has relaxed; the surface comes back late and is never pulled.

    With y the deflection of the material's own surface and E its elastic response,

    .. math::
        F = E(y) - \sum_i g_i o_i, \quad \dot o_i = \frac{E(y) - o_i}{\tau_i} \cdot \frac{\sinh z_i}{z_i}, \quad
        z_i = \frac{E(y) - o_i}{s}, \quad \sum_i g_i < 1

    Without flow (s infinite, the last factor is 1) this is Fung's quasi-linear viscoelasticity

    .. math::
        F(t) = \int_0^t G(t - t') \frac{\mathrm d E(y(t'))}{\mathrm d t'} \mathrm d t', \quad
        G(t) = 1 - \sum_i g_i (1 - e^{-t / \tau_i})

    a Prony series on a nonlinear response. With a finite flow force s the parts flow by Eyring's law of thermally
    activated slip: hysteresis that hardly depends on the rate (as its logarithm) where they are loaded beyond s, and
    linear relaxation below.

    The probe at depth x only pushes. While E(x) is at least m = sum g o, the surface is on the probe, y = x. Else it
    is free, where F = 0, that is E(y) = m: deeper than the probe, coming back as the memory fades.

    Passive by construction, for any path, step length and step size, in the sense that the work
    W = sum_k F_k (x_k - x_{k-1}) put in from the untouched state is never negative. Each part stores

    .. math:: V_i(y, o) = \int_{y_o}^{y} (E(r) - o) \,\mathrm d r \ge 0, \quad E(y_o) = o

    and the rest of the response (1 - sum g) times the integral of E, which is V with o = 0.

    1. A step first lets every o move towards E of the deflection before, by a fraction from 0 to 1. dV/do = y_o - y:
       that only loses.
    2. Then the surface moves with o held. V is convex in y, because E increases, and sum g V has the slope F there:
       F_k (y_k - y_{k-1}) is at least what is stored more.
    3. x <= y always, and F > 0 only with x_k = y_k, so that F_k (x_k - x_{k-1}) >= F_k (y_k - y_{k-1}).

    V >= 0, so W >= 0 at all times. A depth of 0 or less gives no force: E(0) = 0, and no o is ever negative.

    The velocity of the call is not used. The state is (E(y), g_1 o_1, ..., g_n o_n); of a free surface, E(y) is m.

    Args:
        elastic: E.
        relaxation: g above 0, together below 1, and tau above 0.
        flow_force: s [N], above 0; infinite for linear relaxation.

    Raises:
        SettingError: A number out of range.

    References:
        Fung (1993), Biomechanics: Mechanical Properties of Living Tissues, 2nd edition, chapter 7.
        Eyring (1936), Viscosity, plasticity, and diffusion as examples of absolute reaction rates, Journal of
        Chemical Physics 4.
    """

    law: ClassVar[str] = "relaxing-contact"
    elastic: ElasticResponse
    relaxation: tuple[Relaxation, ...]
    flow_force: float = math.inf

    def __post_init__(self) -> None:
        check_relaxation(self.relaxation)
        if not self.flow_force > 0.0:
            raise SettingError("flow_force", self.flow_force, "must be above 0")

    def initial_state(self) -> ContactState:
        """Not deflected, nothing relaxed."""
        return (0.0,) * (1 + len(self.relaxation))

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air."""
        stress, *parts = state
        if self.flow_force == math.inf:
            rates = self._rates if sample_period == USUAL_PERIOD else self._rates_at(sample_period)
            parts = [keep * part + take * stress for part, (keep, take) in zip(parts, rates, strict=True)]
        else:
            parts = [
                self._flow(part, fraction, stress, sample_period / time)
                for part, (fraction, time) in zip(parts, self.relaxation, strict=True)
            ]
        memory = sum(parts)
        after = memory  # of a free surface
        if depth > 0.0:
            after = max(memory, self.elastic.force(depth if depth < LARGEST_DEPTH else LARGEST_DEPTH))
        return (after, *parts), after - memory, math.nan

    def _flow(self, part: float, share: float, stress: float, time: float) -> float:
        """G o of one part [N] after a time [tau] of flow at a stress [N]."""
        gap = share * stress - part
        ratio = abs(gap) / (share * self.flow_force)
        if ratio > LARGEST_RATIO:
            ratio = LARGEST_RATIO
        if ratio > SMALLEST_RATIO:
            time *= math.sinh(ratio) / ratio
        return part - gap * math.expm1(-time)

    @cached_property
    def _rates(self) -> list[tuple[float, float]]:
        return self._rates_at(USUAL_PERIOD)

    def _rates_at(self, h: float) -> list[tuple[float, float]]:
        """For each part of linear relaxation, the fractions kept after h seconds and taken from the stress."""
        return [(math.exp(-h / time), -fraction * math.expm1(-h / time)) for fraction, time in self.relaxation]


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
       pulls: the material loses energy that the probe does not get.

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
        from foretouch.robot.materials.kernels import hysteretic_step  # Numba is slow to import: only when used

        rows = [(*spring, math.inf, math.inf) for spring in self.springs]
        return hysteretic_step, np.array([*rows, *self.branches], dtype=np.float64).reshape(-1, 5), len(rows)

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`. A depth that is not finite gives no force and moves nothing."""
        hysteretic_step, table, springs = self._compiled
        values = hysteretic_step(state, depth, sample_period, table, springs).tolist()
        force = values.pop()
        return tuple(values), force, math.nan
