"""Units that options may name, and the columns of a table that needs no map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from foretouch.errors import UnknownNameError

__all__ = ["FORCE_UNITS", "POSITION_UNITS", "REQUIRED", "VELOCITY_KEY", "Units"]

POSITION_UNITS: Final = {"m": 1.0, "cm": 1e2, "mm": 1e3, "um": 1e6}
"""How many of a unit make a metre."""

FORCE_UNITS: Final = {"N": 1.0, "mN": 1e3, "cN": 1e2, "kN": 1e-3}
"""How many of a unit make a newton."""

REQUIRED: Final = ("time_s", "position_m", "force_N")
VELOCITY_KEY: Final = "velocity_m_s"


@dataclass(frozen=True)
class Units:
    """What the numbers of a table mean.

    Attributes:
        position: Unit of positions; velocities are in that unit a second. None where nobody has said it.
        force: Unit of forces, likewise.
        flip: Whether positions grow out of the material, so that they change sign.
        flip_force: Whether forces are negative under load, so that they change sign.

    Raises:
        UnknownNameError: A unit that is not known.
    """

    position: str | None = None
    force: str | None = None
    flip: bool = False
    flip_force: bool = False

    def __post_init__(self) -> None:
        for kind, name, known in (
            ("position unit", self.position, POSITION_UNITS),
            ("force unit", self.force, FORCE_UNITS),
        ):
            if name is not None and name not in known:
                raise UnknownNameError(kind, name, known)
