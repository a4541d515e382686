r"""The exact law (4) in unknowns of like size.

With a reference depth x0 and the reference speed v0 = x0 / T0,

.. math:: F = F_0 u^s + D u^n w, \quad u = x / x_0, \quad w = \dot x / v_0, \quad n = s - \alpha

F0 = k x0^s is the elastic force at the reference depth, and D = lambda x0^n v0 the damping force at reference depth
and speed: both are forces of the size of those measured, whatever the units of depth, and s and alpha are bounded by
equation (5). Kelvin-Voigt (1) is s = alpha = 1, Hunt-Crossley (2) is alpha = 0.

All estimators that do not linearise the law share these. The recursive one has a fifth unknown, the height of the true
surface above the given one in x0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.models import ContactModel, ContinuousSwitching, HuntCrossley, KelvinVoigt

UNKNOWNS = 5

REFERENCE_TIME = 0.1  # T0 [s]: hands press and release in tenths of a second
LARGEST_S = 2.0 - 1e-6  # Equation (5) wants s below 2


@dataclass(frozen=True, slots=True)
class ExactLaw:
    """One member of the family (4).

    Attributes:
        name: As on the command line.
        s_bounds: Smallest and largest s; equal where the law fixes it.
        alpha_bounds: Smallest and largest alpha; equal where the law fixes it.
    """

    name: str
    s_bounds: tuple[float, float]
    alpha_bounds: tuple[float, float]

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Of the law's own parameters."""
        names = ("stiffness", "damping", "exponent", "switching")
        return names[: 2 + (self.s_bounds[0] < self.s_bounds[1]) + (self.alpha_bounds[0] < self.alpha_bounds[1])]

    def model(self, elastic: float, viscous: float, s: float, alpha: float, depth: float) -> ContactModel:
        """The law with its own parameters.

        Args:
            elastic: F0 [N].
            viscous: D [N].
            s: Exponent of the elastic force [-].
            alpha: Switching [-].
            depth: Reference depth x0 [m].

        Raises:
            SettingError: Numbers so extreme that a parameter leaves its range.
        """
        n = s - alpha
        stiffness, damping = elastic * depth**-s, viscous * depth ** -(n + 1.0) * REFERENCE_TIME
        if self.name == "kelvin-voigt":
            return KelvinVoigt(stiffness, damping)
        if self.name == "hunt-crossley":
            return HuntCrossley(stiffness, damping, n)
        return ContinuousSwitching(stiffness, damping, n, alpha)

    def sensitivities(self, elastic: float, viscous: float, s: float, alpha: float, depth: float) -> list[list[float]]:
        """Derivatives of the law's own parameters (rows) by F0, D, s, alpha (columns), for the delta method."""
        log_depth, n = math.log(depth), s - alpha
        per_elastic, per_viscous = depth**-s, depth ** -(n + 1.0) * REFERENCE_TIME
        rows = [
            [per_elastic, 0.0, -elastic * per_elastic * log_depth, 0.0],
            [0.0, per_viscous, -viscous * per_viscous * log_depth, viscous * per_viscous * log_depth],
            [0.0, 0.0, 1.0, -1.0],
            [0.0, 0.0, 0.0, 1.0],
        ]
        return rows[: len(self.parameter_names)]


EXACT_LAWS: dict[str, ExactLaw] = {
    law.name: law
    for law in (
        ExactLaw("continuous-switching", (1.0, LARGEST_S), (0.0, 1.0)),
        ExactLaw("kelvin-voigt", (1.0, 1.0), (1.0, 1.0)),
        ExactLaw("hunt-crossley", (1.0, LARGEST_S), (0.0, 0.0)),
    )
}
