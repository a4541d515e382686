"""The motion of a probe and the force on it, as they are compared where it slides."""

from __future__ import annotations

import math

from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.session.network.playout import NOWHERE
from foretouch.session.settings import SAMPLE_PERIOD

LATE = 8e-3  # Time constant of the low-pass of force and velocity, by which they are late [s]: ticks are mostly noise


class Sliding:
    """Force on a probe and its velocity, low-passed alike.

    Attributes:
        place: Newest position of the probe [m].
        velocity: [m/s].
        force: [N].
    """

    def __init__(self) -> None:
        self.place: Vector = NOWHERE
        self.velocity: Vector = (0.0, 0.0, 0.0)
        self.force: Vector = (0.0, 0.0, 0.0)

    def take(self, place: Vector, force: Vector, seconds: float = SAMPLE_PERIOD) -> None:
        """Take the next position [m] and force [N], after a time [s]; what is no number changes nothing."""
        smoothed = -math.expm1(-seconds / LATE)
        step = subtract(place, self.place)
        if math.isfinite(step[0] + step[1] + step[2]):
            speed = scaled(step, 1.0 / seconds)
            self.velocity = add(self.velocity, scaled(subtract(speed, self.velocity), smoothed))
        if math.isfinite(force[0] + force[1] + force[2]):
            self.force = add(self.force, scaled(subtract(force, self.force), smoothed))
        self.place = place

    @property
    def point(self) -> Vector:
        """Where the probe was when force and velocity were as they are now said to be [m]."""
        return subtract(self.place, scaled(self.velocity, LATE))

    def across(self) -> float:
        """Speed across the force [m/s]; NaN without a force."""
        size = norm(self.force)
        if size == 0.0:
            return math.nan
        normal = scaled(self.force, 1.0 / size)
        return norm(subtract(self.velocity, scaled(normal, dot(self.velocity, normal))))
