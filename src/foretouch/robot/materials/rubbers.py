"""A rigid sphere, the arm's tip, on rubbers: softened by its largest press, sticky, and strained beyond small strains.

None of them depends on time, and none uses the velocity of the call. The module `foretouch.robot.materials.spheres` has
the sphere and Hertz's law.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from itertools import pairwise
from typing import ClassVar

import msgspec

from foretouch.errors import SettingError
from foretouch.errors.checks import require, require_fields
from foretouch.models import ContactModel, ContactState
from foretouch.models.contact_model import LARGEST_DEPTH, Advanced
from foretouch.robot.materials.material import Material
from foretouch.robot.materials.spheres import SPHERE_RADIUS, hertz_factor


@dataclass(frozen=True)
class MullinsSphere(ContactModel):
    r"""A sphere on filled rubber, which is softer below the deepest press that it has ever borne.

    Ogden and Roxburgh's pseudo-elastic law, in the form of Bose and others (beta), with the whole contact for its one
    degree of freedom: with Hertz's force F_0 and its energy W,

    .. math::
        F = F_0(x) \Big(1 - \frac{1}{r}\, \mathrm{erf}\, \frac{W(x_m) - W(x)}{m + \beta W(x_m)}\Big), \quad
        W(x) = \tfrac{2}{5} x F_0(x)

    where x_m is the largest depth so far: a first press is Hertz's, the way back and all presses after it are softer,
    the same ones in and out, until the press is deeper than ever. Nothing heals.

    Passive by construction, for any path and step size: with x_m held, F increases with the depth, so its potential is
    convex, and a larger x_m only lowers that. The state is (W(x_m),) [J].

    Args:
        modulus: E* [Pa], positive.
        softening: r [-], above 1: at most the fraction 1 / r of the force is lost.
        energy: m [J], positive: the larger, the more gradually the force falls as the probe turns back.
        growth: beta [-], 0 or more; 0 in Ogden and Roxburgh's own form.
        radius: R [m], positive.

    Raises:
        SettingError: A number out of range.

    References:
        Ogden and Roxburgh (1999), A pseudo-elastic model for the Mullins effect in filled rubber, Proceedings of the
        Royal Society A 455, 2861-2877.
        Bose, Hurtado and Murman (2003), Modelling of stress softening in filled elastomers, Constitutive Models for
        Rubber III, 223-230.
    """

    law: ClassVar[str] = "mullins-sphere"
    modulus: float
    softening: float
    energy: float
    growth: float = 0.0
    radius: float = SPHERE_RADIUS

    def __post_init__(self) -> None:
        require_fields(self, "modulus", "energy", "radius", above=0.0)
        require("softening", self.softening, above=1.0)
        require("growth", self.growth, at_least=0.0)

    def initial_state(self) -> ContactState:
        """Never pressed."""
        return (0.0,)

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air."""
        if not depth > 0.0:
            return state, 0.0, math.nan
        depth = min(depth, LARGEST_DEPTH)
        first = hertz_factor(self.modulus, self.radius) * depth**1.5
        energy = 0.4 * depth * first
        largest = max(state[0], energy)
        lost = math.erf((largest - energy) / (self.energy + self.growth * largest)) / self.softening
        return (largest,), first * (1.0 - lost), math.nan


def mullins() -> Material:
    """A filled rubber that keeps three eighths of its force below its largest press: 9.2 N at 2 mm the first time."""
    return Material(
        name="mullins",
        description="sphere on filled rubber (Mullins): the first press to a depth is the hardest",
        provenance="Ogden and Roxburgh (1999), Proc. R. Soc. A 455, 2861; numbers chosen, of a soft filled rubber",
        model=MullinsSphere(modulus=1e6, softening=1.6, energy=0.5e-3, growth=0.5),
        press_depth=0.002,
    )


