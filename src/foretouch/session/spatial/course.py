"""The path of the robot in space to the commands, and its coordinate along the normal, a position as along a line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled
from foretouch.quantities.pose import RigidMotion, Vector
from foretouch.rendering.surfaces import Plane, Surface, SurfaceProxy
from foretouch.rendering.surfaces.geometry import Numbers3, add, dot, norm, scaled, subtract, vector, write
from foretouch.rendering.surfaces.god_object import NO_MESH, Mesh, Proxy
from foretouch.rendering.surfaces.line import START, Line, follow, follow_line, shape_of
from foretouch.session.safety.force_guard import ForceGuard, allowed_speed, forget_contact, observe

Numbers6: TypeAlias = tuple[float, float, float, float, float, float]
"""A position [m] and a rotation vector [rad]."""

FARTHEST = 10.0  # No fixture is believed further away than this [m], or turned by more [rad]


class ClosestPoint(NamedTuple):
    """Closest point of the surface to a position, in the world's frame.

    Attributes:
        depth: Depth in the surface where it is believed to be [m], negative outside; of a sphere, of its deepest point.
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


class SurfaceLine:
    """Follows a position against a surface on a fixture whose believed pose changes.

    .. math:: q = d + o

    d is the depth in the surface; the offset o keeps q where it was when the belief changes, for a fixture that is seen
    elsewhere is no motion. So q is as continuous as the motion itself, grows into the material as positions along a
    line do, and the surface stands at o in it. Everything made for a line (identification, mediation, safety) takes q
    for the position and o for the surface. The same is done where the proxy lets go, over an edge: then the depth
    changes by more than the position. The position of a sphere is its centre, on an `OffsetSurface`.

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

    __slots__ = ("_closest", "_follow", "_offset", "_proxy", "motion", "pose", "records", "shape", "surface")

    def __init__(
        self, surface: Surface, pose: Sequence[float], *, leads: bool = True, records: NDArray[np.void] | None = None
    ) -> None:
        shape = shape_of(surface)
        self.records = Line.new() if records is None else records
        self.records[:] = Line.new(leads=leads, compiled=shape is not None)
        self.records["radius"] = surface.radius
        if isinstance(bare := surface.bare, Plane):
            self.records["origin"], self.records["normal"] = bare.origin, bare.normal
        self._offset, self._closest = self.records["offset"], self.records["closest"].view(np.float64)
        self._proxy, self._follow = SurfaceProxy(bare), follow.entry
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
        return None if math.isnan(self._closest[-1]) else self.newest

    @property
    def newest(self) -> ClosestPoint:
        """The same, once there is one."""
        depth, along, a, b, c, d, e, f, g, h, i, *_ = self._closest.tolist()
        return ClosestPoint(depth, along, (a, b, c), (d, e, f), (g, h, i))

    def believe(self, pose: Sequence[float]) -> bool:
        """Believe the fixture elsewhere; the newest coordinate stays. Whether that was any news.

        A pose that is not six finite numbers within 10 m and 10 rad is left out.
        """
        if len(pose) != 6 or not all(abs(number) <= FARTHEST for number in pose) or _six(pose) == self.pose:
            return False
        self._move(pose)
        self.follow_again()
        return True

    def follow_again(self) -> None:
        """Follow the newest place once more, for the surface is elsewhere now; the newest coordinate stays."""
        x, y, z = self._closest[-3:].tolist()
        if not math.isnan(x):
            self.follow((x, y, z))

    def follow(self, place: Vector) -> ClosestPoint:
        """Follow a place [m]; one that is not finite is left out."""
        x, y, z = place
        self.touch(place)
        self._follow(self.records, self.shape, x, y, z)
        return self.newest

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


class Course(Record):
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
    """

    line: Line  # with an offset of its own
    guard: ForceGuard
    open: bool  # whether the robot follows in this tick: otherwise the course stays where it is
    here: Numbers3  # position of the probe [m]
    resistance: Numbers3  # force along the surface on the probe [N]
    pressed: float  # force along the normal [N]
    sliding: float  # largest speed along the surface [m/s]
    ceiling: float  # of the force [N]
    period: float  # T [s]
    longest: float  # largest step of the robot in a tick [m]
    returned: float  # step in a tick by which it takes in changes that no motion explains [m]
    place: Numbers3 = math.nan  # type: ignore[assignment]  # c [m]
    along: float = math.nan  # q [m], as of the tick in which the course last followed
    normal: Numbers3  # n, likewise
    apart: Numbers3  # h
    size: float  # q less the aim [m]
    inwards: Numbers3  # direction into the obstacle
    allowed: float  # how far that way [m]
    blocked: bool  # whether there is an obstacle
    begun: bool


