"""What a material is: a contact law at a place."""

from __future__ import annotations

from dataclasses import dataclass

from foretouch.errors.checks import require
from foretouch.models import ContactModel

DEFAULT_SURFACE = 0.010
"""Position of the undeformed surface [m]: the probe starts at 0, in free air."""


@dataclass(frozen=True)
class Material:
    """A material that the simulated robot presses.

    Attributes:
        name: Name in the registry, for example ``"foam-measured"``.
        description: One line for the user.
        provenance: Source of the numbers, one line.
        model: The contact law with its numbers.
        press_depth: A typical deepest press [m], positive.
        surface: Position of the undeformed surface [m], on the probe's path.
        pulls: Whether it holds the probe as it leaves, so that its force may be negative, and reach beyond the surface.
    """

    name: str
    description: str
    provenance: str
    model: ContactModel
    press_depth: float
    surface: float = DEFAULT_SURFACE
    pulls: bool = False

    def __post_init__(self) -> None:
        require("press_depth", self.press_depth, above=0.0)
        require("surface", self.surface)