@dataclass(frozen=True)
class AdhesiveSphere(ContactModel):
    r"""A sphere on a sticky half-space: it jumps in at the surface, pulls, and lets go only beyond it.

    Johnson, Kendall and Roberts, by the contact radius a, moved at its displacement:

    .. math::
        x = \frac{a^2}{R} - \sqrt{\frac{2 \pi w a}{E^*}}, \quad F = \frac{4 E^* a^3}{3 R} - \sqrt{8 \pi w E^* a^3}

    A free sphere touches where x is above 0. In contact, a is the largest solution, down to the least depth, where it
    jumps off:

    .. math:: x_{off} = -\frac{3}{4} \Big(\frac{\pi^2 w^2 R}{E^{*2}}\Big)^{1/3}, \quad F_{off} = -\tfrac{5}{6} \pi w R

    The largest pull on the way is 3/2 pi w R.

    Passive but for the energy of its surface, which it has before it is touched: in contact F increases with x, so the
    energy U of elasticity and surface is convex. In the step in which it touches, a pull does not act yet, and in the
    one in which it lets go F_off still does: so, for any path and step size, the work put in is never less than U, and
    never negative once the sphere is free again. The state is (sqrt(a),) [m^0.5], 0 where it is free.

    Args:
        modulus: E* [Pa], positive.
        adhesion: w, the work of adhesion [J/m^2], positive.
        radius: R [m], positive.

    Raises:
        SettingError: A number out of range.

    References:
        Johnson, Kendall and Roberts (1971), Surface energy and the contact of elastic solids, Proceedings of the Royal
        Society A 324, 301-313; at given displacement: Johnson (1985), Contact Mechanics, section 5.5.
    """

    law: ClassVar[str] = "adhesive-sphere"
    modulus: float
    adhesion: float
    radius: float = SPHERE_RADIUS

    def __post_init__(self) -> None:
        require_fields(self, "modulus", "adhesion", "radius", above=0.0)

    def initial_state(self) -> ContactState:
        """Free."""
        return (0.0,)

    @property
    def neck(self) -> float:
        """sqrt(2 pi w / E*) [m^0.5]."""
        return math.sqrt(2.0 * math.pi * self.adhesion / self.modulus)

    @property
    def least_root(self) -> float:
        """sqrt(a) where it lets go [m^0.5]: there dx/da = 0."""
        return float((0.25 * self.radius * self.neck) ** (1.0 / 3.0))

    @property
    def release_depth(self) -> float:
        """x_off [m], negative."""
        return -0.75 * self.neck * self.least_root

    def force(self, root: float) -> float:
        """F [N] by sqrt(a) [m^0.5]."""
        cube = root * root * root
        return 4.0 / 3.0 * self.modulus / self.radius * cube * (cube - 1.5 * self.radius * self.neck)

    def root_at(self, depth: float) -> float:
        """The largest sqrt(a) [m^0.5] at a depth from the release depth on [m], by Newton's method from above."""
        root: float = math.sqrt(math.sqrt(self.radius * max(depth, 0.0))) + (self.radius * self.neck) ** (1.0 / 3.0)
        for _ in range(60):  # the depth is convex in it, so every step is one down; five to twenty are usual
            cube = root * root * root
            slope = 4.0 * cube / self.radius - self.neck
            if not slope > 0.0:
                break
            change = (root * cube / self.radius - self.neck * root - depth) / slope
            root -= change
            if change <= 1e-12 * root:
                break
        return max(root, self.least_root)

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air; it may pull."""
        held = state[0] > 0.0
        if not (depth > 0.0 or (held and depth >= self.release_depth)):
            return (0.0,), self.force(self.least_root) if held else 0.0, math.nan
        root = self.root_at(min(depth, LARGEST_DEPTH))
        force = self.force(root)
        return (root,), force if held else max(force, 0.0), math.nan


def adhesive() -> Material:
    """A sticky soft gel: it pulls with up to 1 N before it lets go, 1.1 mm above its surface."""
    return Material(
        name="adhesive",
        description="sphere on a sticky gel (JKR): jumps in, pulls with 1 N, lets go above the surface",
        provenance="Johnson, Kendall and Roberts (1971), Proc. R. Soc. A 324, 301; work of adhesion chosen, 35 J/m^2, "
        "that of a pressure-sensitive adhesive",
        model=AdhesiveSphere(modulus=150e3, adhesion=35.0),
        press_depth=0.005,
        pulls=True,
    )


class Press(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A computed press, as it is shipped: what was computed and how, depths [m] and forces [N], both from 0 on."""

    provenance: str
    depth: tuple[float, ...]
    force: tuple[float, ...]


