"""Last stage before the robot in space: keeps its position within the limits, whatever surface or pose is believed.

The force on the probe is kept below its ceiling in every direction.
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
"""Fraction of the force ceiling above which sliding slows down, until it stops at `AIMED`."""

AHEAD, RATE_SHARE = 0.02, 0.2
"""Look-ahead time of the force for sliding [s], and weight of a tick in the smoothing of the force's rate."""

RECOVERY = 0.002
"""Fraction of its speed by which a slide that was slowed may grow per tick: a probe that slips after it has stuck would
otherwise reach full speed before its force is felt."""

CONE = 0.8
"""Cosine of the largest angle between force and normal that friction explains."""

FELT = 1.0
"""Smallest force that counts as a contact that matters [N]."""


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
        """Take the probe's position [m], the measured force [N] and the believed normal.

        A NaN force is unknown: nothing slides, and nothing goes deeper.
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


NO_VECTOR: Vector = (0.0, 0.0, 0.0)

ALIGNED = math.cos(0.5)
"""Cosine of the largest angle between a normal and the surface's mean one; a normal turned further is taken for an
edge's: few slopes of a surface of heights are as steep."""


class LastLimit:
    """Brings the aim of safety along the normal into space, and limits speed, acceleration and jerk there.

    In this order: the position on the course with this aim; no further against the force than `ForceCap` allows; then
    `MotionLimits`, as on a line. Three directions are limited to the speed that safety allows: outside the surface,
    against its mean normal, for it may be elsewhere than believed, so that another part of it is near; into the
    surface from the robot's commanded position; and against the force on the probe or, where none is felt, into the
    surface under it. Over a flat surface they are the same, at an edge they differ.

    Args:
        safety: Safety layer whose aims are brought into space, and whose limits hold there.
        line: Line of the commanded positions.
        sample_period: Sample period [s].

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
        """Begin at the robot's position [m], at rest."""
        self._limits.begin(*place)
        self.line.follow(place)

    def believe(self, pose: Sequence[float], offset: float) -> None:
        """Take a new believed pose of the fixture, with this offset of the probe's line [m]."""
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
        """Speeds of the commanded position along the surface and into it [m/s]."""
        velocity, closest = self._limits.velocity, self.line.closest
        if closest is None:
            return 0.0, 0.0
        inwards = -dot(velocity, closest.normal)
        return norm(add(velocity, scaled(closest.normal, inwards))), inwards

    def update(self, course: Course, aim: float, *, free: bool) -> tuple[Vector, float]:
        """One tick: the position for the robot, and its coordinate along the course's normal [m].

        Args:
            course: Course with this tick's closest point.
            aim: Aim of safety along the normal [m].
            free: Whether the air around the probe is known to be free.
        """
        safety, limits, line = self._safety, self._limits, self.line
        before, gone, closest = limits.place, course.closest, line.closest
        if gone is None or closest is None or not math.isfinite(aim):
            return before, aim
        allowed = course.held_at(aim)
        wanted, shifted = self._cap.limit(allowed, before)
        shifted = add(shifted, scaled(gone.normal, -safety.shifted))
        deeper = max(safety.fastest, 0.0)
        facing = line.motion.rotate(self._facing) if closest.depth < 0.0 else NO_VECTOR
        # Beside an edge the approach was proven towards the edge, and not down to where the surface may go on.
        beside = not free and dot(facing, closest.normal) < ALIGNED
        down = min(deeper, safety.blind_speed) if beside else deeper
        bounds = _against(facing, down), _against(closest.normal, deeper), self._cap.bound(deeper)
        commanded = limits.move(wanted, bounds, shifted)
        here = line.follow(commanded)
        position = aim + dot(subtract(allowed, commanded), gone.normal)
        safety.went(position, -dot(limits.velocity, here.normal), here.along)
        return commanded, position


def _against(normal: Vector, speed: float) -> Bound:
    """Limit the speed against a normal [m/s]."""
    x, y, z = normal
    return -x, -y, -z, speed
