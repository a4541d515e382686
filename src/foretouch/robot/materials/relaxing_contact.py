"""A contact law with fading memory: a nonlinear elastic response of which a part relaxes."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from foretouch.errors import SettingError
from foretouch.models import ContactModel, ContactState
from foretouch.models.contact_model import LARGEST_DEPTH

__all__ = ["ElasticResponse", "Relaxation", "RelaxingContact"]

Relaxation = tuple[float, float]
"""One part of the memory: share g of the response [-], relaxation time tau [s]."""

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
    parameter_names: ClassVar[tuple[str, ...]] = ()  # it does not travel on the wire
    elastic: ElasticResponse
    relaxation: tuple[Relaxation, ...]
    flow_force: float = math.inf

    def __post_init__(self) -> None:
        for row in self.relaxation:
            if not (row[0] > 0.0 and 0.0 < row[1] < math.inf):
                raise SettingError("relaxation", row, "shares and times must be above 0")
        if not sum(share for share, _ in self.relaxation) < 1.0:
            raise SettingError("relaxation", self.relaxation, "the shares must be below 1 together")
        if not self.flow_force > 0.0:
            raise SettingError("flow_force", self.flow_force, "must be above 0")

    def initial_state(self) -> ContactState:
        """Not deflected, nothing relaxed."""
        return (0.0,) * (1 + len(self.relaxation))

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air."""
        stress, *parts = state
        if self.flow_force == math.inf:
            rates = self._rates if sample_period == USUAL_PERIOD else self._rates_at(sample_period)
            parts = [keep * part + take * stress for part, (keep, take) in zip(parts, rates, strict=True)]
        else:
            parts = [
                self._flow(part, share, stress, sample_period / time)
                for part, (share, time) in zip(parts, self.relaxation, strict=True)
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
        """Of each part of linear relaxation: what it keeps in h seconds, and what it takes from the stress."""
        return [(math.exp(-h / time), -share * math.expm1(-h / time)) for share, time in self.relaxation]
