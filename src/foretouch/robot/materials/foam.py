"""Foam: plateau and densification, from the mechanics of cells."""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.models.checks import require
from foretouch.robot.materials.material import Material
from foretouch.robot.materials.relaxing_contact import ElasticResponse, RelaxingContact

__all__ = ["PlateauResponse", "foam"]

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
        require("plateau_force", self.plateau_force, above=0.0)
        require("buckling_strain", self.buckling_strain, above=0.0)
        require("densification_strain", self.densification_strain, above=0.0, at_most=1.0)
        require("densification", self.densification, above=0.0)
        require("thickness", self.thickness, above=0.0)

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
