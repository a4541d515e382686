r"""Where the closed-form energy loss (12) ends: it is compared with the integrated impact.

In depths of x_M by (7) and speeds of v_i an impact depends on three numbers only: n, alpha and the damping ratio
:math:`\epsilon = \lambda v_i / (k x_M^\alpha)`,

.. math::
    \xi'' = -\tfrac12 (s + 1)\, \xi^n (\xi^\alpha + \epsilon \xi'), \qquad
    \frac{\Delta E}{\tfrac12 m v_i^2} \approx \tfrac43 h(\beta)\, \epsilon

so one number says how far (12) can be trusted, whatever the units. Its relative error grows in proportion to epsilon.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from foretouch.errors.checks import require
from foretouch.models.classic import ContinuousSwitching
from foretouch.reproduction.theory.energy_loss import energy_loss
from foretouch.reproduction.theory.impact import integrate_impact


@dataclass(frozen=True, slots=True)
class LowDampingError:
    """The closed form beside the integrated impact, in shares of the energy that comes in.

    Attributes:
        damping_ratio: epsilon [-].
        approximate_loss: Share of the energy lost by (12) [-]; above 1 it is absurd.
        loss: Share lost by integration [-].
        restitution: Speed out over speed in, by integration [-].
        relative_error: approximate_loss / loss - 1 [-].
    """

    damping_ratio: float
    approximate_loss: float
    loss: float
    restitution: float
    relative_error: float


def low_damping_error(
    exponent: float, switching: float, damping_ratio: float, *, allow_tension: bool = False
) -> LowDampingError:
    """How wrong (12) is at one damping ratio.

    Args:
        exponent: n [-], not negative.
        switching: alpha [-], not negative, not zero together with n.
        damping_ratio: epsilon [-], positive.
        allow_tension: True integrates the equation as printed, pulling at release, which is what (9) integrates.

    Raises:
        SettingError: A number out of range.
    """
    require("damping_ratio", damping_ratio, above=0.0)
    law = ContinuousSwitching(1.0, damping_ratio, exponent, switching)
    mass = 2.0 / (exponent + switching + 1.0)  # makes x_M = 1 at k = 1 and v_i = 1
    impact = integrate_impact(law, mass, 1.0, allow_tension=allow_tension, samples=2)
    energy = 0.5 * mass
    theory = float(energy_loss(law, mass, 1.0))
    # The damper's work, not the difference of two kinetic energies: that one has no digits left at small losses.
    loss = impact.damping_work if impact.separated else energy
    return LowDampingError(damping_ratio, theory / energy, loss / energy, impact.restitution, theory / loss - 1.0)


def low_damping_limit(exponent: float, switching: float, tolerance: float) -> LowDampingError:
    """The damping ratio at which (12) is wrong by a share, and what an impact there is like.

    Args:
        exponent: n [-], not negative.
        switching: alpha [-], not negative, not zero together with n.
        tolerance: Relative error of (12) [-], from 1e-4 to 1.

    Raises:
        SettingError: A number out of range.
    """
    from scipy.optimize import brentq

    require("tolerance", tolerance, at_least=1e-4, at_most=1.0)

    def beyond(log_ratio: float) -> float:
        return abs(low_damping_error(exponent, switching, math.exp(log_ratio)).relative_error) - tolerance

    return low_damping_error(exponent, switching, math.exp(brentq(beyond, math.log(1e-6), math.log(100.0), rtol=1e-8)))


def low_damping_table(
    cases: Sequence[tuple[float, float]] = ((1.5, 0.0), (1.0, 0.3), (0.7, 0.5), (0.2, 0.8), (0.0, 1.0)),
    tolerances: Sequence[float] = (0.01, 0.05, 0.1),
) -> str:
    """Lines of text: for each law the damping ratio at which (12) is wrong by each tolerance, and the rebound there.

    Args:
        cases: Pairs (n, alpha).
        tolerances: Relative errors.
    """
    lines = ["   n  alpha  (12) wrong by  damping ratio  restitution  loss by (12)  loss integrated"]
    for exponent, switching in cases:
        for tolerance in tolerances:
            row = low_damping_limit(exponent, switching, tolerance)
            lines.append(
                f"{exponent:4.1f} {switching:6.1f} {row.relative_error:+12.1%} {row.damping_ratio:14.4f} "
                f"{row.restitution:12.3f} {row.approximate_loss:13.2%} {row.loss:16.2%}"
            )
    return "\n".join(lines)
