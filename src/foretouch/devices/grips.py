"""How a hand holds a device."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from foretouch.models.checks import require

__all__ = ["GRIPS", "Grip"]


@dataclass(frozen=True, slots=True)
class Grip:
    r"""A hand as a mass that a spring and a damper hold to where it wants to be.

    .. math:: F = k (x_d - x) + b (\dot x_d - \dot x)

    Args:
        mass: Of the hand that moves with the device [kg], 0 to 10.
        damping: b [N s/m], 0 to 1000.
        stiffness: k [N/m], 0 to 100,000.

    Raises:
        SettingError: A number out of range.
    """

    mass: float
    damping: float
    stiffness: float

    def __post_init__(self) -> None:
        require("mass", self.mass, at_least=0.0, at_most=10.0)
        require("damping", self.damping, at_least=0.0, at_most=1000.0)
        require("stiffness", self.stiffness, at_least=0.0, at_most=1e5)


GRIPS = MappingProxyType(
    {
        "soft": Grip(mass=0.10, damping=4.0, stiffness=150.0),
        "normal": Grip(mass=0.15, damping=8.0, stiffness=400.0),
        "stiff": Grip(mass=0.25, damping=18.0, stiffness=1000.0),
    }
)
"""Hands that hold a stylus loosely, as one works, and tightly."""
