"""The continuous switching law, equation (4) of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.models.memoryless_law import MemorylessLaw

__all__ = ["ContinuousSwitching"]


@dataclass(frozen=True, slots=True)
class ContinuousSwitching(MemorylessLaw):
    r"""One law from Hunt-Crossley (alpha = 0) to Kelvin-Voigt (n = 0, alpha = 1).

    .. math:: F = \max(0,\; k x^{n + \alpha} + \lambda x^n \dot x), \quad F = 0 \text{ for } x \le 0

    The paper's range (5) is 1 <= n + alpha < 2 and 0 <= alpha <= 1. Numbers outside it make a law as well, as long
    as the force is zero at rest on the surface; `validity` says what they break. Where n > 0 there is no force at
    first touch; where alpha > 0 the equation pulls at release (`tension_depth`), here held at zero.

    Args:
        stiffness: k [N/m^(n + alpha)], positive.
        damping: lambda [N s/m^(n+1)], not negative.
        exponent: n [-], not negative.
        switching: alpha [-], not negative, and not zero together with n.

    Raises:
        SettingError: A parameter out of range.

    References:
        The paper, equations (4) and (5).
    """

    law: ClassVar[str] = "continuous-switching"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping", "exponent", "switching")
    stiffness: float
    damping: float
    exponent: float
    switching: float

    def __post_init__(self) -> None:
        require("stiffness", self.stiffness, above=0.0)
        require("damping", self.damping, at_least=0.0)
        require("exponent", self.exponent, at_least=0.0)
        require("switching", self.switching, at_least=0.0)
        if self.exponent + self.switching == 0.0:
            raise SettingError("switching", self.switching, "must be above 0 where exponent is 0: force needs depth")

    @property
    def general_form(self) -> tuple[float, float, float, float]:
        """The parameters themselves: k, lambda, n, alpha."""
        return self.stiffness, self.damping, self.exponent, self.switching
