"""Motion along a surface, within limits, and not against what holds it."""

from __future__ import annotations

import math

from foretouch.quantities.rigid import Vector, add, norm, scaled, subtract
from foretouch.session.motion_limits import MotionLimits

__all__ = ["LateralMotion"]

SLOWED, STOPPED = 0.5, 0.9
"""Shares of the largest force: from the first on the motion gets slower, at the second it stops, beyond it yields."""

YIELDING = 0.02
"""Speed at which it gives way to a force beyond that [m/s]."""


class LateralMotion:
    """Moves the place that is followed, of which only the part along the surface is used.

    Speed, acceleration and jerk are limited as along the normal (`MotionLimits`), each component to its share, so that
    no direction has more than the limit. What pushes against the motion along the surface slows it down, stops it, and
    in the end pushes it back: an obstacle that nobody knew is met no harder sideways than along the normal.

    Args:
        speed: [m/s], positive.
        acceleration: [m/s^2], positive.
        jerk: [m/s^3], positive.
        sample_period: [s], positive.

    Attributes:
        place: Where it is [m]; None before the first update.
    """

    __slots__ = ("_axes", "_period", "_speed", "_wanted", "place")

    def __init__(self, speed: float, acceleration: float, jerk: float, sample_period: float) -> None:
        share = 1.0 / math.sqrt(3.0)
        self._axes = [MotionLimits(share * speed, share * acceleration, share * jerk, sample_period) for _ in range(3)]
        self._speed, self._period = speed, sample_period
        self._wanted: Vector | None = None
        self.place: Vector | None = None

    def update(
        self, target: Vector | None, here: Vector, resistance: Vector, *, limit: float, speed: float = math.inf
    ) -> Vector:
        """One tick: the place [m].

        Args:
            target: Where it is to go; None to stay.
            here: Where it is, for the first tick.
            resistance: Force along the surface on the probe [N].
            limit: Largest force [N].
            speed: No faster than this [m/s].
        """
        wanted = here if self._wanted is None else self._wanted
        pushed = norm(resistance) / limit
        if pushed > STOPPED:
            wanted = add(wanted, scaled(resistance, YIELDING * self._period / norm(resistance)))
        elif target is not None:
            step = subtract(target, wanted)
            length = norm(step)
            against = step[0] * resistance[0] + step[1] * resistance[1] + step[2] * resistance[2] < 0.0
            share = min((STOPPED - pushed) / (STOPPED - SLOWED), 1.0) if against else 1.0
            longest = min(speed, self._speed) * share * self._period
            wanted = add(wanted, scaled(step, longest / length)) if length > longest else target
        self._wanted = wanted
        x, y, z = (axis.update(value) for axis, value in zip(self._axes, wanted, strict=True))
        self.place = (x, y, z)
        return self.place
