"""From names to robots."""

from __future__ import annotations

from typing import Any

from foretouch.models.checks import require_type
from foretouch.robot.materials import Material, make_material
from foretouch.robot.rcm_arm import RcmArm

__all__ = ["make_robot"]


def make_robot(material: str | Material, *, seed: int = 0, surface: float | None = None, **options: Any) -> RcmArm:
    """The simulated arm over a material.

    Args:
        material: A material, or its name in `MATERIALS`.
        seed: Of the sensor and encoder noise.
        surface: Position of the undeformed surface [m]; None takes the material's own.
        **options: Settings of `RcmArm`.

    Raises:
        UnknownNameError: No such material.
        SettingError: A setting out of range.
        ArgumentTypeError: A material or a setting of another type.
        MissingExtraError: MuJoCo is not installed.
    """
    if isinstance(material, str):
        material = make_material(material)
    require_type("material", material, Material, "a Material, or the name of one")
    return RcmArm(material, seed=seed, surface=surface, **options)
