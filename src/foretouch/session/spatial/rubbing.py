"""What friction is learnt from: force and speed along the surface, smoothed alike."""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.quantities import Brief
from foretouch.quantities.pose import Vector, add, scaled, subtract
from foretouch.session.settings import SAMPLE_PERIOD

__all__ = ["Rubbed"]

SMOOTHED = -math.expm1(-2.0 * math.pi * 20.0 * SAMPLE_PERIOD)


@dataclass(slots=True)
class Rubbed(Brief):
    """What friction is learnt from, through one low-pass of 20 Hz: the speed of one tick is mostly the encoders' noise.

    Attributes:
        pressed: Along the normal [N].
        sideways: Along the surface [N].
        sliding: Velocity along the surface [m/s].
    """

    pressed: float = 0.0
    sideways: Vector = (0.0, 0.0, 0.0)
    sliding: Vector = (0.0, 0.0, 0.0)

    def update(self, pressed: float, sideways: Vector, sliding: Vector) -> None:
        """One tick."""
        self.pressed += SMOOTHED * (pressed - self.pressed)
        self.sideways = add(self.sideways, scaled(subtract(sideways, self.sideways), SMOOTHED))
        self.sliding = add(self.sliding, scaled(subtract(sliding, self.sliding), SMOOTHED))
