"""A law that is linear in its unknowns: what is learnt at many places at once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from foretouch.errors.checks import require
from foretouch.models.contact_model import NO_STATE, SPEED_STEP, ContactModel, ContactState
from foretouch.models.way_out import way_out

__all__ = ["QuadraticContact"]


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
