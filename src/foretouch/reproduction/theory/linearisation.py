r"""The linearised law and what it leaves out: equations (15) to (18) of the paper.

.. math::
    \ln F &= \ln k + n \ln x + \ln(x^\alpha + \varphi), \quad \varphi = \lambda \dot x / k && (15) \\
    &\approx \ln k + s \ln x + \varphi / x^\alpha && (16) \\
    1 / x^\alpha &\approx a_1 + a_2 / x && (17) \\
    \ln F &\approx \ln k + s \ln x + b_1 \dot x + b_2 \dot x / x, \quad b_i = a_i \lambda / k && (18)

With :math:`\psi = \varphi / x^\alpha`, damper over spring, the step to (16) costs exactly
:math:`\psi - \ln(1 + \psi) \approx \psi^2 / 2` in ln F, and the step to (18)
:math:`\varphi (a_1 + a_2 / x - x^{-\alpha})`.
So it is psi that must be small, not phi as the paper has it (:math:`|\varphi| < 0.1`): for alpha above 0 and any
velocity psi grows without bound towards the surface, and at release (15) ends altogether where psi reaches -1, which is
where the law begins to pull (`MemorylessLaw.tension_depth`). Nor is (17) any good outside the depths that it was
fitted over: its a2 / x grows faster than what it replaces.

ln F, ln k, a1 and a2 are for depths in metres, here and in the paper's Table 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.models.memoryless_law import LinearisedContinuousSwitching, MemorylessLaw
from foretouch.quantities import Array, Brief

TABLE_1: dict[float, tuple[float, float]] = {0.3: (2.35, 0.016), 0.5: (3.44, 0.067)}
"""The paper's Table 1: alpha to (a1 [m^-alpha], a2 [m^(1 - alpha)]).

