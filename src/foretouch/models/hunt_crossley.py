"""The Hunt-Crossley law, equation (2) of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from foretouch.models.checks import require
from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState

__all__ = ["HuntCrossley"]


@dataclass(frozen=True, slots=True)
class HuntCrossley(ContactModel):
    r"""Power-law spring whose damping grows with depth.

    .. math:: F = \max(0,\; k x^n + \lambda x^n \dot x), \quad F = 0 \text{ for } x \le 0

    Args:
        stiffness: k [N/m^n], positive.
        damping: lambda [N s/m^(n+1)], not negative.
        exponent: n [-], positive.

    Raises:
        SettingError: A parameter out of range.

    References:
        Hunt and Crossley (1975), Coefficient of restitution interpreted as damping in vibroimpact,
        Journal of Applied Mechanics 42(2).
    """

    law: ClassVar[str] = "hunt-crossley"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping", "exponent")
    stiffness: float
    damping: float
    exponent: float

    def __post_init__(self) -> None:
        require("stiffness", self.stiffness, above=0.0)
        require("damping", self.damping, at_least=0.0)
        require("exponent", self.exponent, above=0.0)

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        """One step: see `foretouch.models.advance`."""
        if depth <= 0.0:
            return NO_STATE, 0.0, float("nan")
        force = depth**self.exponent * (self.stiffness + self.damping * velocity)
        return NO_STATE, max(0.0, force), float("nan")
