"""The registry of materials: a name to the function that makes it."""

from __future__ import annotations

from collections.abc import Callable

from foretouch.errors import UnknownNameError
from foretouch.plugins import make_plugin, plugin_names
from foretouch.robot.materials.bone import bone
from foretouch.robot.materials.foam import foam
from foretouch.robot.materials.foam_measured import foam_measured
from foretouch.robot.materials.hand import hand
from foretouch.robot.materials.hunt_crossley import hunt_crossley
from foretouch.robot.materials.kelvin_voigt import kelvin_voigt
from foretouch.robot.materials.material import Material
from foretouch.robot.materials.sponge import sponge

__all__ = ["DEFAULT_MATERIAL", "MATERIALS", "make_material", "material_names"]

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
