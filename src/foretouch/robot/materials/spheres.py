"""A rigid sphere, the arm's tip, on materials with a memory that fades: viscoelastic, poroelastic, and a damped layer.

What they share: E* is the plane strain modulus E / (1 - nu^2), R the radius of the sphere, and the force of an elastic
half-space is Hertz's, 4/3 E* sqrt(R) x^(3/2). The probe only pushes; a surface that it leaves comes back late. The
velocity of the call is not used.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require, require_fields
from foretouch.models import ContactModel, ContactState
from foretouch.models.contact_model import LARGEST_DEPTH, Advanced
from foretouch.robot.materials.contacts import Relaxation, check_relaxation
from foretouch.robot.materials.material import Material

Array = NDArray[np.float64]

SPHERE_RADIUS = 0.006  # of the arm's tip [m]


def hertz_factor(modulus: float, radius: float) -> float:
    """The force of a half-space at a depth x, over x^(3/2) [N/m^1.5]: Johnson (1985), equation (4.23)."""
    return 4.0 / 3.0 * modulus * math.sqrt(radius)


@dataclass(frozen=True)
class ViscoelasticSphere(ContactModel):
    r"""A sphere on a linear viscoelastic half-space, whatever the motion: Lee and Radok's solution, and Ting's.

    With the relaxation modulus E*(t) = E* (1 - sum g_i (1 - e^{-t / tau_i})) and the contact radius a(t),

    .. math::
        F(t) = \frac{4 \sqrt R}{3} \int_0^{t_1} E^*(t - s)\, \frac{\mathrm d x^{3/2}}{\mathrm d s}\, \mathrm d s, \quad
        \int_{t_1}^{t} E^*(t - s)\, \frac{\mathrm d x}{\mathrm d s}\, \mathrm d s = 0

    where t_1 = t while the contact grows, and else the last time before at which it was as large as now. That holds for
    one press (Ting 1966); for what follows, when the surface has not yet come back, it becomes a recursion over all
    largest and smallest contacts (Ting 1968).

    It is solved by dimensionality reduction, which is exact for this problem (Argatov and Popov 2016): the half-space
    is replaced by springs side by side at the distances r, each with the stiffness 2 E*(t) dr and pressed by the depth
    x - r^2 / R, or free, and in contact while it pushes. So the memory is that of the rings of the contact, of bounded
    size, and t_1 needs no search. The rings lie at the depths d_j = D (j / N)^2, j from 0, weighted so that the elastic
    force is Hertz's at each of them and straight in between: from the eighth on it is right to 0.6 %, at the end to
    0.01 %. Deeper than D the contact grows no more.

    Passive by construction, for any path, step length and step size: each ring is a `RelaxingContact` on a spring.

    The state is the deflection of each ring, then what of it has relaxed, part by part [m].

    Args:
        modulus: E* before anything relaxes [Pa], positive.
        relaxation: g above 0, together below 1, and tau [s] above 0.
        radius: R [m], positive.
        deepest: D [m], positive.
        rings: N, at least 2.

    Raises:
        SettingError: A number out of range.

    References:
        Lee and Radok (1960), The contact problem for viscoelastic bodies, Journal of Applied Mechanics 27, 438-444.
        Ting (1966), The contact stresses between a rigid indenter and a viscoelastic half-space, Journal of Applied
        Mechanics 33, 845-854; Ting (1968), Contact problems in the linear theory of viscoelasticity, same journal 35.
        Argatov and Popov (2016), Rebound indentation problem for a viscoelastic half-space and axisymmetric indenter:
        solution by the method of dimensionality reduction, ZAMM 96, 956-967.
    """

    law: ClassVar[str] = "viscoelastic-sphere"
    modulus: float
    relaxation: tuple[Relaxation, ...]
    radius: float = SPHERE_RADIUS
    deepest: float = SPHERE_RADIUS
    rings: int = 64

    def __post_init__(self) -> None:
        require_fields(self, "modulus", "radius", "deepest", above=0.0)
        require("rings", self.rings, at_least=2)
        check_relaxation(self.relaxation)

    def initial_state(self) -> ContactState:
        """Flat, and nothing relaxed."""
        return (0.0,) * (self.rings * (1 + len(self.relaxation)))

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air."""
        step, rings, relaxation = self._compiled
        values = np.array(state)
        force = step(values, min(depth, LARGEST_DEPTH), sample_period, rings, relaxation)
        return tuple(values.tolist()), force, math.nan

    @cached_property
    def _compiled(self) -> tuple[Callable[..., float], Array, Array]:
        from foretouch.robot.materials.kernels import viscoelastic_step  # Numba is slow to import: only when used

        depths = self.deepest * (np.arange(self.rings + 1) / self.rings) ** 2
        slopes = np.diff(hertz_factor(self.modulus, self.radius) * depths**1.5) / np.diff(depths)
        rings = np.column_stack((depths[:-1], np.diff(slopes, prepend=0.0)))
        return viscoelastic_step, rings, np.array(self.relaxation, dtype=np.float64).reshape(-1, 2)