@dataclass(frozen=True)
class TabulatedContact(ContactModel):
    r"""An elastic press by a table, of a computation or of a measurement: F(x), the same in and out.

    Between the rows F is a cubic in the square root s of the depth, with a continuous slope, and never falls (Fritsch
    and Carlson 1980): in s, the force of a round tip, which begins as x^(3/2), is smooth from the surface on. Beyond
    the table it goes on along its tangent. F increases, so it is passive; there is no state.

    Args:
        depth: Of the rows [m], from 0 on, increasing, at least three.
        force: [N], from 0 on, increasing.

    Raises:
        SettingError: Rows that are not so.

    References:
        Fritsch and Carlson (1980), Monotone piecewise cubic interpolation, SIAM Journal on Numerical Analysis 17.
    """

    law: ClassVar[str] = "tabulated-contact"
    depth: tuple[float, ...]
    force: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("depth", "force"):
            row = getattr(self, name)
            rising = all(before < after < math.inf for before, after in pairwise(row))
            if len(row) < 3 or len(row) != len(self.depth) or row[0] != 0.0 or not rising:
                raise SettingError(name, row, "must be three numbers or more, as many depths as forces, from 0 up")

    @cached_property
    def _cubics(self) -> tuple[list[float], list[float]]:
        """The square roots s of the depths, and dF/ds at each: 0 at the surface, then means of both sides."""
        roots = [math.sqrt(depth) for depth in self.depth]
        widths = [after - before for before, after in pairwise(roots)]
        rises = [(self.force[i + 1] - self.force[i]) / width for i, width in enumerate(widths)]
        slopes = [0.0]
        for (before, left), (after, right) in pairwise(zip(widths, rises, strict=True)):
            mean = (left * after + right * before) / (before + after)
            slopes.append(min(mean, 3.0 * left, 3.0 * right))
        slopes.append(min(max(1.5 * rises[-1] - 0.5 * slopes[-1], 0.0), 3.0 * rises[-1]))
        return roots, slopes

    def advance(self, state: ContactState, depth: float, velocity: float, sample_period: float) -> Advanced:
        """One step: see `foretouch.models.advance`. A depth that is no number counts as free air."""
        if not depth > 0.0:
            return state, 0.0, math.nan
        roots, slopes = self._cubics
        if depth >= self.depth[-1]:
            beyond = min(depth, LARGEST_DEPTH) - self.depth[-1]
            return state, self.force[-1] + 0.5 * slopes[-1] / roots[-1] * max(beyond, 0.0), math.nan
        i = bisect_right(self.depth, depth) - 1
        width = roots[i + 1] - roots[i]
        t = min((math.sqrt(depth) - roots[i]) / width, 1.0)
        first, last = self.force[i], self.force[i + 1]
        second, third = first + width * slopes[i] / 3.0, last - width * slopes[i + 1] / 3.0  # Bezier: never falls
        middle = 3.0 * t * (1.0 - t) * ((1.0 - t) * second + t * third)
        return state, (1.0 - t) ** 3 * first + middle + t**3 * last, math.nan


def hyperelastic_fe() -> Material:
    """A neo-Hookean rubber block, 12 mm thick and bonded to its ground, by finite elements of large strains."""
    press = msgspec.json.decode((files(__package__) / "hyperelastic_press.json").read_bytes(), type=Press)
    return Material(
        name="hyperelastic-fe",
        description="sphere on a neo-Hookean rubber block, computed by finite elements",
        provenance=press.provenance,
        model=TabulatedContact(press.depth, press.force),
        press_depth=0.004,
    )
