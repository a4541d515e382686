"""Where what is pressed begins and how far in it is pressed, for whoever moves the hand."""

from __future__ import annotations

import math
from typing import NamedTuple

__all__ = ["UNKNOWN_REACH", "Reach"]


class Reach(NamedTuple):
    """What an operator may know of the material, at the hand.

    Attributes:
        surface: Where it begins [m]; NaN where nobody knows.
        press_depth: How deep the deepest press goes [m]; NaN where nobody knows.
    """

    surface: float
    press_depth: float

    @property
    def known(self) -> bool:
        """Whether both are known."""
        return math.isfinite(self.surface) and math.isfinite(self.press_depth)


UNKNOWN_REACH = Reach(math.nan, math.nan)
"""Of a robot that does not say what it presses: the surface is found by touching."""
