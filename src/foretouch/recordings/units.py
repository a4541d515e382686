"""Units that a table of samples may be in, and the columns that it must have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, UnknownNameError
from foretouch.quantities import Recording

__all__ = ["FORCE_UNITS", "POSITION_UNITS", "REQUIRED", "VELOCITY", "Units", "to_recording", "wanted_columns"]

POSITION_UNITS: Final = {"m": 1.0, "cm": 1e2, "mm": 1e3, "um": 1e6}
"""How many of a unit make a metre."""

FORCE_UNITS: Final = {"N": 1.0, "mN": 1e3}
"""How many of a unit make a newton."""

REQUIRED: Final = ("time_s", "position_m", "force_N")
VELOCITY: Final = "velocity_m_s"


@dataclass(frozen=True)
class Units:
    """What the numbers of a table mean.

    Attributes:
        position: Unit of positions; velocities are in that unit a second.
        force: Unit of forces.
        flip: Whether positions grow out of the material, so that they change sign.

    Raises:
        UnknownNameError: A unit that is not known.
    """

    position: str = "m"
    force: str = "N"
    flip: bool = False

    def __post_init__(self) -> None:
        for kind, name, known in (
            ("position unit", self.position, POSITION_UNITS),
            ("force unit", self.force, FORCE_UNITS),
        ):
            if name not in known:
                raise UnknownNameError(kind, name, known)


def wanted_columns(source: object, names: Iterable[str]) -> list[str]:
    """The columns to read, of those that a table has.

    Raises:
        RecordingError: One that must be there is missing, or is there twice.
    """
    there = list(names)
    missing = [name for name in REQUIRED if name not in there]
    if missing:
        problem = f"column {', '.join(missing)} missing; the columns are {_listed(there)}"
        if any(name.startswith("position_") for name in there) and "position_m" in missing:
            problem += "; name it position_m and give its unit with --position-unit"
        elif len(there) == 1 and any(mark in there[0] for mark in ";\t"):
            problem += "; separate them by commas"
        raise RecordingError(source, problem, row=1)
    wanted = [*REQUIRED, *([VELOCITY] if VELOCITY in there else [])]
    for name in wanted:
        if there.count(name) > 1:
            raise RecordingError(source, f"column {name} is there {there.count(name)} times", row=1)
    return wanted


def to_recording(source: object, columns: Mapping[str, Any], units: Units, first_row: int | None) -> Recording:
    """Recording in SI units from the columns of a table.

    Raises:
        RecordingError: The values break a rule of `Recording`.
    """
    length = (-1.0 if units.flip else 1.0) * POSITION_UNITS[units.position]
    velocity = columns.get(VELOCITY)
    return Recording(
        np.asarray(columns["time_s"]),
        # a quotient is the correctly rounded value of 0.5 mm, a product with 1e-3 is not
        _divided(columns["position_m"], length),
        _divided(columns["force_N"], FORCE_UNITS[units.force]),
        None if velocity is None else _divided(velocity, length),
        name=str(source),
        first_row=first_row,
    )


def _divided(column: Any, by: float) -> NDArray[np.float64]:
    """A column in SI units, itself where it is in them: `Recording` takes a copy anyway."""
    values = np.asarray(column, np.float64)
    return values if by == 1.0 else values / by


def _listed(names: list[str], longest: int = 200) -> str:
    text = ", ".join(repr(name)[1:-1] for name in names) or "none"
    return text if len(text) <= longest else text[:longest] + " ..."
