"""Sponge: quasi-linear viscoelastic."""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.models.checks import require
from foretouch.robot.materials.material import Material
from foretouch.robot.materials.relaxing_contact import ElasticResponse, RelaxingContact

__all__ = ["ExponentialResponse", "sponge"]

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
