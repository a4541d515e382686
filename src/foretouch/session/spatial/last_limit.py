"""The last stage before the robot in space: whatever surface, normal or pose is believed, a place within the limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.session.motion_limits import Bound
from foretouch.session.safety import Safety
from foretouch.session.spatial.course import Course
from foretouch.session.spatial.force_cap import ForceCap
from foretouch.session.spatial.line import SurfaceLine

__all__ = ["LastLimit"]

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
