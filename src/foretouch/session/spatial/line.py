"""The coordinate along a surface's normal: what makes a session in space run as one along a line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from foretouch.quantities.pose import RigidMotion, Vector, add, scaled, subtract, unit
from foretouch.rendering.surfaces import Surface, SurfaceProxy

__all__ = ["Footing", "Numbers6", "SurfaceLine"]

Numbers6: TypeAlias = tuple[float, float, float, float, float, float]
"""A place [m] and a rotation vector [rad]."""


ROUNDING = 1e-9
"""[m]."""

FARTHEST = 10.0
"""No fixture is believed further away than this [m], or turned by more [rad]."""


class Footing(NamedTuple):
    """Where a place is against the surface, in the world's frame.

    Attributes:
        depth: In the surface where it is believed to be [m], negative outside.
        along: The coordinate: `depth` and all that the surface was believed elsewhere since the start [m].
        normal: Outward, of length 1; outside, from the nearest point to the place.
        point: The proxy on the surface [m].
        inner_point: The same in the fixture's frame [m].
    """

    depth: float
    along: float
    normal: Vector
    point: Vector
    inner_point: Vector

    def place_at(self, along: float) -> Vector:
        """The place on this normal with another coordinate [m]."""
        return subtract(self.point, scaled(self.normal, along - self.along + self.depth))


class SurfaceLine:
    r"""Follows a place against a surface on a fixture that is believed now here, now there.

    .. math:: q = d + o

    d is the depth in the surface, o what keeps q where it was when the belief moves: a fixture that is seen elsewhere
    is no motion of the place. So q is as continuous as the place's own motion, grows into the material as positions
    along a line do, and in it the surface stands at o. All that is made for a line (identification, mediation, safety)
    takes q for the position and o for the surface; a surface that moves is to it what it is along a line. The same is
    done where the proxy lets go, over an edge: then the depth changes by more than the place has moved.

    Args:
        surface: In the fixture's frame.
        pose: Of the fixture: a place [m] and a rotation vector [rad].
        leads: Whether it has an offset of its own; otherwise it is that of another line, set by the caller.

    Attributes:
        surface: As given.
        pose: That is believed.
        motion: The same, as a motion.
        offset: o [m].
        footing: Of the newest place; None before it.
    """

    __slots__ = ("_leads", "_place", "_proxy", "footing", "motion", "offset", "pose", "surface")

    def __init__(self, surface: Surface, pose: Sequence[float], *, leads: bool = True) -> None:
        self._leads = leads
        self._proxy = SurfaceProxy(surface)
        self.surface = surface
        self._place: Vector | None = None
        self.pose: Numbers6 = _six(pose)
        self.motion = RigidMotion.from_numbers(pose)
        self.offset = 0.0
        self.footing: Footing | None = None

    def believe(self, pose: Sequence[float]) -> bool:
        """Believe the fixture elsewhere; the coordinate of the newest place stays. Whether that was any news.

        A pose that is not six finite numbers within 10 m and 10 rad is left out.
        """
        if len(pose) != 6 or not all(abs(number) <= FARTHEST for number in pose) or _six(pose) == self.pose:
            return False
        before = self.footing
        self.pose, self.motion = _six(pose), RigidMotion.from_numbers(pose)
        if before is not None and self._place is not None:
            self.follow(self._place)
        return True

    def follow(self, place: Vector) -> Footing:
        """Follow a place [m]; one that is not finite is left out."""
        if not all(map(math.isfinite, place)):
            if self.footing is not None:
                return self.footing
            place = self.motion.apply((0.0, 0.0, 0.1))
        before, moved = self.footing, math.inf if self._place is None else math.dist(place, self._place)
        self._place = place
        motion = self.motion
        contact = self._proxy.follow(motion.apply_back(place))
        point, normal = motion.apply(contact.point), motion.rotate(contact.normal)
        if contact.depth < 0.0:
            normal = unit(subtract(place, point), normal)
        if self._leads and before is not None and abs(contact.depth - before.depth) > moved + ROUNDING:
            self.offset += before.depth - contact.depth
        self.footing = Footing(contact.depth, contact.depth + self.offset, normal, point, contact.point)
        return self.footing

    def restart(self) -> None:
        """Forget from which side the place came; the coordinate goes on where it was."""
        self._proxy.restart()

    def outside(self, inner: Vector) -> Vector:
        """A point of the fixture's frame in the world's [m]."""
        return add(self.motion.rotate(inner), self.motion.translation)


def _six(pose: Sequence[float]) -> Numbers6:
    x, y, z, a, b, c = (float(number) for number in pose)
    return x, y, z, a, b, c
