"""The Hunt-Crossley law, equation (2) of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from foretouch.errors.checks import require
from foretouch.models.memoryless_law import MemorylessLaw

__all__ = ["HuntCrossley"]


@dataclass(frozen=True, slots=True)
class HuntCrossley(MemorylessLaw):
    r"""Power-law spring whose damping grows with depth: (4) with alpha = 0.

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

    @property
    def general_form(self) -> tuple[float, float, float, float]:
        """The same law as numbers of (4): k, lambda, n, 0."""
        return self.stiffness, self.damping, self.exponent, 0.0
