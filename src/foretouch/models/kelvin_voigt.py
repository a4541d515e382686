"""The Kelvin-Voigt law, equation (1) of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from foretouch.models.checks import require
from foretouch.models.contact_model import NO_STATE, ContactModel, ContactState

__all__ = ["KelvinVoigt"]


@dataclass(frozen=True, slots=True)
class KelvinVoigt(ContactModel):
    r"""Linear spring and linear damper in parallel.

    .. math:: F = \max(0,\; K x + B \dot x), \quad F = 0 \text{ for } x \le 0

    Equation (1) lets the force turn negative at release, where the material would pull the probe; here the force
    is never negative.

    Args:
        stiffness: K [N/m], positive.
        damping: B [N s/m], not negative.

    Raises:
        SettingError: A parameter out of range.
    """

    law: ClassVar[str] = "kelvin-voigt"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping")
    stiffness: float
    damping: float

    def __post_init__(self) -> None:
        require("stiffness", self.stiffness, above=0.0)
        require("damping", self.damping, at_least=0.0)

    def advance(
        self, state: ContactState, depth: float, velocity: float, sample_period: float
    ) -> tuple[ContactState, float, float]:
        """One step: see `foretouch.models.advance`."""
        force = self.stiffness * depth + self.damping * velocity if depth > 0.0 else 0.0
        return NO_STATE, max(0.0, force), float("nan")
