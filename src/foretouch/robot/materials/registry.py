"""The registry of materials: a name to the function that makes it."""

from __future__ import annotations

from collections.abc import Callable

from foretouch.errors import UnknownNameError
from foretouch.robot.materials.bone import bone
from foretouch.robot.materials.foam import foam
from foretouch.robot.materials.foam_measured import foam_measured
from foretouch.robot.materials.hand import hand
from foretouch.robot.materials.hunt_crossley import hunt_crossley
from foretouch.robot.materials.kelvin_voigt import kelvin_voigt
from foretouch.robot.materials.material import Material
from foretouch.robot.materials.sponge import sponge

__all__ = ["DEFAULT_MATERIAL", "MATERIALS", "make_material"]

DEFAULT_MATERIAL = "foam-measured"
"""What is pressed where nothing else is asked for."""

MATERIALS: dict[str, Callable[[], Material]] = {
    "bone": bone,
    "foam": foam,
    "foam-measured": foam_measured,
    "hand": hand,
    "hunt-crossley": hunt_crossley,
    "kelvin-voigt": kelvin_voigt,
    "sponge": sponge,
}
"""Every material that can be pressed."""


def make_material(name: str) -> Material:
    """Material from its name.

    Raises:
        UnknownNameError: No such material.
    """
    if name not in MATERIALS:
        raise UnknownNameError("material", name, MATERIALS)
    return MATERIALS[name]()
