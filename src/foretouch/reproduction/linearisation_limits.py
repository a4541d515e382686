"""How far the two steps of the linearisation reach: (16) in phi, and (17) in depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.models import ContinuousSwitching
from foretouch.reproduction.claims import Claim
from foretouch.reproduction.section import Table
from foretouch.reproduction.theory import TABLE_1, fit_polynomial, linearisation_error, taylor_error_depth

__all__ = [
    "CONDITION",
    "NOTICED",
    "claims_of_phi",
    "claims_of_polynomial",
    "phi_range",
    "scaled_error",
    "taylor_table",
]

NOTICED = 0.1
"""Relative error of force that a hand begins to notice [-]."""

CONDITION = 0.1
"""The paper's bound of phi."""

Array = NDArray[np.float64]


def _law(switching: float) -> ContinuousSwitching:
    """A law of k = lambda, so that its velocity is phi."""
    return ContinuousSwitching(1.0, 1.0, 1.4 - switching, switching)


def phi_range(switching: float, depth: float, tolerance: float) -> tuple[float, float]:
    """Phi at release and while deepening [m^alpha] at which the step to (16) alone is wrong by a share.

    Args:
        switching: alpha [-].
        depth: [m].
        tolerance: Relative error of force [-].
    """
    from scipy.optimize import brentq

    law = _law(switching)

    def beyond(phi: float) -> float:
        error = linearisation_error(law, 1.0, 0.0, depth, phi)
        return float(error.taylor / error.force) - tolerance

    pulls = depth**switching
    release = brentq(beyond, -pulls * (1.0 - 1e-9), -1e-9 * pulls)
    return float(release), float(brentq(beyond, 1e-9 * pulls, 10.0 * pulls))


def scaled_error(switching: float, deepest: float) -> tuple[float, float]:
    """Error of x^(2 - alpha) by a1 x^2 + a2 x over depths up to one [m]: in shares of the largest, and relative at 5 %.

    The second is that of 1/x^alpha at a twentieth of the greatest depth.
    """
    share = np.linspace(0.0, 1.0, 2001)[1:]
    depth = deepest * share
    fit = fit_polynomial(switching, depth, depth_power=2.0)
    exact = depth ** (2.0 - switching)
    whole = float(np.abs(fit.a1 * depth**2 + fit.a2 * depth - exact).max() / exact.max())
    near = 0.05 * deepest
    return whole, float((fit.a1 + fit.a2 / near) * near**switching - 1.0)


def claims_of_phi(largest: float) -> tuple[Claim, ...]:
    """Whether the paper's bound of phi is conservative.

    Args:
        largest: Greatest phi of the paper's own runs.
    """
    ends = {alpha: phi_range(alpha, 0.020, NOTICED) for alpha in (0.0, *TABLE_1)}
    at_bound = {alpha: [100.0 * _taylor_error(alpha, 0.020, phi) for phi in (-CONDITION, CONDITION)] for alpha in ends}
    said = {
        alpha: f"{release:+.1f} % and {into:+.1f} % at phi = -0.1 and 0.1; {100.0 * NOTICED:.0f} % at phi = "
        f"{ends[alpha][0]:.3f} and {ends[alpha][1]:.3f}"
        for alpha, (release, into) in at_bound.items()
    }
    depths = {alpha: taylor_error_depth(_law(alpha), -CONDITION, NOTICED) for alpha in TABLE_1}
    wide = min(abs(end) for end in ends[0.0]) > CONDITION
    narrow = min(abs(end) for alpha in TABLE_1 for end in ends[alpha]) < CONDITION
    return (
        Claim(
            "||phi|| < 0.1 is conservative, for Hunt-Crossley",
            "rather conservative in many cases",
            said[0.0],
            "holds under stated choice" if wide else "does not hold",
            "choice: alpha = 0, where phi is damper over spring and has no unit; error of force by (16), any depth",
        ),
        Claim(
            "||phi|| < 0.1 is conservative, for the continuous switching law of Table 1",
            "rather conservative in many cases",
            "; ".join(
                f"alpha = {alpha:g}: {said[alpha]}; under 10 % up to 0.1 only beyond {1e3 * depths[alpha]:.0f} mm"
                for alpha in TABLE_1
            ),
            "does not hold" if narrow else "holds",
            f"error of force by (16) at 20 mm; the paper's own runs stay below phi = {largest:.4f} and do not test it",
        ),
    )


