"""What static friction has more than Coulomb's at a speed, compiled."""

from __future__ import annotations

import math

from foretouch.core import compiled
from foretouch.models.friction import SLOW


@compiled
def at_rest(speed: float) -> float:
    """How much of the excess of static friction is left at a speed [m/s], 1 at rest: exp(-(v / 5 mm/s)^2)."""
    return math.exp(-(speed / SLOW) * (speed / SLOW))
