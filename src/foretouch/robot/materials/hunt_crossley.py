"""The paper's Hunt-Crossley material."""

from __future__ import annotations

from foretouch.models.hunt_crossley import HuntCrossley
from foretouch.robot.materials.material import Material

__all__ = ["hunt_crossley"]


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
