"""The last stage before the robot in space: whatever surface, normal or pose is believed, a place within the limits.

The force on the probe is kept below its ceiling whichever way it points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.session.safety.force_guard import PATIENCE, ForceGuard
from foretouch.session.safety.kernel import AIMED
from foretouch.session.safety.motion import Bound
from foretouch.session.safety.safety import Safety
from foretouch.session.spatial.course import Course, SurfaceLine

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


NO_VECTOR: Vector = (0.0, 0.0, 0.0)

ALIGNED = math.cos(0.5)
"""A normal that is turned further than this against the surface's mean one is taken for an edge's: few slopes of a
surface of heights are as steep."""


class LastLimit:
    """Brings what safety aims at along the normal into space, and limits speed, acceleration and jerk there.

    In this order: the place of the course with this aim; no further against the force than `ForceCap` allows; and then
    `MotionLimits`, as on a line. At most as fast as safety allows it goes in three directions: outside the surface,
    against its mean normal, for it may stand elsewhere than believed, so that another part of it is near; into the
    surface from where the robot was told to be; and against the force on the probe or, where none is felt, into the
    surface under it. Over a flat one they are the same, at an edge they differ.

    Args:
        safety: Whose aims are brought into space, and whose limits hold there.
        line: Of the places that the robot is told.
        sample_period: [s].

    Attributes:
        line: As given.
    """

    __slots__ = ("_cap", "_facing", "_limits", "_safety", "line")

    def __init__(self, safety: Safety, line: SurfaceLine, sample_period: float) -> None:
        self._safety, self.line = safety, line
        self._limits = safety.in_space()
        limits = safety.limits
        self._cap = ForceCap(limits.force, limits.most_damped, limits.speed, sample_period)
        self._facing = line.surface.facing()

    def begin(self, place: Vector) -> None:
        """Begin where the robot is [m], at rest."""
        self._limits.begin(*place)
        self.line.follow(place)

    def believe(self, pose: Sequence[float], offset: float) -> None:
        """Believe the fixture elsewhere, the probe's line having this offset [m]."""
        self.line.offset = offset
        self.line.believe(pose)

    def observe(self, here: Vector, force: Vector, normal: Vector) -> None:
        """See `ForceCap.observe`."""
        self._cap.observe(here, force, normal)

    def slide(self, fastest: float) -> float:
        """See `ForceCap.slide`."""
        return self._cap.slide(fastest)

    @property
    def going(self) -> tuple[float, float]:
        """Speeds of the told place along the surface and into it [m/s]."""
        velocity, footing = self._limits.velocity, self.line.footing
        if footing is None:
            return 0.0, 0.0
        inwards = -dot(velocity, footing.normal)
        return norm(add(velocity, scaled(footing.normal, inwards))), inwards

    def update(self, course: Course, aim: float, *, free: bool) -> tuple[Vector, float]:
        """One tick: the place for the robot, and its position along the course's normal [m].

        Args:
            course: With this tick's footing.
            aim: Of safety along the normal [m].
            free: Whether the air that the probe is in is known to be free.
        """
        safety, limits, line = self._safety, self._limits, self.line
        before, gone, footing = limits.place, course.footing, line.footing
        if gone is None or footing is None or not math.isfinite(aim):
            return before, aim
        allowed = course.held_at(aim)
        wanted, shifted = self._cap.limit(allowed, before)
        shifted = add(shifted, scaled(gone.normal, -safety.shifted))
        deeper = max(safety.fastest, 0.0)
        facing = line.motion.rotate(self._facing) if footing.depth < 0.0 else NO_VECTOR
        # Beside an edge the way in was proven towards the edge, and not down to where the surface may go on.
        beside = not free and dot(facing, footing.normal) < ALIGNED
        down = min(deeper, safety.blind_speed) if beside else deeper
        bounds = _against(facing, down), _against(footing.normal, deeper), self._cap.bound(deeper)
        told = limits.move(wanted, bounds, shifted)
        here = line.follow(told)
        position = aim + dot(subtract(allowed, told), gone.normal)
        safety.went(position, -dot(limits.velocity, here.normal), here.along)
        return told, position


def _against(normal: Vector, speed: float) -> Bound:
    """Against a normal at most so fast [m/s]."""
    x, y, z = normal
    return -x, -y, -z, speed
