"""The paper's Kelvin-Voigt material."""

from __future__ import annotations

from foretouch.models.kelvin_voigt import KelvinVoigt
from foretouch.robot.materials.material import Material

__all__ = ["kelvin_voigt"]


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
