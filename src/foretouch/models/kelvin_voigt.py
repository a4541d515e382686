"""The Kelvin-Voigt law, equation (1) of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from foretouch.errors.checks import require
from foretouch.models.memoryless_law import MemorylessLaw

__all__ = ["KelvinVoigt"]


@dataclass(frozen=True, slots=True)
class KelvinVoigt(MemorylessLaw):
    r"""Linear spring and linear damper in parallel: (4) with n = 0 and alpha = 1.

    .. math:: F = \max(0,\; K x + B \dot x), \quad F = 0 \text{ for } x \le 0

    Equation (1) lets the force turn negative at release, where the material would pull the probe; here the force
    is never negative, unless a method is asked for it. The force jumps to B times the speed at first touch.

    Args:
        stiffness: K [N/m], positive.
        damping: B [N s/m], not negative.

    Raises:
        SettingError: A parameter out of range.
    """

    law: ClassVar[str] = "kelvin-voigt"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping")
    stiffness: float
    damping: float

    def __post_init__(self) -> None:
        require("stiffness", self.stiffness, above=0.0)
        require("damping", self.damping, at_least=0.0)

    @property
    def general_form(self) -> tuple[float, float, float, float]:
        """The same law as numbers of (4): K, B, 0, 1."""
        return self.stiffness, self.damping, 0.0, 1.0
