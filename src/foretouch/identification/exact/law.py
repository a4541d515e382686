r"""The exact law (4) in unknowns of like size, and where the exact recursive estimator keeps its numbers.

With a reference depth x0 and the reference speed v0 = x0 / T0,

.. math:: F = F_0 u^s + D u^n w, \quad u = x / x_0, \quad w = \dot x / v_0, \quad n = s - \alpha

F0 = k x0^s is the elastic force at the reference depth, and D = lambda x0^n v0 the damping force at reference depth
and speed: both are forces of the size of those measured, whatever the units of depth, and s and alpha are bounded by
equation (5). Kelvin-Voigt (1) is s = alpha = 1, Hunt-Crossley (2) is alpha = 0.

All estimators that do not linearise the law share these. The recursive one has a fifth unknown, the height of the true
surface above the given one in shares of x0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.errors import UnknownNameError
from foretouch.models import ContactModel, ContinuousSwitching, HuntCrossley, KelvinVoigt

UNKNOWNS = 5

REFERENCE = 0  # x0 [m], 0 before the first sample
LARGEST_REFERENCE = 1  # the largest so far [m]
LAST_TIME = 2  # of the newest moving sample [s]
ANCHOR_DEPTH, ANCHOR_TIME = 3, 4  # where and when movement was last seen [m], [s]
COUNT = 5  # moving samples, at most the noise memory
MOVING_TIME = 6  # [s]
LOG_DEPTH = 7  # running mean of ln x
POWER = 8  # running mean of F^2 [N^2]
CONSTANT_NOISE = 9  # variance of the force that does not grow with it [N^2]
SHARE_NOISE = 10  # variance of the force in shares of its square
MOMENTS = 11  # five weighted means: 1, F^2, F^4, r^2, r^2 F^2
PRODUCT, SQUARE, LAST_RESIDUAL = 16, 17, 18  # of successive normalised residuals
ALARM = 19  # mean of the last squared normalised innovations
PAUSE = 20  # samples for which no change can be called
EXCESS = 21  # the same mean over a longer time
LEARNT_FROM = 22  # samples since the beginning
LOG_REFERENCE = 23  # ln x0
SLOPE, PROJECTED, GAIN = 24, 29, 34  # scratch of one step: H, P H' and K
MEMORY_SIZE = 39

THETA, COVARIANCE, NOTES = 0, UNKNOWNS, UNKNOWNS + UNKNOWNS * UNKNOWNS
STATE_SIZE = NOTES + MEMORY_SIZE
"""One array holds the unknowns, their covariance and the memory, in this order: a call with one array is quick."""

SETTINGS: tuple[str, ...] = (
    "strength_prior",
    "strength_prior",
    "s_prior",
    "alpha_prior",
    "surface_prior",
    "s_lower",
    "s_upper",
    "alpha_lower",
    "alpha_upper",
    "drift",
    "least_noise",
    "first_noise",
    "largest_noise",
    "ignorance_time",
    "noise_memory",
    "correlation_time",
    "first_correlation_time",
    "clip",
    "gate",
    "hold_time",
    "hold_share",
    "surface_noise",
    "reference_time",
)
"""Their order in the array of settings."""

S_LOWER, ALPHA_LOWER = SETTINGS.index("s_lower"), SETTINGS.index("alpha_lower")
DRIFT = SETTINGS.index("drift")
LEAST_NOISE, FIRST_NOISE = SETTINGS.index("least_noise"), SETTINGS.index("first_noise")
LARGEST_NOISE, IGNORANCE_TIME = SETTINGS.index("largest_noise"), SETTINGS.index("ignorance_time")
NOISE_MEMORY = SETTINGS.index("noise_memory")
CORRELATION_TIME, FIRST_CORRELATION_TIME = (
    SETTINGS.index("correlation_time"),
    SETTINGS.index("first_correlation_time"),
)
CLIP, GATE = SETTINGS.index("clip"), SETTINGS.index("gate")
HOLD_TIME, HOLD_SHARE = SETTINGS.index("hold_time"), SETTINGS.index("hold_share")
SURFACE_NOISE, REFERENCE_TIME_AT = SETTINGS.index("surface_noise"), SETTINGS.index("reference_time")


REFERENCE_TIME = 0.1
"""T0 [s]: hands press and release in tenths of a second."""

LARGEST_S = 2.0 - 1e-6
"""Equation (5) wants s below 2."""


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


def exact_law(name: str) -> ExactLaw:
    """The member of the family with this name.

    Raises:
        UnknownNameError: No such law here.
    """
    if name not in EXACT_LAWS:
        raise UnknownNameError("exact law", name, EXACT_LAWS)
    return EXACT_LAWS[name]