def sphere_viscoelastic() -> Material:
    """A soft gel that relaxes to three tenths: 6.8 N at 3 mm when struck, 2 N in the end."""
    return Material(
        name="sphere-viscoelastic",
        description="sphere on a linear viscoelastic half-space: the contact shrinks before the surface is back",
        provenance="Lee and Radok (1960), J. Appl. Mech. 27, 438; Ting (1966), J. Appl. Mech. 33, 845; numbers chosen, "
        "of the order of magnitude of a soft polyurethane gel",
        model=ViscoelasticSphere(modulus=400e3, relaxation=((0.35, 0.05), (0.25, 0.7), (0.1, 8.0))),
        press_depth=0.003,
    )


DRAINAGE = ((0.16, 0.146), (1.3, 0.620), (4.6, 0.179), (90.0, 0.047), (1.4e4, 0.008))
"""Rates [-] and fractions of the exponentials whose sum is g to 0.004: fractions by least squares, rates by search."""

LEAST_DEFLECTION = 1e-9  # [m]; a smaller contact drains as quickly as this one


@dataclass(frozen=True)
class PoroelasticSphere(ContactModel):
    r"""A sphere on a gel out of which the liquid flows: stiff as if incompressible at first, softer once drained.

    Held at a depth x, with a^2 = R x and Poisson's ratio nu of the drained gel (Hu, Zhao, Vlassak and Suo 2010),

    .. math::
        F_0 = \tfrac{16}{3} G \sqrt R\, x^{3/2}, \quad F_\infty = \frac{F_0}{2 (1 - \nu)}, \quad
        \frac{F - F_\infty}{F_0 - F_\infty} = g\Big(\frac{D t}{a^2}\Big), \quad
        g(\theta) = 0.491\, e^{-0.908 \sqrt\theta} + 0.509\, e^{-1.679\, \theta}

    The extension to any motion is ours: g is a sum of modes c_m e^{-mu_m theta}, each of which drains on its own, by
    the clock of the present contact,

    .. math::
        F = F_0(y) - \Big(1 - \frac{1}{2 (1 - \nu)}\Big) \sum_m c_m o_m, \quad
        \dot o_m = \mu_m \frac{D}{R y} (F_0(y) - o_m)

    with the deflection y of the surface. So a small contact drains quickly and a large one slowly, which no sum of
    exponential averages of the depth does; where the surface is held, it is Hu's solution.

    Passive by construction, by the argument of `RelaxingContact`: every o moves towards F_0 by a fraction from 0 to 1,
    however fast the clock. The state is (F_0(y), then each mode's part of what has drained [N]).

    Args:
        shear_modulus: G [Pa], positive.
        poisson_ratio: nu, from 0 to 0.5.
        diffusivity: D [m^2/s], positive.
        radius: R [m], positive.

    Raises:
        SettingError: A number out of range.

    References:
        Hu, Zhao, Vlassak and Suo (2010), Using indentation to characterize the poroelasticity of gels, Applied Physics
        Letters 96, 121904.
    """

    law: ClassVar[str] = "poroelastic-sphere"
    shear_modulus: float
    poisson_ratio: float
    diffusivity: float
    radius: float = SPHERE_RADIUS

    def __post_init__(self) -> None:
        require_fields(self, "shear_modulus", "diffusivity", "radius", above=0.0)
        require("poisson_ratio", self.poisson_ratio, at_least=0.0, at_most=0.5)

    def initial_state(self) -> ContactState:
        """Flat, and nothing drained."""
        return (0.0,) * (1 + len(DRAINAGE))

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air."""
        stress, *parts = state
        factor = hertz_factor(4.0 * self.shear_modulus, self.radius)
        drained = 1.0 - 0.5 / (1.0 - self.poisson_ratio)
        deflection = max((stress / factor) ** (2.0 / 3.0), LEAST_DEFLECTION)
        clock = sample_period * self.diffusivity / (self.radius * deflection)
        parts = [
            part - (drained * share * stress - part) * math.expm1(-rate * clock)
            for part, (rate, share) in zip(parts, DRAINAGE, strict=True)
        ]
        memory = sum(parts)
        after = memory  # of a free surface
        if depth > 0.0:
            after = max(memory, factor * min(depth, LARGEST_DEPTH) ** 1.5)
        return (after, *parts), after - memory, math.nan


def poroelastic() -> Material:
    """A wet gel with wide pores: 4.8 N at 6 mm when struck, 3 N when drained, which takes a second there.

    D is the permeability, 4.5e-13 m^2, times the drained modulus, 67 kPa, over the viscosity of water, 1 mPa s.
    """
    return Material(
        name="poroelastic",
        description="sphere on a gel that drains: the deeper it is pressed, the slower",
        provenance="Hu, Zhao, Vlassak and Suo (2010), Appl. Phys. Lett. 96, 121904; numbers chosen, of a gel with "
        "pores so wide that it drains within seconds",
        model=PoroelasticSphere(shear_modulus=25e3, poisson_ratio=0.2, diffusivity=3e-5),
        press_depth=0.006,
    )


FINITE_THICKNESS = (1.0, 1.133, 1.497, 1.469, 0.755)
"""Coefficients of the powers of sqrt(R x) / h, for an incompressible layer that is bonded to its ground."""


@dataclass(frozen=True)
class ThinLayer(ContactModel):
    r"""A sphere on a thin incompressible layer, bonded to rigid ground: a ground that is felt long before it is met.

    .. math::
        f(x) = \tfrac{16}{9} E \sqrt R\, x^{3/2}
            (1 + 1.133 \chi + 1.497 \chi^2 + 1.469 \chi^3 + 0.755 \chi^4), \quad \chi = \frac{\sqrt{R x}}{h}, \quad
        F = f(y) + \tau \frac{\mathrm d f(y)}{\mathrm d t}

    The elastic part is Dimitriadis's correction of Hertz's law for a finite thickness, with the coefficients of Garcia
    and Garcia: those that Dimitriadis printed are 14 % too soft at chi = 0.75, by the integral equation of the layer,
    and these 5 % too hard there and 1 % at 0.5. The damping is that of a Kelvin-Voigt solid of retardation time tau, by
    the principle of correspondence exact while the contact grows. Left, the surface comes back by itself, f falling by
    the factor e in tau.

    Passive by construction, for any path, step length and step size: f increases, so its potential is convex, and
    (f - f') (y - y') is not negative. The state is (f(y),).

    Args:
        modulus: E [Pa], positive.
        thickness: h [m], positive.
        retardation: tau [s], positive.
        radius: R [m], positive.

    Raises:
        SettingError: A number out of range.

    References:
        Dimitriadis, Horkay, Maresca, Kachar and Chadwick (2002), Determination of elastic moduli of thin layers of soft
        material using the atomic force microscope, Biophysical Journal 82, 2798-2810.
        Garcia and Garcia (2018), Determination of the elastic moduli of a single cell cultured on a rigid support by
        force microscopy, Biophysical Journal 114, 2923-2932.
    """

    law: ClassVar[str] = "thin-layer"
    modulus: float
    thickness: float
    retardation: float
    radius: float = SPHERE_RADIUS

    def __post_init__(self) -> None:
        require_fields(self, "modulus", "thickness", "retardation", "radius", above=0.0)

    def initial_state(self) -> ContactState:
        """Flat."""
        return (0.0,)

    def elastic(self, depth: float) -> float:
        """f(x) [N] at a depth of 0 or more [m]."""
        ratio, factor = math.sqrt(self.radius * depth) / self.thickness, 0.0
        for coefficient in reversed(FINITE_THICKNESS):
            factor = factor * ratio + coefficient
        return float(hertz_factor(self.modulus / 0.75, self.radius) * depth**1.5 * factor)

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air."""
        ratio = self.retardation / sample_period
        free = state[0] * ratio / (1.0 + ratio)
        pressed = self.elastic(min(depth, LARGEST_DEPTH)) if depth > 0.0 else 0.0
        if pressed <= free:
            return (free,), 0.0, math.nan
        return (pressed,), (1.0 + ratio) * (pressed - free), math.nan


def thin_layer() -> Material:
    """A soft pad, 5 mm thick, on rigid ground: 4.7 N at 2 mm, three times what it would be without the ground."""
    return Material(
        name="thin-layer",
        description="sphere on a thin bonded layer over rigid ground, damped",
        provenance="Dimitriadis et al. (2002), Biophys. J. 82, 2798, with the coefficients of Garcia and Garcia "
        "(2018), Biophys. J. 114, 2923; numbers chosen, of the order of magnitude of a silicone gel",
        model=ThinLayer(modulus=120e3, thickness=0.005, retardation=0.01),
        press_depth=0.002,
    )
