"""Motion along a surface, within limits, and not against what holds it."""

from __future__ import annotations

import math

from foretouch.quantities.rigid import Vector, add, dot, norm, scaled, subtract
from foretouch.session.force_guard import ForceGuard
from foretouch.session.motion_limits import MotionLimits

__all__ = ["LateralMotion"]

HELD = 0.7
"""Share of the largest force that an obstacle sideways is pushed with at most."""

OBSTACLE = 0.5
"""What is more than friction by so much is an obstacle [N]."""


class LateralMotion:
    """Moves the place that is followed, of which only the part along the surface is used.

    Speed, acceleration and jerk are limited as along the normal (`MotionLimits`), each component to its share, so that
    no direction has more than the limit. A force along the surface that no friction explains, for it is larger than the
    one along the normal, is an obstacle that nobody knew: against it the place moves only as `ForceGuard` allows.

    Args:
        speed: [m/s], positive.
        acceleration: [m/s^2], positive.
        jerk: [m/s^3], positive.
        sample_period: [s], positive.

    Attributes:
        place: Where it is [m]; None before the first update.
    """

    __slots__ = ("_allowed", "_axes", "_guard", "_inwards", "_period", "_speed", "_wanted", "place")

    def __init__(self, speed: float, acceleration: float, jerk: float, sample_period: float) -> None:
        share = 1.0 / math.sqrt(3.0)
        self._axes = [MotionLimits(share * speed, share * acceleration, share * jerk, sample_period) for _ in range(3)]
        self._speed, self._period = speed, sample_period
        self._wanted: Vector | None = None
        self._inwards: Vector | None = None  # into the obstacle
        self._allowed = 0.0  # how far in that direction
        self._guard = ForceGuard()
        self.place: Vector | None = None

    def update(
        self,
        target: Vector | None,
        here: Vector,
        resistance: Vector,
        pressed: float,
        *,
        limit: float,
        speed: float = math.inf,
    ) -> Vector:
        """One tick: the place [m].

        Args:
            target: Where it is to go; None to stay.
            here: Where the probe is.
            resistance: Force along the surface on the probe [N].
            pressed: Force along the normal [N].
            limit: Largest force [N].
            speed: No faster than this [m/s].
        """
        wanted = here if self._wanted is None else self._wanted
        if target is not None:
            step = subtract(target, wanted)
            length, longest = norm(step), min(speed, self._speed) * self._period
            wanted = add(wanted, scaled(step, longest / length)) if length > longest else target
        self._wanted = wanted
        x, y, z = (axis.update(value) for axis, value in zip(self._axes, wanted, strict=True))
        self.place = self._held_back((x, y, z), here, resistance, pressed, limit)
        return self.place

    def _held_back(self, path: Vector, here: Vector, resistance: Vector, pressed: float, limit: float) -> Vector:
        """The path, but no further against an obstacle than its force allows."""
        force = norm(resistance)
        if not force < math.inf:
            return self.place or path  # nobody knows what it would push
        unexplained = force - max(pressed, 0.0)
        if self._inwards is None:
            if unexplained <= OBSTACLE:
                return path
            self._inwards = scaled(resistance, -1.0 / force)
            self._allowed = dot(self.place or path, self._inwards)
            self._guard = ForceGuard()
        inwards = self._inwards
        against = -dot(resistance, inwards) - max(pressed, 0.0)
        self._guard.observe(dot(here, inwards), against, against > OBSTACLE)
        self._allowed += max(self._guard.speed(HELD * limit), -self._speed) * self._period
        beyond = dot(path, inwards) - self._allowed
        if beyond <= 0.0:
            if unexplained <= OBSTACLE:
                self._inwards = None  # it goes elsewhere
            self._allowed = dot(path, inwards)
            return path
        return subtract(path, scaled(inwards, beyond))