Either pair is a least-squares fit of (17) over depths of some millimetres to 30 or 40 mm (with ``depth_power=1`` along
a sine: 3.35 to 32.2 mm, and 3.79 to 39.7 mm), but no one fit gives both: their lines cross x^-alpha at 9 and 28 mm
(0.3) and at 11 and 35 mm (0.5), while fits of the same depths cross deeper for 0.3 than for 0.5. One setting comes
within 5.5 % of all four numbers at best, with 2.285, 0.0169 and 3.623, 0.0634: 6.5 to 39.8 mm along a sine,
``depth_power=0``."""


@dataclass(frozen=True, slots=True)
class PolynomialFit:
    """The replacement (17) over a range of depths."""

    switching: float  # alpha [-]
    a1: float  # [m^-alpha]
    a2: float  # [m^(1 - alpha)]
    shallowest: float  # smallest depth fitted [m]
    deepest: float  # greatest depth fitted [m]
    largest_relative_error: float  # error of a1 + a2 / x against x^-alpha, at the depths fitted [-]


@dataclass(frozen=True, eq=False)
class LinearisationError(Brief):
    """Force of (18) less force of (15), and which step of the linearisation that is from; NaN where (15) has none."""

    force: Array  # exact force (15) [N]
    total: Array  # force of (18) less exact force [N]; `taylor` and `polynomial` add up to it
    taylor: Array  # force of (16) less exact force [N], never negative: (16) is always too large
    polynomial: Array  # force of (18) less force of (16) [N]
    relative: Array  # total / force [-]
    phi: Array  # lambda v / k [m^alpha], which the paper wants below 0.1
    psi: Array  # phi / x^alpha [-], which decides


def log_force(law: MemorylessLaw, depth: ArrayLike, velocity: ArrayLike) -> Array:
    """Logarithm of the exact force (15) [ln N] at depth [m] and velocity [m/s]; NaN outside and where the law pulls."""
    k, _, n, alpha = law.general_form
    x = _inside(depth)
    ratio = 1.0 + _psi(law, x, velocity)
    return math.log(k) + (n + alpha) * np.log(x) + np.log(np.where(ratio > 0.0, ratio, np.nan))


def taylor_log_force(law: MemorylessLaw, depth: ArrayLike, velocity: ArrayLike) -> Array:
    """Logarithm of the force with the Taylor expansion (16) [ln N], as `log_force`; NaN outside."""
    k, _, n, alpha = law.general_form
    x = _inside(depth)
    return math.log(k) + (n + alpha) * np.log(x) + _psi(law, x, velocity)


def linearised_log_force(law: MemorylessLaw, a1: float, a2: float, depth: ArrayLike, velocity: ArrayLike) -> Array:
    """Logarithm of the force by (18), as `log_force` [ln N]; unlike `LinearisedContinuousSwitching` without a guard."""
    model = linearise(law, a1, a2)
    x, v = _inside(depth), np.asarray(velocity, dtype=np.float64)
    return model.ln_k + model.s * np.log(x) + model.b1 * v + model.b2 * v / x


def fit_polynomial(switching: float, depth: ArrayLike, *, depth_power: float = 1.0) -> PolynomialFit:
    r"""Fit a1 and a2 of (17) over depths, by least squares.

    .. math:: \min_{a_1, a_2} \sum_i \left[x_i^p \left(x_i^{-\alpha} - a_1 - a_2 / x_i\right)\right]^2

    The paper does not say which form of (17) it fits: p = 0 is that of (17), p = 1 (between them, the default) is
    :math:`x^{1 - \alpha} \approx a_1 x + a_2`, and p = 2 is :math:`x^{2 - \alpha} \approx a_1 x^2 + a_2 x`, its
    combination of quadratic and primary item, which all but ignores small depths. At alpha = 0 all give (1, 0), which
    is Hunt-Crossley, and at alpha = 1 (0, 1), Kelvin-Voigt.

    The switching alpha is from 0 to 1; depths x [m], shape (samples,), are positive and at least two different ones.
    """
    require("switching", switching, at_least=0.0, at_most=1.0)
    require("depth_power", depth_power)
    x = np.asarray(depth, dtype=np.float64).ravel()
    if x.size < 2 or not (np.isfinite(x).all() and x.min() > 0.0 and x.max() > x.min()):
        raise SettingError("depth", f"{x.size} values", "must hold at least two different depths in m, all above 0")
    r = x / x.max()  # relative to the greatest depth both columns are of order 1
    weight = r**depth_power
    columns = np.column_stack([weight, weight / r])
    c1, c2 = np.linalg.lstsq(columns, weight * r**-switching, rcond=None)[0]
    scale = float(x.max())
    a1, a2 = float(c1) * scale**-switching, float(c2) * scale ** (1.0 - switching)
    worst = float(np.max(np.abs((a1 + a2 / x) * x**switching - 1.0)))
    return PolynomialFit(switching, a1, a2, float(x.min()), scale, worst)


def linearise(law: MemorylessLaw, a1: float, a2: float) -> LinearisedContinuousSwitching:
    """The linearised law (18) of an exact law, with a1 [m^-alpha] and a2 [m^(1 - alpha)] of (17)."""
    k, damping, n, alpha = law.general_form
    return LinearisedContinuousSwitching(math.log(k), n + alpha, a1 * damping / k, a2 * damping / k)


def linearisation_error(
    law: MemorylessLaw, a1: float, a2: float, depth: ArrayLike, velocity: ArrayLike
) -> LinearisationError:
    """Error of (18) against (15), split into its steps; infinite where (18) overflows near the surface."""
    k, damping, _, _ = law.general_form
    x, v = np.broadcast_arrays(_inside(depth), np.asarray(velocity, dtype=np.float64))
    exact = log_force(law, x, v)
    with np.errstate(over="ignore", invalid="ignore"):
        force = np.exp(exact)
        by_taylor = force * np.expm1(taylor_log_force(law, x, v) - exact)
        relative = np.expm1(linearised_log_force(law, a1, a2, x, v) - exact)
        total = force * relative
        return LinearisationError(
            force, total, by_taylor, total - by_taylor, relative, damping * v / k, _psi(law, x, v)
        )


def taylor_error_depth(law: MemorylessLaw, velocity: float, tolerance: float) -> float:
    r"""Depth [m] below which the step to (16) alone has more than a given relative error of the force.

    The force of (16) is :math:`e^{\psi} / (1 + \psi)` times the exact one; the psi at which that exceeds 1 +
    tolerance gives :math:`x = (|\varphi| / |\psi|)^{1 / \alpha}`. The sign of the velocity [m/s] matters: release is
    worse. For alpha = 0, where psi = phi at every depth, it is 0 if psi is small enough and infinite if not.
    """
    from scipy.optimize import brentq

    require("velocity", velocity)
    require("tolerance", tolerance, above=0.0, at_most=1e6)
    k, damping, _, alpha = law.general_form
    phi = damping * velocity / k
    if phi == 0.0:
        return 0.0
    low, high = (0.0, 100.0) if phi > 0.0 else (-1.0 + 1e-15, 0.0)
    limit = abs(brentq(lambda psi: psi - math.log1p(psi) - math.log1p(tolerance), low, high, xtol=1e-15))
    if alpha == 0.0:
        return math.inf if abs(phi) > limit else 0.0
    return float((abs(phi) / limit) ** (1.0 / alpha))


def _inside(depth: ArrayLike) -> Array:
    """Depths, NaN where there is no contact."""
    x = np.asarray(depth, dtype=np.float64)
    return np.where(x > 0.0, x, np.nan)


def _psi(law: MemorylessLaw, depth: Array, velocity: ArrayLike) -> Array:
    """Damper over spring, psi = lambda v / (k x^alpha)."""
    k, damping, _, alpha = law.general_form
    return damping * np.asarray(velocity, dtype=np.float64) / (k * depth**alpha)
