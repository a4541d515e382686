"""The registry of materials, a name to the function that makes it, and where the numbers of each come from.

A material is a contact law at a place. There are the paper's Kelvin-Voigt and Hunt-Crossley materials; foam fitted to
measured presses, the default; and independent physics: a sponge, quasi-linear viscoelastic; a foam with plateau and
densification, from the mechanics of cells; a thenar's skin, fat and muscle over bone; and bare bone, the stress case.
In `spheres` and `rubbers` there are solutions of contact mechanics, for a sphere as large as the arm's tip.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files

import msgspec

from foretouch.errors import UnknownNameError
from foretouch.errors.checks import require, require_fields
from foretouch.models.classic import HuntCrossley, KelvinVoigt
from foretouch.plugins import make_plugin, plugin_names
from foretouch.robot.materials.contacts import ElasticResponse, LayeredContact, RelaxingContact
from foretouch.robot.materials.foam_fit import FoamFit
from foretouch.robot.materials.material import Material
from foretouch.robot.materials.rubbers import adhesive, hyperelastic_fe, mullins
from foretouch.robot.materials.spheres import poroelastic, sphere_viscoelastic, thin_layer


def kelvin_voigt() -> Material:
    """The paper's simulated material: K = 6000 N/m, B = 500 N s/m.

    Stiff: 6 N at 1 mm, so the follower's 15 N end at 2.5 mm. Its damper acts at full strength from the surface on,
    so that touching it at 10 mm/s jumps to 5 N: the law, not the simulation.
    """
    return Material(
        name="kelvin-voigt",
        description="Kelvin-Voigt law: stiff (6 N at 1 mm), damping jumps at the surface",
        provenance="the paper's simulation: K = 6000 N/m, B = 500 N s/m",
        model=KelvinVoigt(stiffness=6000.0, damping=500.0),
        press_depth=0.001,
    )


def hunt_crossley() -> Material:
    """The paper's simulated material: k = 3000, lambda = 1500, n = 1.4.

    The paper does not state the unit of depth. Read in metres, as here, the force in a held press is 4.75 N at 10 mm
    and 12.5 N at 20 mm, and moving in at 0.1 m/s adds 5 %: a sensible press. (Read in millimetres, 10 mm would give
    75 kN.)
    """
    return Material(
        name="hunt-crossley",
        description="Hunt-Crossley law: 4.75 N at 10 mm, damping grows with depth",
        provenance="the paper's simulation: k = 3000 N/m^1.4, lambda = 1500 N s/m^2.4, n = 1.4, depth in metres",
        model=HuntCrossley(stiffness=3000.0, damping=1500.0, exponent=1.4),
        press_depth=0.015,
    )


SKIN = (0.0015, 75.0, 0.60, 0.19)
FAT = (0.0030, 5.0, 0.50, 1.0)
MUSCLE = (0.0100, 20.0, 0.50, 0.15)
BONE_STIFFNESS = 1e6  # [N/m]


def hand() -> Material:
    """The thenar of a relaxed hand, pressed up to 15 N: skin, fat and muscle, and bone beneath.

    - Stiffening: the tangent moduli that Isogai et al. measured in vivo (gluteal region, slow) grow from 26 kPa at 1 N
      to 2,199 kPa at 30 N in subcutaneous fat, and from 62 kPa at 5 N to 440 kPa at 30 N in muscle. The law's factor,
      pressed slowly (1 + F / (p - g p))^2, gives both ratios with p - g p = 2.5 N and 10 N. Skin is much stiffer:
      30 N, by order of magnitude.
    - Thicknesses: 1.5, 3 and 10 mm, by order of magnitude for a thenar.
    - Fractions g: one half of fat and muscle, so that a quick press meets about twice the force of a slow one at the
      same depth; Spartacus et al. found 2 to 2.75 in vivo on the palm. Skin 0.6; Wang et al. (mouse): 0.72 +- 0.13.
    - Times: skin 0.19 s (Wang et al.: 0.19 +- 0.10 s); muscle 0.15 s and fat 1 s (Zheng and Mak, soft tissue of the
      lower limb: 0.05 to 8.93 s).
    - Bone: 1,000 N/mm, by order of magnitude: stiff, and no more than what carries it.

    Stiffness at 15 N: between 0.7 and 75 N/mm. The lower end is the modulus of muscle at 5 N (Isogai et al.), under a
    tip of 6 mm radius over 10 mm; the upper end is the spring constant of hand and fingers in ISO/TS 15066, for larger
    contacts and forces.
    """
    return Material(
        name="hand",
        description="human hand: skin, fat and muscle of the thenar over bone, to 15 N",
        provenance="Isogai et al. (2022), J. Phys. Ther. Sci. 34, 777-783 (stiffening); Spartacus et al. (2021), PLoS "
        "ONE 16, e0261008, Wang et al. (2015), PLoS ONE 10, e0120897, Zheng and Mak (1999), J. Biomech. Eng. 121, 330 "
        "(relaxation); thicknesses, skin's stiffness and bone chosen by order of magnitude",
        model=LayeredContact(layers=(SKIN, FAT, MUSCLE), base_stiffness=BONE_STIFFNESS),
        press_depth=0.007,
    )


@dataclass(frozen=True, slots=True)
class LinearResponse(ElasticResponse):
    """A linear spring: E(y) = K y.

    Args:
        stiffness: K [N/m], positive.

    Raises:
        SettingError: A number out of range.
    """

    stiffness: float

    def __post_init__(self) -> None:
        require("stiffness", self.stiffness, above=0.0)

    def force(self, deflection: float) -> float:
        """E(y) [N]: see `ElasticResponse`."""
        return self.stiffness * deflection


def bone() -> Material:
    """Bone with nothing on it, as a standard linear solid: 75 N/mm pressed slowly, 107 N/mm when struck.

    75 N/mm is what ISO/TS 15066 gives for hand and fingers, and 150 N/mm for the stiffest region of the body, the
    skull: bone and what carries it. The contact itself is stiffer: by Hertz's formula a tip of 6 mm radius at 15 N
    on 15 GPa (indentation of cortical bone: 7 to 25 GPa) meets 5,000 N/mm, more than any hand passes on.
    The loss (three tenths within 2 ms) is chosen: that of the joints and flesh behind the bone, of which we know no
    measurement, by what the simulated arm can hold. It presses stably to its force limit of 15 N here; on a spring
    of 75 N/mm that loses almost nothing it chatters at the limit, because its force sensor is 1.3 ms late. Up to
    50 N/mm it needs no loss.

    The impact peak is what it is: moved mass and speed against the spring, 24 N at 0.1 m/s and 49 N at 0.3 m/s. The
    scripted hand asks for 0.5 mm, which is beyond the follower's 15 N: what ends every press is the force limit.
    """
    return Material(
        name="bone",
        description="bare bone: 75 N/mm, the stress case; the force limit ends every press",
        provenance="stiffness: ISO/TS 15066 (2016), annex A, hand and fingers, 75 N/mm; modulus of cortical bone: "
        "Zysset et al. (1999), J. Biomech. 32, 1005-1012; loss chosen so that the arm can press it",
        model=RelaxingContact(elastic=LinearResponse(75e3 / 0.7), relaxation=((0.3, 0.002),)),
        press_depth=0.0005,
    )


SPONGE_THICKNESS = 0.040  # of the sponge [m]


@dataclass(frozen=True, slots=True)
class ExponentialResponse(ElasticResponse):
    r"""Fung's exponential: the stiffness grows in proportion to the force.

    .. math:: E(y) = A (e^{b y} - 1), \quad \text{beyond } y_c \text{ along its tangent}

    Args:
        scale: A [N], positive.
        growth: b [1/m], positive.
        end: y_c [m], positive: the sponge is squeezed flat.

    Raises:
        SettingError: A number out of range.
    """

    scale: float
    growth: float
    end: float

    def __post_init__(self) -> None:
        require("scale", self.scale, above=0.0)
        require("growth", self.growth, above=0.0, at_most=1000.0)
        require("end", self.end, above=0.0, at_most=0.1)

    def force(self, deflection: float) -> float:
        """E(y) [N]: see `ElasticResponse`."""
        if deflection <= self.end:
            return self.scale * math.expm1(self.growth * deflection)
        slope = self.scale * math.exp(self.growth * self.end)
        return slope - self.scale + self.growth * slope * (deflection - self.end)


def sponge() -> Material:
    """A soft sponge, 40 mm thick: stiffer in compression than in restitution, and late to recover.

    An exponential response with a Prony series of three terms: a tenth of a second, a second and several seconds.
    The form (nonlinear elastic response, hereditary kernel of few exponentials) is that of Deng, Davies and Bajaj for
    flexible polyurethane; the exponential is Fung's. The numbers are our own, of the right order of magnitude for a
    household sponge under a probe of 6 mm radius: 8 N at 15 mm, six times as stiff there as at first, and 45 % of
    the response relaxing in the end.
    """
    return Material(
        name="sponge",
        description="sponge: quasi-linear viscoelastic, stiffer in compression, recovers late",
        provenance="form: Fung (1993) chapter 7 and Deng, Davies and Bajaj (2003), J. Sound Vib. 262, 391-417; "
        "numbers: chosen, of the order of magnitude of a household sponge",
        model=RelaxingContact(
            elastic=ExponentialResponse(scale=1.6, growth=120.0, end=0.75 * SPONGE_THICKNESS),
            relaxation=((0.20, 0.08), (0.15, 0.8), (0.10, 6.0)),
        ),
        press_depth=0.015,
    )


SOLID_MODULUS = 45e6  # of the polyurethane of the cell edges [Pa]; Gibson and Ashby
RELATIVE_DENSITY = 0.10  # of foam to solid
PROBE_AREA = math.pi * 0.006**2  # of the arm's tip [m^2]: only what lies under it is compressed
FOAM_THICKNESS = 0.025  # [m]

CLOSED = 0.03  # rest of the densification strain at which the tangent begins


@dataclass(frozen=True, slots=True)
class PlateauResponse(ElasticResponse):
    r"""Cells that bend, buckle at a plateau, and close.

    With the strain e = y / H,

    .. math::
        E(y) = F_p \Big(1 - e^{-e / e_p} + \frac{1}{D} \frac{e}{e_D - e}\Big), \quad
        \text{beyond } 0.97\, e_D \text{ along its tangent}

    The first part bends and buckles, at the strain e_p; the second is Gibson and Ashby's densification
    (1/D) e_D / (e_D - e), less its value at 0, so that the force begins at 0 and is smooth.

    Args:
        plateau_force: F_p [N], positive.
        buckling_strain: e_p [-], positive.
        densification_strain: e_D [-], positive, at most 1.
        densification: D [-], positive.
        thickness: H [m], positive.

    Raises:
        SettingError: A number out of range.
    """

    plateau_force: float
    buckling_strain: float
    densification_strain: float
    densification: float
    thickness: float

    def __post_init__(self) -> None:
        require_fields(self, "plateau_force", "buckling_strain", "densification", "thickness", above=0.0)
        require("densification_strain", self.densification_strain, above=0.0, at_most=1.0)

    def force(self, deflection: float) -> float:
        """E(y) [N]: see `ElasticResponse`."""
        strain, full = deflection / self.thickness, self.densification_strain
        gap = full - strain
        if gap < CLOSED * full:
            closed = CLOSED * full
            dense = (full - closed + (closed - gap) * full / closed) / closed
        else:
            dense = strain / gap
        return self.plateau_force * (dense / self.densification - math.expm1(-strain / self.buckling_strain))


def foam() -> Material:
    """Dense open-cell polyurethane foam, 25 mm thick: from stiff to soft to stiff as its cells bend, buckle and close.

    Gibson and Ashby's formulas for an elastomeric open-cell foam of relative density r = 0.1: modulus r^2 E_s =
    0.45 MPa with E_s = 45 MPa, collapse at 0.05 of that (22.5 kPa, 2.5 N under the tip), densification strain
    1 - 1.4 r = 0.86, D = 2.3. The rate dependence, Eyring flow of the polymer, has numbers of our own: of the order
    of magnitude of a resilient foam (a loss of a quarter to a half of the energy of a press, some percent more force
    for ten times the speed).
    """
    return Material(
        name="foam",
        description="foam: cells bend, buckle at a plateau and close, with rate dependence",
        provenance="Gibson and Ashby (1997), Cellular Solids, chapter 5: open cells, relative density 0.1, solid "
        "modulus 45 MPa, D = 2.3; flow after Eyring (1936), its numbers chosen by order of magnitude",
        model=RelaxingContact(
            elastic=PlateauResponse(
                plateau_force=0.05 * SOLID_MODULUS * RELATIVE_DENSITY**2 * PROBE_AREA,
                buckling_strain=0.05,
                densification_strain=1.0 - 1.4 * RELATIVE_DENSITY,
                densification=2.3,
                thickness=FOAM_THICKNESS,
            ),
            relaxation=((0.35, 2.0),),
            flow_force=0.4,
        ),
        press_depth=0.019,
    )


def shipped_foam_fit() -> FoamFit:
    """The fit that is shipped with the package: coefficients, files, surfaces, offsets and residuals."""
    return msgspec.json.decode((files(__package__) / "foam_measured.json").read_bytes(), type=FoamFit)


def foam_measured() -> Material:
    """Foam pressed by a lever at TU/e, as a law over depth and velocity with its hysteresis.

    A soft toe, a steep rise, a plateau and densification; about a third of the energy of a press stays in the
    material. Its surface comes back more slowly than a quick probe. Valid to 1.2 times `FoamFit.measured_depth`
    and 0.3 m/s.
    """
    fit = shipped_foam_fit()
    return Material(
        name="foam-measured",
        description="foam with plateau, densification, hysteresis and relaxation, fitted to measured presses",
        provenance=fit.provenance,
        model=fit.model(),
        press_depth=0.009,
    )


DEFAULT_MATERIAL = "foam-measured"
"""Material that is pressed by default."""

MATERIALS: dict[str, Callable[[], Material]] = {
    "adhesive": adhesive,
    "bone": bone,
    "foam": foam,
    "foam-measured": foam_measured,
    "hand": hand,
    "hunt-crossley": hunt_crossley,
    "hyperelastic-fe": hyperelastic_fe,
    "kelvin-voigt": kelvin_voigt,
    "mullins": mullins,
    "poroelastic": poroelastic,
    "sphere-viscoelastic": sphere_viscoelastic,
    "sponge": sponge,
    "thin-layer": thin_layer,
}
"""Every material of the package; others come from `foretouch.plugins`."""


def material_names() -> tuple[str, ...]:
    """Names of all materials, those of other packages too; nothing of theirs is imported."""
    return (*MATERIALS, *plugin_names("material"))


def make_material(name: str) -> Material:
    """Material from its name, of this package or of another.

    Raises:
        UnknownNameError: No such material.
        PluginError: Another package's, which cannot be made.
    """
    if name in MATERIALS:
        return MATERIALS[name]()
    made = make_plugin("material", name, Material)
    if made is None:
        raise UnknownNameError("material", name, material_names())
    return made
