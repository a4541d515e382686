"""Where the robot in space is on its way to, and the coordinate along the normal, by which it runs as one along a line.

The course stands between the place that is commanded and the one that is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from foretouch.quantities.pose import RigidMotion, Vector, add, dot, norm, scaled, subtract, unit
from foretouch.rendering.surfaces import Surface, SurfaceProxy
from foretouch.session.safety.force_guard import ForceGuard, guarded_speed

Numbers6: TypeAlias = tuple[float, float, float, float, float, float]
"""A position [m] and a rotation vector [rad]."""


ROUNDING = 1e-9
"""[m]."""

FARTHEST = 10.0
"""No fixture is believed further away than this [m], or turned by more [rad]."""


class ClosestPoint(NamedTuple):
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
        closest: Of the newest place; None before it.
    """

    __slots__ = ("_leads", "_place", "_proxy", "closest", "motion", "offset", "pose", "surface")

    def __init__(self, surface: Surface, pose: Sequence[float], *, leads: bool = True) -> None:
        self._leads = leads
        self._proxy = SurfaceProxy(surface)
        self.surface = surface
        self._place: Vector | None = None
        self.pose: Numbers6 = _six(pose)
        self.motion = RigidMotion.from_numbers(pose)
        self.offset = 0.0
        self.closest: ClosestPoint | None = None

    def believe(self, pose: Sequence[float]) -> bool:
        """Believe the fixture elsewhere; the coordinate of the newest place stays. Whether that was any news.

        A pose that is not six finite numbers within 10 m and 10 rad is left out.
        """
        if len(pose) != 6 or not all(abs(number) <= FARTHEST for number in pose) or _six(pose) == self.pose:
            return False
        before = self.closest
        self.pose, self.motion = _six(pose), RigidMotion.from_numbers(pose)
        if before is not None and self._place is not None:
            self.follow(self._place)
        return True

    def follow(self, place: Vector) -> ClosestPoint:
        """Follow a place [m]; one that is not finite is left out."""
        if not all(map(math.isfinite, place)):
            if self.closest is not None:
                return self.closest
            place = self.motion.apply((0.0, 0.0, 0.1))
        before, moved = self.closest, math.inf if self._place is None else math.dist(place, self._place)
        self._place = place
        motion = self.motion
        contact = self._proxy.follow(motion.apply_back(place))
        point, normal = motion.apply(contact.point), motion.rotate(contact.normal)
        if contact.depth < 0.0:
            normal = unit(subtract(place, point), normal)
        if self._leads and before is not None and abs(contact.depth - before.depth) > moved + ROUNDING:
            self.offset += before.depth - contact.depth
        self.closest = ClosestPoint(contact.depth, contact.depth + self.offset, normal, point, contact.point)
        return self.closest

    def restart(self) -> None:
        """Forget from which side the place came; the coordinate goes on where it was."""
        self._proxy.restart()

    def outside(self, inner: Vector) -> Vector:
        """A point of the fixture's frame in the world's [m]."""
        return add(self.motion.rotate(inner), self.motion.translation)


def _six(pose: Sequence[float]) -> Numbers6:
    x, y, z, a, b, c = (float(number) for number in pose)
    return x, y, z, a, b, c


HELD = 0.7
"""Fraction of the largest force with which an obstacle at the side is pushed at most."""

OBSTACLE = 0.5
"""Excess over friction above which a force is an obstacle [N]."""

NOWHERE = (math.nan, math.nan, math.nan)
NO_VECTOR: Vector = (0.0, 0.0, 0.0)


class Way(NamedTuple):
    """What a tick's way depends on.

    Attributes:
        open: Whether the robot follows: otherwise the course stays where it is.
        here: Where the probe is [m].
        resistance: Force along the surface on the probe [N].
        pressed: Force along the normal [N].
        sliding: Speed along the surface at most [m/s].
        deeper: Speed at which it may go deeper now [m/s].
    """

    open: bool
    here: Vector
    resistance: Vector
    pressed: float
    sliding: float
    deeper: float


