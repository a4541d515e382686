"""The path of the robot in space to the commands, and its coordinate along the normal, a position as along a line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.quantities.pose import RigidMotion, Vector, add, dot, norm, scaled, subtract
from foretouch.rendering.surfaces import Plane, Surface, SurfaceProxy
from foretouch.rendering.surfaces.god_object import NO_MESH, Proxy
from foretouch.rendering.surfaces.line import START, Line, followed, shape_of
from foretouch.session.safety.force_guard import ForceGuard, guarded_speed

Numbers6: TypeAlias = tuple[float, float, float, float, float, float]
"""A position [m] and a rotation vector [rad]."""

FARTHEST = 10.0  # No fixture is believed further away than this [m], or turned by more [rad]


class ClosestPoint(NamedTuple):
    """Closest point of the surface to a position, in the world's frame.

    Attributes:
        depth: Depth in the surface where it is believed to be [m], negative outside.
        along: The coordinate: `depth`, and all displacements of the believed surface since the start [m].
        normal: Outward, of length 1; outside, from the nearest point to the position.
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
    """Follows a position against a surface on a fixture whose believed pose changes.

    .. math:: q = d + o

    d is the depth in the surface; the offset o keeps q where it was when the belief changes, for a fixture that is seen
    elsewhere is no motion. So q is as continuous as the motion itself, grows into the material as positions along a
    line do, and the surface stands at o in it. Everything made for a line (identification, mediation, safety) takes q
    for the position and o for the surface. The same is done where the proxy lets go, over an edge: then the depth
    changes by more than the position.

    Args:
        surface: Surface in the fixture's frame.
        pose: Pose of the fixture: a position [m] and a rotation vector [rad].
        leads: Whether it has an offset of its own; otherwise it is that of another line, set by the caller.
        records: Array of one `Line` that this one takes, part of another record; None for one of its own.

    Attributes:
        motion: The believed pose as a rigid motion.
        offset: o [m].
        closest: Closest point of the newest position; None before it.
        records: Its state, for compiled code: `foretouch.rendering.surfaces.line.follow_line`.
        shape: The surface's, for the same; without triangles for a surface of Python's own, too.
    """

    __slots__ = ("_closest", "_offset", "_proxy", "motion", "pose", "records", "shape", "surface")

    def __init__(
        self, surface: Surface, pose: Sequence[float], *, leads: bool = True, records: NDArray[np.void] | None = None
    ) -> None:
        shape = shape_of(surface)
        self.records = Line.new() if records is None else records
        self.records[:] = Line.new(leads=leads, compiled=shape is not None)
        if isinstance(surface, Plane):
            self.records["origin"], self.records["normal"] = surface.origin, surface.normal
        self._offset, self._closest = self.records["offset"], self.records["closest"].view(np.float64)
        self._proxy = SurfaceProxy(surface)
        self.surface, self.shape = surface, NO_MESH if shape is None else shape
        self._move(pose)

    @property
    def offset(self) -> float:
        """See above."""
        return float(self._offset[0])

    @offset.setter
    def offset(self, offset: float) -> None:
        self._offset[0] = offset

    @property
    def closest(self) -> ClosestPoint | None:
        """See above."""
        depth, along, a, b, c, d, e, f, g, h, i, place, *_ = self._closest.tolist()
        return None if math.isnan(place) else ClosestPoint(depth, along, (a, b, c), (d, e, f), (g, h, i))

    def believe(self, pose: Sequence[float]) -> bool:
        """Believe the fixture elsewhere; the newest coordinate stays. Whether that was any news.

        A pose that is not six finite numbers within 10 m and 10 rad is left out.
        """
        if len(pose) != 6 or not all(abs(number) <= FARTHEST for number in pose) or _six(pose) == self.pose:
            return False
        self._move(pose)
        x, y, z = self._closest[-3:].tolist()
        if not math.isnan(x):
            self.follow((x, y, z))
        return True

    def follow(self, place: Vector) -> ClosestPoint:
        """Follow a place [m]; one that is not finite is left out."""
        x, y, z = place
        self.touch(place)
        return ClosestPoint(*followed.entry(self.records, self.shape, x, y, z))

    def touch(self, place: Vector) -> None:
        """Move the proxy on a surface of Python's own, which compiled code cannot, after a place [m]."""
        if self.records["compiled"][0]:
            return
        if not all(map(math.isfinite, place)):
            if self.closest is not None:
                return
            place = self.motion.apply(START)
        contact, proxy = self._proxy.follow(self.motion.apply_back(place)), self.records["proxy"]
        proxy["depth"], proxy["normal"], proxy["point"] = contact.depth, contact.normal, contact.point

    def restart(self) -> None:
        """Forget from which side the probe came; the coordinate goes on where it was."""
        self._proxy.restart()
        self.records["proxy"] = Proxy.new()

    def _move(self, pose: Sequence[float]) -> None:
        self.pose: Numbers6 = _six(pose)
        self.motion = RigidMotion.from_numbers(pose)
        self.records["rotation"], self.records["translation"] = self.motion[:3], self.motion.translation


def _six(pose: Sequence[float]) -> Numbers6:
    x, y, z, a, b, c = (float(number) for number in pose)
    return x, y, z, a, b, c


HELD = 0.7  # Fraction of the largest force with which an obstacle at the side is pushed at most
OBSTACLE = 0.5  # Excess over friction above which a force is an obstacle [N]

NOWHERE = (math.nan, math.nan, math.nan)
NO_VECTOR: Vector = (0.0, 0.0, 0.0)


class Way(NamedTuple):
    """Inputs of a tick's course.

    Attributes:
        open: Whether the robot follows: otherwise the course stays where it is.
        here: Position of the probe [m].
        resistance: Force along the surface on the probe [N].
        pressed: Force along the normal [N].
        sliding: Largest speed along the surface [m/s].
        deeper: Largest speed into the surface now [m/s].
    """

    open: bool
    here: Vector
    resistance: Vector
    pressed: float
    sliding: float
    deeper: float


class Course:
    r"""Goes from the robot's position towards the commands, and holds back where safety does not allow it.

    The position c of the course goes to the commanded one no faster than the robot may; along the surface no faster
    than it may slide; outwards at once. A force along the surface that no friction explains, for it is larger than the
    one along the normal, is an unknown obstacle: against it the course goes only as `ForceGuard` allows.

    Its coordinate q along the normal n of its closest point goes through safety as a position on a line does. The
    result, an aim that is no deeper, is brought into space by a vector h to

    .. math:: c + h, \quad h \to (q - aim)\, n

    which follows the aim at once, and the normal only at the return speed: a normal that flips at an edge moves nothing
    at first. For the same reason a step of q that no motion explains, where the nearest point of the surface is another
    or a fixture is believed elsewhere, is let in at that speed. Where nothing is held back, c + h is the command
    itself, whatever is believed of the surface.

    Args:
        line: Line of the course, with an offset of its own.
        ceiling: Ceiling of the force [N].
        speed: Largest speed of the robot [m/s].
        return_speed: Speed at which it takes in changes that no motion explains [m/s].
        sample_period: Sample period [s].

    Attributes:
        place: c [m]; NaN before it has begun.
        closest: Closest point of c.
        way: Inputs of this tick.
    """

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
        """Step towards the command in this tick."""
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
