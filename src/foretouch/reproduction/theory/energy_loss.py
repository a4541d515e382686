r"""What an impact costs, in closed form: equations (6) to (14) of the paper.

A mass m meets the material at speed v_i and is thrown back. With little damping the loading is that of the spring
alone, by (6) without the dissipated part,

.. math::
    \tfrac12 m v_i^2 \approx \frac{k x_M^{s + 1}}{s + 1} \;(7), \qquad
    v \approx c \sqrt{x_M^{s + 1} - x^{s + 1}} \;(8), \qquad c = \sqrt{\frac{2 k}{m (s + 1)}}

and the damper takes, in and out again,

.. math::
    \Delta E \approx 2 \int_0^{x_M} \lambda x^n v \, dx \;(9) \;
    = \frac{B}{3} y_M^{3 - 2 \beta} h(\beta) \;(12) \; = K_0 v_i^\gamma \;(13)

with :math:`s = n + \alpha`, :math:`A = 2 \lambda c`, :math:`B = 2 A / (s + 1)`, :math:`y_M = x_M^{(s + 1) / 2}`,
:math:`\beta = \alpha / (s + 1)` and :math:`\gamma = 3 - 2 \beta` (14). As :math:`v_i = c \, y_M`,
:math:`K_0 = B h(\beta) / (3 c^\gamma)`. (The paper writes the upper limit of the first integral of (9) as M; x_M is
meant.) Not in the paper: the damping ratio

.. math:: \epsilon = \lambda v_i / (k x_M^\alpha)

is damper over spring at the speed of impact and the greatest depth; :math:`\Delta E / (\tfrac12 m v_i^2) =
\tfrac43 h(\beta) \epsilon`, and how wrong (12) is depends on n, alpha and epsilon alone
(`foretouch.reproduction.theory.impact`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.models.memoryless_law import MemorylessLaw
from foretouch.quantities import Array


def beta_of(exponent: ArrayLike, switching: ArrayLike) -> Array:
    r""":math:`\beta = \alpha / (n + \alpha + 1)` of (10) [-]: 0 for Hunt-Crossley, 0.5 for Kelvin-Voigt."""
    n, alpha = np.asarray(exponent, dtype=np.float64), np.asarray(switching, dtype=np.float64)
    return alpha / (n + alpha + 1.0)


def loss_exponent(exponent: ArrayLike, switching: ArrayLike) -> Array:
    r"""Exponent :math:`\gamma = 3 - 2 \beta` of speed in the energy loss, equation (14) [-].

    3 for Hunt-Crossley, 2 for Kelvin-Voigt, between them in the whole range (5); n and alpha as in `beta_of`.
    """
    return 3.0 - 2.0 * beta_of(exponent, switching)


def h_of(beta: ArrayLike) -> Array:
    r"""Hypergeometric factor :math:`h(\beta) = {}_2F_1(\beta, 3/2; 5/2; 1)` of (12) [-].

    Grows from h(0) = 1 to h(1/2) = 3 pi / 4 = 2.3562, which it reaches: the paper's bound [1, 2.5) holds and is not
    tight. beta is below 1, where the series diverges; the paper's range is [0, 0.5].
    """
    from scipy.special import hyp2f1

    return np.asarray(hyp2f1(np.asarray(beta, dtype=np.float64), 1.5, 2.5, 1.0), dtype=np.float64)[()]


def h_of_gamma_functions(beta: ArrayLike) -> Array:
    r"""The same factor by Gauss's theorem (Abramowitz and Stegun (1964), 15.1.20), for a cross-check.

    .. math:: h(\beta) = \frac{\Gamma(5/2)\, \Gamma(1 - \beta)}{\Gamma(5/2 - \beta)\, \Gamma(1)}
    """
    from scipy.special import gammaln

    b = np.asarray(beta, dtype=np.float64)
    return np.exp(gammaln(2.5) + gammaln(1.0 - b) - gammaln(2.5 - b))


def maximum_depth(law: MemorylessLaw, mass: float, speed: ArrayLike) -> Array:
    """Greatest depth x_M [m] of an impact by (7), which leaves out the damper: an upper bound.

    Mass m [kg] and speed v_i [m/s], a float or an array, must be positive: a SettingError, here and below.
    """
    k, _, n, alpha = law.general_form
    require("mass", mass, above=0.0)
    v = _speeds(speed)
    return (mass * (n + alpha + 1.0) * v**2 / (2.0 * k)) ** (1.0 / (n + alpha + 1.0))


def speed_at_depth(law: MemorylessLaw, mass: float, speed: float, depth: ArrayLike) -> Array:
    """Speed [m/s] at a depth [m] in loading, equation (8), and in unloading; NaN where the depth is not reached."""
    _, _, n, alpha = law.general_form
    power = n + alpha + 1.0
    reached = np.asarray(depth, dtype=np.float64) / maximum_depth(law, mass, speed)
    left = 1.0 - np.where((reached >= 0.0) & (reached <= 1.0), reached, np.nan) ** power
    return speed * np.sqrt(left)


def damping_ratio(law: MemorylessLaw, mass: float, speed: ArrayLike) -> Array:
    r"""Damper over spring :math:`\epsilon = \lambda v_i / (k x_M^\alpha)` [-]; equation (12) is its limit to zero."""
    k, damping, _, alpha = law.general_form
    return damping * _speeds(speed) / (k * maximum_depth(law, mass, speed) ** alpha)


def loss_scale(law: MemorylessLaw, mass: float) -> float:
    r"""Scale :math:`K_0 = \frac{4 \lambda h(\beta)}{3 (s + 1)} c^{1 - \gamma}` of (13) [J / (m/s)^gamma]."""
    k, damping, n, alpha = law.general_form
    require("mass", mass, above=0.0)
    s = n + alpha
    c = math.sqrt(2.0 * k / (mass * (s + 1.0)))
    gamma = float(loss_exponent(n, alpha))
    h = float(h_of(beta_of(n, alpha)))
    return 4.0 * damping * h / (3.0 * (s + 1.0)) * float(c ** (1.0 - gamma))


def energy_loss(law: MemorylessLaw, mass: float, speed: ArrayLike) -> Array:
    """Energy that an impact costs [J] by (12) in the form (13), the limit of low damping."""
    _, _, n, alpha = law.general_form
    return loss_scale(law, mass) * _speeds(speed) ** loss_exponent(n, alpha)


def energy_loss_by_quadrature(law: MemorylessLaw, mass: float, speed: float) -> float:
    """The same energy [J] by numerical quadrature of (9): it checks (10) to (12)."""
    from scipy.integrate import quad

    k, damping, n, alpha = law.general_form
    s = n + alpha
    deepest = float(maximum_depth(law, mass, speed))
    scale: float = 2.0 * damping * math.sqrt(2.0 * k / (mass * (s + 1.0)))  # A of (9)

    # As ratios to x_M the integral is of order 1, whatever the units make of the force.
    def integrand(fraction: float) -> float:
        return float(fraction**n * math.sqrt(1.0 - fraction ** (s + 1.0)))

    integral = quad(integrand, 0.0, 1.0, epsabs=0.0, epsrel=1e-11, limit=200)[0]
    return float(scale * deepest ** (n + 1.0 + (s + 1.0) / 2.0) * integral)


def _speeds(speed: ArrayLike) -> Array:
    """Speeds of impact as an array; a SettingError names the first that is not positive and finite."""
    v = np.asarray(speed, dtype=np.float64)
    good = np.isfinite(v) & (v > 0.0)
    if not good.all():
        raise SettingError("speed", float(v[~good].flat[0]), "must be finite and above 0, in m/s")
    return v