class Course:
    r"""Goes from where the robot is towards the commands, and holds back from there what safety does not allow.

    The place c of the course goes to the commanded one no faster than the robot may; along the surface no faster than
    it may slide; outwards at once. A force along the surface that no friction explains, for it is larger than the one
    along the normal, is an obstacle that nobody knew: against it the course goes only as `ForceGuard` allows.

    Its coordinate q along the normal n of its closest point goes through safety as a position on a line does. What is
    left of it, an aim that is no deeper, is brought into space by a vector h to

    .. math:: c + h, \quad h \to (q - aim)\, n

    which follows the aim at once, and the normal only at the return speed: a normal that flips at an edge moves
    nothing at first. For the same reason a step of q that no motion explains, where the nearest point of the surface is
    another or a fixture is believed elsewhere, is let in at that speed. Where nothing is held back, c + h is the
    command itself, whatever is believed of the surface.

    Args:
        line: Of the course: with an offset of its own.
        ceiling: Ceiling of the force [N].
        speed: Largest of the robot [m/s].
        return_speed: At which it takes in what no motion explains [m/s].
        sample_period: [s].

    Attributes:
        place: c [m]; no numbers before it has begun.
        line: As given.
        closest: Of c.
        way: Of this tick.
    """

    __slots__ = (
        "_allowed",
        "_apart",
        "_ceiling",
        "_guard",
        "_inwards",
        "_longest",
        "_period",
        "_return",
        "_size",
        "closest",
        "line",
        "place",
        "way",
    )

    def __init__(
        self, line: SurfaceLine, ceiling: float, speed: float, return_speed: float, sample_period: float
    ) -> None:
        self.line = line
        self._ceiling, self._period = ceiling, sample_period
        self._longest, self._return = speed * sample_period, return_speed * sample_period
        self._inwards: Vector | None = None  # into the obstacle
        self._allowed = 0.0  # how far in that direction
        self._guard = ForceGuard.new()
        self._apart = NO_VECTOR  # h
        self._size = 0.0  # q less the aim
        self.place: Vector = NOWHERE
        self.closest: ClosestPoint | None = None
        self.way = Way(False, NOWHERE, NO_VECTOR, 0.0, 0.0, 0.0)

    def begin(self, place: Vector) -> None:
        """Begin where the robot is [m]."""
        self.place = place
        self.closest = self.line.follow(place)

    def go(self, target: tuple[float, ...]) -> float:
        """One tick towards a place [m], on the way that was set before; returns q [m]."""
        closest = self.closest
        if closest is None:
            return math.nan
        if self.way.open:
            x, y, z = target
            step = self._step(subtract((x, y, z), self.place), closest.normal)
            self.place = self._held_back(add(self.place, step))
            self.closest = self.line.follow(self.place)
        return self.closest.along if self.closest is not None else math.nan

    def meet(self, offset: float) -> None:
        """Come nearer to the coordinate of the probe, whose line has this offset [m], no faster than it may return."""
        if not self.way.open or self.closest is None:
            return
        apart = offset - self.line.offset
        deeper = min(self._return, max(self.way.deeper, 0.0) * self._period)
        self.line.offset += min(max(apart, -self._return), deeper)
        self.closest = self.line.follow(self.place)

    def held_at(self, aim: float) -> Vector:
        """The place for an aim along the normal [m]."""
        closest = self.closest
        if closest is None:
            return NOWHERE
        before, self._size = self._size, max(closest.along - aim, 0.0)
        apart, normal = self._apart, closest.normal
        if self._size < before:
            apart = scaled(apart, self._size / before)
        else:
            apart = add(apart, scaled(normal, self._size - before))
        if self.way.open:
            turned = subtract(scaled(normal, self._size), apart)
            length = norm(turned)
            apart = add(apart, scaled(turned, self._return / length) if length > self._return else turned)
        self._apart = apart
        return add(self.place, apart)

    def _step(self, step: Vector, normal: Vector) -> Vector:
        """Of the way to the command what is gone in this tick."""
        outwards = scaled(normal, max(dot(step, normal), 0.0))
        rest = subtract(step, outwards)
        length = norm(rest)
        if length > self._longest:
            rest = scaled(rest, self._longest / length)
        sideways = subtract(rest, scaled(normal, dot(rest, normal)))
        length, longest = norm(sideways), self.way.sliding * self._period
        if length > longest:
            rest = subtract(rest, scaled(sideways, 1.0 - longest / length))
        return add(rest, outwards)

    def _held_back(self, path: Vector) -> Vector:
        """The path, but no further against an obstacle than its force allows."""
        way = self.way
        force = norm(way.resistance)
        if not force < math.inf:
            return self.place  # the obstacle's properties are unknown
        unexplained = force - max(way.pressed, 0.0)
        if self._inwards is None:
            if unexplained <= OBSTACLE:
                return path
            self._inwards = scaled(way.resistance, -1.0 / force)
            self._allowed = dot(self.place, self._inwards)
            self._guard = ForceGuard.new()
        inwards = self._inwards
        against = -dot(way.resistance, inwards) - max(way.pressed, 0.0)
        here, limit = dot(way.here, inwards), HELD * self._ceiling
        deeper = guarded_speed(self._guard, here, against, against > OBSTACLE, limit, 0.0)
        self._allowed += max(deeper * self._period, -self._longest)
        beyond = dot(path, inwards) - self._allowed
        if beyond <= 0.0:
            if unexplained <= OBSTACLE:
                self._inwards = None  # it goes elsewhere
            self._allowed = dot(path, inwards)
            return path
        return subtract(path, scaled(inwards, beyond))
