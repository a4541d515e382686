"""The force on the probe in space is kept below its ceiling in every direction, whatever normal is believed."""

from __future__ import annotations

import math

from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.session.safety.force_guard import PATIENCE, ForceGuard, guarded_speed
from foretouch.session.safety.kernel import AIMED
from foretouch.session.safety.motion import Bound

SLOWED = 0.6  # Fraction of the force ceiling above which sliding slows down, until it stops at `AIMED`

AHEAD, RATE_WEIGHT = 0.02, 0.2
"""Look-ahead time of the force for sliding [s], and weight of a tick in the smoothing of the force's rate."""

RECOVERY = 0.002
"""Fraction of its speed by which a slide that was slowed may grow per tick: a probe that slips after it has stuck would
otherwise reach full speed before its force is felt."""

CONE = 0.8  # Cosine of the largest angle between force and normal that friction explains
FELT = 1.0  # Smallest force that counts as a contact that matters [N]


class ForceCap:
    """Force limit in space: along the measured force, whatever normal is believed.

    Within the cone in which friction may turn a force its direction is that of the believed normal: friction turns
    when the probe slides back along it.

    The position goes no deeper against the force than `ForceGuard` allows for 88 % of the ceiling, by the distance that
    the probe has moved against it, and retreats where that is exceeded. Where the normal does not explain the force,
    what was proven along it says nothing of this material, which counts as damped as an untouched one. A slide is
    slowed down while the force nears the ceiling: a surface that rises on the way makes a force grow that no depth
    explains.

    Args:
        ceiling: Force ceiling [N], positive.
        most_damped: Damping assumed of an untouched material [N s/m], not negative.
        speed: Largest speed of the robot [m/s], positive.
        sample_period: Sample period [s], positive.

    Attributes:
        fastest: Largest speed against the force, negative where it has to retreat [m/s].
    """

    def __init__(self, ceiling: float, most_damped: float, speed: float, sample_period: float) -> None:
        self._ceiling, self._most_damped, self._speed, self._period = ceiling, most_damped, speed, sample_period
        self._guard = ForceGuard.new()
        self._here: Vector | None = None
        self._place: Vector | None = None
        self._outwards: Vector = (0.0, 0.0, 1.0)
        self._way = self._force = self._rate = self.fastest = 0.0
        self._known, self._sliding, self._slide = False, 1.0, 0.0

    def observe(self, here: Vector, force: Vector, normal: Vector) -> None:
        """Take the probe's position [m], the measured force [N] and the believed normal.

        A NaN force is unknown: nothing slides, and nothing goes deeper.
        """
        size = norm(force)
        if not (size < math.inf and all(map(math.isfinite, here))):
            self.fastest = guarded_speed(self._guard, math.nan, math.nan, False, 0.0, 0.0)
            self._known, self._sliding = False, 0.0
            return
        self._known, felt = True, size > FELT
        unexplained = felt and dot(force, normal) <= CONE * size
        self._outwards = scaled(force, 1.0 / size) if unexplained else normal
        if self._here is not None and felt:
            self._way -= dot(subtract(here, self._here), self._outwards)
        self._here = here
        damping = self._most_damped if unexplained else 0.0
        deeper = guarded_speed(self._guard, self._way, size, felt, AIMED * self._ceiling, damping)
        self.fastest = deeper if felt else math.inf
        self._rate += RATE_WEIGHT * ((size - self._force) / self._period - self._rate)
        self._force = size
        coming = size + max(self._rate, 0.0) * AHEAD
        allowed = (AIMED * self._ceiling - coming) / ((AIMED - SLOWED) * self._ceiling)
        self._sliding = min(max(allowed, 0.0), 1.0, self._sliding + RECOVERY)

    def slide(self, fastest: float) -> float:
        """Largest speed at which the probe may slide now, given the speed that all other limits allow [m/s].

        In contact it grows no faster than a slowed slide recovers, however suddenly more becomes allowed.
        """
        speed = self._sliding * fastest
        if self._force > FELT:
            speed = min(speed, self._slide + RECOVERY * self._speed)
        self._slide = speed
        return speed

    def limit(self, wanted: Vector, commanded: Vector) -> tuple[Vector, Vector]:
        """Allowed position, and its displacement by a limit, which is no motion of the position [m].

        Args:
            wanted: Wanted position [m].
            commanded: Position commanded to the robot in the tick before [m].
        """
        before, self._place, shifted = self._place, wanted, (0.0, 0.0, 0.0)
        if before is None:
            return wanted, shifted
        if not self._known:
            self._place = before
            return before, shifted
        outwards, deeper = self._outwards, max(self.fastest, 0.0)
        # Never beyond the next position on the path, for the probe would slide and press on by itself.
        shifted = subtract(add(commanded, self._shortened(subtract(before, commanded), self._slide * PATIENCE)), before)
        before = add(before, shifted)
        self._place = add(before, self._shortened(subtract(wanted, before), self._slide * self._period))
        if self._force > FELT:
            back = max(dot(subtract(commanded, before), outwards) - deeper * PATIENCE, 0.0)
            inwards = back - dot(subtract(self._place, before), outwards)
            most = min(max(self.fastest, -self._speed), self._speed) * self._period
            if inwards > most:
                self._place = add(self._place, scaled(outwards, inwards - most))
                shifted = add(shifted, scaled(outwards, back))
        return self._place, shifted

    def _shortened(self, step: Vector, longest: float) -> Vector:
        """Shorten a step so that its part across the force is at most this long [m].

        A course that leaves a surface inclined otherwise than believed may slide along the true one.
        """
        along = scaled(self._outwards, dot(step, self._outwards))
        across = subtract(step, along)
        length = norm(across)
        return add(along, scaled(across, longest / length)) if length > longest else step

    def bound(self, fastest: float) -> Bound:
        """Limit motion against the force, or along the normal where none is felt, to what it allows and this [m/s]."""
        x, y, z = self._outwards
        return -x, -y, -z, max(min(self.fastest, fastest), 0.0)