def _taylor_error(switching: float, depth: float, phi: float) -> float:
    """Relative error of force by (16) [-]."""
    error = linearisation_error(_law(switching), 1.0, 0.0, depth, phi)
    return float(error.taylor / error.force)


def claims_of_polynomial() -> tuple[Claim, ...]:
    """How good (17) is, whether small depths help, and its two limiting cases."""
    small = {alpha: scaled_error(alpha, 0.040) for alpha in TABLE_1}
    large = {alpha: scaled_error(alpha, 40.0) for alpha in TABLE_1}
    same = max(abs(a - b) for alpha in TABLE_1 for a, b in zip(small[alpha], large[alpha], strict=True))
    depth = np.linspace(0.5e-3, 40e-3, 400)
    fits = {
        (alpha, power): fit_polynomial(alpha, depth, depth_power=power) for alpha in (0.0, 1.0) for power in (0, 1, 2)
    }
    off = max(max(abs(fit.a1 - (1.0 - alpha)), abs(fit.a2 - alpha)) for (alpha, _), fit in fits.items())
    between = [fit_polynomial(alpha, depth) for alpha in np.linspace(0.1, 0.9, 9)]
    return (
        Claim(
            "(17): x^(2 - alpha) is a1 x^2 + a2 x",
            "approximately",
            "; ".join(
                f"alpha = {alpha:g}: within {100.0 * whole:.1f} % of the largest value, but 1/x^alpha wrong by "
                f"{100.0 * near:+.0f} % at a twentieth of the depth"
                for alpha, (whole, near) in small.items()
            ),
            "holds under stated choice" if max(whole for whole, _ in small.values()) < 0.05 else "does not hold",
            "choice: measured in shares of the largest value; least squares over depths to 40 mm, evenly spaced",
        ),
        Claim(
            "(17) is good if the value of x is small",
            "x small",
            f"relative errors over depths to 40 mm and to 40 m are equal to {same:.1g}",
            "does not hold" if same < 1e-6 else "holds",
            "only the ratio of greatest to smallest depth matters; fits as in the row above",
        ),
        Claim(
            "a1 = 0 is Kelvin-Voigt (alpha = 1), a2 = 0 is Hunt-Crossley (alpha = 0)",
            "limiting cases",
            f"fits at alpha = 0 and 1 within {off:.1g} of (1, 0) and (0, 1); both positive at alpha = 0.1 to 0.9",
            "holds" if off < 1e-9 and min(min(fit.a1, fit.a2) for fit in between) > 0.0 else "does not hold",
            "least squares of (17) in three forms over 0.5 to 40 mm; between the ends the spring keeps its exponent s, "
            "so the Kelvin-Voigt part is one only where s = 1",
        ),
    )


def taylor_table() -> Table:
    """Relative error of force by (16) at 20 mm over phi [-], for Hunt-Crossley and the alphas of Table 1."""
    phi = np.concatenate([-np.geomspace(0.5, 1e-3, 200), np.geomspace(1e-3, 0.5, 200)])
    columns = {f"relative_error_alpha_{alpha:g}": _taylor_curve(alpha, phi) for alpha in (0.0, *TABLE_1)}
    return {"phi": phi, **columns}


def _taylor_curve(switching: float, phi: Array) -> Array:
    """Relative error of force by (16) at 20 mm over phi; NaN where (15) has no value."""
    error = linearisation_error(_law(switching), 1.0, 0.0, 0.020, phi)
    return error.taylor / error.force
