"""A contact law of three layers in series, each with its own stiffening and relaxation, on a stiff base."""

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
from foretouch.models.checks import require
from foretouch.models.contact_model import LARGEST_DEPTH

__all__ = ["Layer", "LayeredContact"]

Layer = tuple[float, float, float, float]
"""One layer: thickness h [m], force p that halves it [N], relaxing share g [-], relaxation time tau [s]."""


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
        layers: From the surface down; h, p and tau above 0, g from 0 to below 1.
        base_stiffness: K [N/m], above 0.

    Raises:
        SettingError: A number out of range.
    """

    law: ClassVar[str] = "layered-contact"
    parameter_names: ClassVar[tuple[str, ...]] = ()  # it does not travel on the wire
    layers: tuple[Layer, Layer, Layer]
    base_stiffness: float

    def __post_init__(self) -> None:
        require("base_stiffness", self.base_stiffness, above=0.0)
        if len(self.layers) != 3:
            raise SettingError("layers", self.layers, "must be three: skin, fat and muscle, say")
        for row in self.layers:
            thickness, halving, share, time = row
            if not (all(0.0 < value < math.inf for value in (thickness, halving, time)) and 0.0 <= share < 1.0):
                raise SettingError("layers", row, "h, p and tau must be above 0, and g from 0 to below 1")

    def initial_state(self) -> ContactState:
        """No force, nothing relaxed."""
        return (0.0, 0.0, 0.0, 0.0)

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air."""
        layered_step, table = self._compiled
        after = layered_step(state, min(depth, LARGEST_DEPTH), sample_period, 1.0 / self.base_stiffness, table)
        return after, after[0], math.nan

    @cached_property
    def _compiled(self) -> tuple[Callable[..., ContactState], NDArray[np.float64]]:
        from foretouch.robot.materials.layered_kernel import layered_step  # Numba is slow to import: only when used

        return layered_step, np.array(self.layers, dtype=np.float64)