@compiled
def settle(course: Course, mesh: Mesh) -> None:
    """Follow the position with the line; on a surface of Python's own, as Python has touched it."""
    place = course.place
    follow_line(course.line, mesh, place[0], place[1], place[2])
    course.along = course.line.closest.along
    write(course.normal, vector(course.line.closest.normal))


@compiled
def begin_course(course: Course, mesh: Mesh, place: Vector) -> None:
    """Begin where the robot is [m]."""
    write(course.place, place)
    course.begun = True
    settle(course, mesh)


@compiled
def meet(course: Course, mesh: Mesh, offset: float, fastest: float) -> None:
    """Come nearer to the coordinate of the probe, whose line has this offset [m].

    It does so no faster than it may return, and deeper no faster than safety lets the robot [m/s].
    """
    if not (course.open and course.begun):
        return
    deeper = min(course.returned, max(fastest, 0.0) * course.period)
    course.line.offset += min(max(offset - course.line.offset, -course.returned), deeper)
    settle(course, mesh)


@compiled(error_model="numpy")
def held_at(course: Course, aim: float) -> Vector:
    """The place for an aim along the normal [m]."""
    before, size = course.size, max(course.along - aim, 0.0)
    apart, normal = vector(course.apart), vector(course.normal)
    apart = scaled(apart, size / before) if size < before else add(apart, scaled(normal, size - before))
    if course.open:
        turned = subtract(scaled(normal, size), apart)
        length = norm(turned)
        apart = add(apart, scaled(turned, course.returned / length) if length > course.returned else turned)
    course.size = size
    write(course.apart, apart)
    return add(vector(course.place), apart)


@compiled(error_model="numpy")
def _step(course: Course, step: Vector) -> Vector:
    """Step towards the command in this tick."""
    normal = vector(course.normal)
    outwards = scaled(normal, max(dot(step, normal), 0.0))
    rest = subtract(step, outwards)
    length = norm(rest)
    if length > course.longest:
        rest = scaled(rest, course.longest / length)
    sideways = subtract(rest, scaled(normal, dot(rest, normal)))
    length, longest = norm(sideways), course.sliding * course.period
    if length > longest:
        rest = subtract(rest, scaled(sideways, 1.0 - longest / length))
    return add(rest, outwards)


@compiled(error_model="numpy")
def _held_back(course: Course, path: Vector) -> Vector:
    """The path, but no further against an obstacle than its force allows."""
    resistance, pressed = vector(course.resistance), max(course.pressed, 0.0)
    force = norm(resistance)
    if not force < math.inf:
        return vector(course.place)  # the obstacle's properties are unknown
    unexplained = force - pressed
    if not course.blocked:
        if unexplained <= OBSTACLE:
            return path
        write(course.inwards, scaled(resistance, -1.0 / force))
        course.blocked, course.allowed = True, dot(vector(course.place), vector(course.inwards))
        forget_contact(course.guard)
    inwards = vector(course.inwards)
    against = -dot(resistance, inwards) - pressed
    observe(course.guard, dot(vector(course.here), inwards), against, against > OBSTACLE)
    deeper = allowed_speed(course.guard, HELD * course.ceiling, 0.0)
    course.allowed += max(deeper * course.period, -course.longest)
    beyond = dot(path, inwards) - course.allowed
    if beyond <= 0.0:
        course.blocked = unexplained > OBSTACLE  # else it goes elsewhere
        course.allowed = dot(path, inwards)
        return path
    return subtract(path, scaled(inwards, beyond))


@compiled
def go(course: Course, mesh: Mesh, target: Vector) -> float:
    """One tick towards a place [m], on the way that was set before; returns q [m], NaN before it has begun.

    On a surface of Python's own, Python goes on with `settle`.
    """
    if course.begun and course.open:
        step = _step(course, subtract(target, vector(course.place)))
        write(course.place, _held_back(course, add(vector(course.place), step)))
        if course.line.compiled:
            settle(course, mesh)
    return float(course.along)
