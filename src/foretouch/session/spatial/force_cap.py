"""The force on the probe kept below its ceiling whichever way it points, and whatever is believed of the surface."""

from __future__ import annotations

import math

from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.session.force_guard import PATIENCE, ForceGuard
from foretouch.session.motion_limits import Bound
from foretouch.session.safety import AIMED

__all__ = ["ForceCap"]

SLOWED = 0.6
"""Share of the ceiling from which on sliding gets slower, until it stands at `AIMED`."""

AHEAD, RATE_SHARE = 0.02, 0.2
"""Sliding reckons with the force as it will be after so long [s]; its rate is smoothed by this share a tick."""

RECOVERY = 0.002
"""A slide that was slowed down may grow faster again by so much of its speed a tick: what slips after it has stuck
would be at its full speed before the force of that is felt."""

CONE = 0.8
"""Cosine of the largest angle between a force and the normal that friction explains."""

FELT = 1.0
"""Less is no contact that matters [N]."""


class ForceCap:
    """A limit in space: along the force that is measured, whatever normal is believed.

    Within the cone in which friction may turn a force its direction is that of the believed normal: who goes back along
    friction slides the other way, and it turns.

    The place goes no deeper against the force than `ForceGuard` allows for 88 % of the ceiling, by the way that the
    probe has gone against it, and goes back where that is passed. Where the normal does not explain the force, what was
    proven along it says nothing of this material, which counts as damped as one that nobody has touched. And who slides
    while the force nears the ceiling is slowed down: a surface that rises on the way makes a force grow that no depth
    explains.

    Args:
        ceiling: [N], positive.
        most_damped: That a material counts as which nobody has touched [N s/m], not negative.
        speed: Largest of the robot [m/s], positive.
        sample_period: [s], positive.

    Attributes:
        fastest: Speed against the force at most, negative where it has to go back [m/s].
    """

    __slots__ = (
        "_ceiling",
        "_force",
        "_guard",
        "_here",
        "_known",
        "_most_damped",
        "_outwards",
        "_period",
        "_place",
        "_rate",
        "_slide",
        "_sliding",
        "_speed",
        "_way",
        "fastest",
    )

    def __init__(self, ceiling: float, most_damped: float, speed: float, sample_period: float) -> None:
        self._ceiling, self._speed, self._period = ceiling, speed, sample_period
        self._most_damped = most_damped
        self._guard = ForceGuard()
        self._here: Vector | None = None
        self._place: Vector | None = None
        self._outwards: Vector = (0.0, 0.0, 1.0)
        self._way = self._force = self._rate = self.fastest = 0.0
        self._known, self._sliding, self._slide = False, 1.0, 0.0

    def observe(self, here: Vector, force: Vector, normal: Vector) -> None:
        """See where the probe is [m], what it feels [N] and what normal is believed.

        A force that is no number is not known: nothing slides, and nothing goes deeper.
        """
        size = norm(force)
        if not (size < math.inf and all(map(math.isfinite, here))):
            self._guard.observe(math.nan, math.nan, False)
            self._known, self._sliding, self.fastest = False, 0.0, 0.0
            return
        self._known, felt = True, size > FELT
        unexplained = felt and dot(force, normal) <= CONE * size
        self._outwards = scaled(force, 1.0 / size) if unexplained else normal
        if self._here is not None and felt:
            self._way -= dot(subtract(here, self._here), self._outwards)
        self._here = here
        self._guard.observe(self._way, size, felt)
        damping = self._most_damped if unexplained else 0.0
        self.fastest = self._guard.speed(AIMED * self._ceiling, damping) if felt else math.inf
        self._rate += RATE_SHARE * ((size - self._force) / self._period - self._rate)
        self._force = size
        coming = size + max(self._rate, 0.0) * AHEAD
        allowed = (AIMED * self._ceiling - coming) / ((AIMED - SLOWED) * self._ceiling)
        self._sliding = min(max(allowed, 0.0), 1.0, self._sliding + RECOVERY)

    def slide(self, fastest: float) -> float:
        """How fast the probe may slide now, where all but the force allows so much [m/s].

        In contact that grows no faster than a slide that was slowed down recovers, whatever becomes allowed at once.
        """
        speed = self._sliding * fastest
        if self._force > FELT:
            speed = min(speed, self._slide + RECOVERY * self._speed)
        self._slide = speed
        return speed

    def limit(self, wanted: Vector, told: Vector) -> tuple[Vector, Vector]:
        """The place that is allowed, and by how far it was set elsewhere, which is no motion of it [m].

        Args:
            wanted: [m].
            told: Where the robot was told to be in the tick before [m].
        """
        before, self._place, shifted = self._place, wanted, (0.0, 0.0, 0.0)
        if before is None:
            return wanted, shifted
        if not self._known:
            self._place = before
            return before, shifted
        outwards, deeper = self._outwards, max(self.fastest, 0.0)
        # Never further on than the path soon is, for it would slide and press on by itself.
        shifted = subtract(add(told, self._shortened(subtract(before, told), self._slide * PATIENCE)), before)
        before = add(before, shifted)
        self._place = add(before, self._shortened(subtract(wanted, before), self._slide * self._period))
        if self._force > FELT:
            back = max(dot(subtract(told, before), outwards) - deeper * PATIENCE, 0.0)
            inwards = back - dot(subtract(self._place, before), outwards)
            most = min(max(self.fastest, -self._speed), self._speed) * self._period
            if inwards > most:
                self._place = add(self._place, scaled(outwards, inwards - most))
                shifted = add(shifted, scaled(outwards, back))
        return self._place, shifted

    def _shortened(self, step: Vector, longest: float) -> Vector:
        """A step whose part across the force is no longer than this [m].

        A course that goes out of a surface that stands otherwise than believed may slide along the true one.
        """
        along = scaled(self._outwards, dot(step, self._outwards))
        across = subtract(step, along)
        length = norm(across)
        return add(along, scaled(across, longest / length)) if length > longest else step

    def bound(self, fastest: float) -> Bound:
        """Against the force no faster than it allows, nor than this [m/s]; where none is felt, along the normal."""
        x, y, z = self._outwards
        return -x, -y, -z, max(min(self.fastest, fastest), 0.0)
