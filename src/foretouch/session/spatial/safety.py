"""Safety in space: what the layer along the normal cannot know of the approach, and its aims brought back into space.

All of it is one record: `arrive` comes before the stages along the normal, then the course, and `limit` after them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress

from foretouch.core import Kernel, Record, compiled
from foretouch.identification.conditioning.fault_kernels import GOOD
from foretouch.identification.conditioning.kernel import shift
from foretouch.identification.friction import Friction
from foretouch.messages import FixtureBelief
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import Surface
from foretouch.rendering.surfaces.geometry import Numbers3, Triangle, add, dot, norm, scaled, subtract, vector, write
from foretouch.rendering.surfaces.god_object import MESH, Mesh
from foretouch.rendering.surfaces.line import Line, follow_line, is_known, rotate
from foretouch.session.safety.force_guard import ForceCap, limit_force, observe_force, slide
from foretouch.session.safety.kernel import HOLDING, Memory
from foretouch.session.safety.motion import Bound, Path, begin, go_on
from foretouch.session.safety.safety import Safety
from foretouch.session.spatial.course import Course, SurfaceLine, begin_course, held_at, meet, settle
from foretouch.session.spatial.way_in import SIDEWAYS_SHARE, Known, WayIn, believe_covariance, come_to, uncertainty_of
from foretouch.session.steps.tick import States

NO_VECTOR: Vector = (0.0, 0.0, 0.0)

ALIGNED = math.cos(0.5)
"""Cosine of the largest angle between a normal and the surface's mean one; a normal turned further is taken for an
edge's: few slopes of a surface of heights are as steep."""

LARGEST_PULL, PULL_SHARE = 0.5, 0.02
"""Pull above which a force is reduced [N], and fraction of it kept: enough that a sensor does not seem stuck."""


class FeltSurface(Record):
    r"""Where a contact began, once it is 1 mm deep.

    A contact is noticed late, at a force F_1 that the surface gives at a depth d. With F_2 after h more,

    .. math:: d = \frac{r h}{1 - r}, \quad r = (F_1 / F_2)^{1 / n}

    for a law of exponent n, here 1.15: a spring has 1, and Hertz's ball 1.5.
    """

    place: Numbers3 = math.nan  # type: ignore[assignment]  # newest onset that tells of the surface [m]
    tick: int  # in which that was known
    ticks: int  # since this contact began; 0 while there is none
    began: float  # force at which this contact began [N]
    at: float  # position along the normal then [m]
    known: bool  # whether this contact needs no more


class Beside(Record):
    """What is learnt beside the law."""

    touch: FeltSurface
    friction: Friction
    bias: Numbers3  # the sensor's offset [N]
    bias_ticks: int  # number of ticks that it is known from
    free_ticks: int  # since free air began; negative for a while after a contact
    missed_ticks: int  # in which the surface was missed
    point: Numbers3 = math.nan  # type: ignore[assignment]  # of the surface, in the fixture, in the tick before [m]


class Space(Record):
    """State of a `SpatialSafety`."""

    probe: Line  # of the measured positions
    course: Course
    told: Line  # of the commanded positions
    path: Path  # of these
    cap: ForceCap
    way_in: WayIn
    beside: Beside
    blind_speed: float  # see `Safety` [m/s]
    seen: bool  # whether a camera has shown the fixture
    shown: Numbers3 = math.nan  # type: ignore[assignment]  # by the force sensor [N]
    felt: float = math.nan  # its part along the normal [N]


@compiled(error_model="numpy")
def _along_speed(space: Space, memory: Memory, known: Known) -> float:
    """Largest speed of the robot along the surface [m/s]; notes at what speed this brings it nearer.

    The commanded speed is that of the tick before.
    """
    way, along, inwards = space.way_in, 0.0, 0.0
    if is_known(space.told):
        velocity, normal = vector(space.path.velocity), vector(space.told.closest.normal)
        inwards = -dot(velocity, normal)
        along = norm(add(velocity, scaled(normal, inwards)))
    memory.nearing = way.turn * along
    if not known.in_contact and space.probe.closest.along < way.free:
        return known.fastest
    blind = space.blind_speed
    left = blind - max(inwards, 0.0) - space.cap.force / memory.impedance
    return float(min(known.fastest, max(left, SIDEWAYS_SHARE * blind) / way.turn))


@compiled
def _begin(space: Space, mesh: Mesh, place: Vector) -> None:
    """Begin at the robot's position [m], at rest."""
    begin(space.path, place[0], place[1], place[2])
    follow_line(space.told, mesh, place[0], place[1], place[2])


VECTOR = "UniTuple(f8, 3)"
_shift = shift.function


@compiled
def arrive(space: Space, states: States, mesh: Mesh, place: Vector, raw: Vector, force: Vector) -> tuple[float, bool]:
    """Take the probe's position [m], the force that its sensor shows and that without its offset [N].

    Returns:
        The force along the normal [N], and whether the coordinate went on though the probe did not move.
    """
    follower, conditioner, newest = states[0][0], states[1], states[2][0].newest[0]
    line, course, memory, touch = space.probe, space.course, follower.safety[0], follower.touch[0]
    before = line.offset
    follow_line(line, mesh, place[0], place[1], place[2])
    jump = line.offset - before
    if jump != 0.0:  # the proxy has let go: the coordinate went on, and what was felt is elsewhere
        space.told.offset = line.offset
        _shift(conditioner, jump)
    fastest = touch.speed if touch.held_back != 0.0 else memory.limits.speed
    good, follows = follower.watch[0].state == GOOD, follower.status < HOLDING
    known = Known(conditioner[0][0].surface, newest.in_contact, fastest, good, space.seen, follows)
    # A pulling force is no contact of this surface: learnt as the sensor's offset, it would hide one.
    normal = vector(line.closest.normal)
    felt = dot(force, normal)
    if felt < -LARGEST_PULL:
        felt = PULL_SHARE * (felt + LARGEST_PULL) - LARGEST_PULL
    if not course.begun and math.isfinite(place[0]) and math.isfinite(place[1]) and math.isfinite(place[2]):
        begin_course(course, mesh, place)
        _begin(space, mesh, place)
    observe_force(space.cap, place, force, normal)
    follower.slid = come_to(space.way_in, line, memory, known, space.cap.explained)
    write(course.here, place)
    write(course.resistance, subtract(force, scaled(normal, felt)))
    course.open, course.pressed = known.follows, newest.force
    course.sliding = slide(space.cap, _along_speed(space, memory, known))
    meet(course, mesh, line.offset, memory.fastest)
    follower.free = space.way_in.free
    if raw == vector(space.shown):  # a sensor that hangs is to seem so along any normal
        felt = space.felt
    write(space.shown, raw)
    space.felt = felt
    return float(felt), bool(jump != 0.0)


@compiled
def _against(normal: Vector, speed: float) -> Bound:
    """Limit the speed against a normal [m/s]."""
    return -normal[0], -normal[1], -normal[2], speed


@compiled
def _went(space: Space, memory: Memory, mesh: Mesh) -> None:
    """Follow the commanded position."""
    told, path = space.told, space.path
    follow_line(told, mesh, path.position[0], path.position[1], path.position[2])
    memory.motion.velocity[0] = -dot(vector(path.velocity), vector(told.closest.normal))
    memory.nearest = told.closest.along


@compiled
def limit(space: Space, memory: Memory, mesh: Mesh, aim: float) -> tuple[Vector, float]:
    """The position for the robot, and its coordinate along the course's normal [m], for an aim [m] of this tick."""
    course, cap, line, path = space.course, space.cap, space.told, space.path
    before = vector(path.position)
    if not (course.begun and is_known(line) and math.isfinite(aim)):
        return before, aim
    allowed, gone = held_at(course, aim), vector(course.normal)
    wanted, moved = limit_force(cap, allowed, scaled(gone, -memory.shifted), before)
    deeper, outwards = max(memory.fastest, 0.0), vector(line.closest.normal)
    facing = rotate(line, vector(space.way_in.pose.facing)) if line.closest.depth < 0.0 else NO_VECTOR
    # Beside an edge the approach was proven towards the edge, and not down to where the surface may go on.
    beside = not space.probe.closest.along < space.way_in.free and dot(facing, outwards) < ALIGNED
    bounds = (
        _against(facing, min(deeper, space.blind_speed) if beside else deeper),
        _against(outwards, deeper),
        _against(vector(cap.outwards), max(min(cap.fastest, deeper), 0.0)),
    )
    go_on(path, wanted, moved, bounds)
    commanded = vector(path.position)
    position = aim + dot(subtract(allowed, commanded), gone)
    memory.motion.position[0] = position
    if line.compiled:
        _went(space, memory, mesh)
    return commanded, position


_settle = Kernel(settle, f"(Course, {MESH})", Triangle)
_begin_there = Kernel(_begin, f"(Space, {MESH}, {VECTOR})", Triangle)
_went_there = Kernel(_went, f"(Space, Memory, {MESH})", Triangle)


class SpatialSafety:
    """Safety about the layer along the normal, whose aims it brings into space.

    Before the stages along the normal it takes the probe's position and force (`arrive`) and the command (`go`), and
    after them the aim (`limit`): the position on the course with this aim; no further against the force than `ForceCap`
    allows; then the limits of `Path`, as on a line. Three directions are limited to the speed that safety allows:
    outside the surface, against its mean normal, for it may be elsewhere than believed, so that another part of it is
    near; into the surface from the robot's commanded position; and against the force on the probe or, where none is
    felt, into the surface under it. Over a flat surface they are the same, at an edge they differ.

    Python touches a surface of its own before `arrive`, after `go` and after `limit` (`touch`, `settle`, `went`).

    Args:
        safety: Safety layer along the normal, whose limits hold in space.
        surface: Surface in the fixture's frame.
        pose: Believed pose of the fixture: a position [m] and a rotation vector [rad].
        sample_period: Sample period [s].

    Attributes:
        spaces: Array of one `Space`.
        line: Line of the probe.
        python: Whether the surface is Python's own.
    """

    def __init__(self, safety: Safety, surface: Surface, pose: Sequence[float], sample_period: float) -> None:
        limits = safety.limits
        self._safety, self.spaces = safety, Space.new(blind_speed=safety.blind_speed)
        courses = self.spaces["course"]
        courses["ceiling"], courses["period"] = limits.force, sample_period
        courses["longest"], courses["returned"] = limits.speed * sample_period, limits.return_speed * sample_period
        self.spaces["cap"] = ForceCap.new(
            ceiling=limits.force, most_damped=limits.most_damped, speed=limits.speed, period=sample_period
        )
        self.spaces["way_in"]["pose"] = uncertainty_of(surface)
        self.spaces["path"] = safety.path
        safety.path = self.spaces["path"]
        self.line = SurfaceLine(surface, pose, records=self.spaces["probe"])
        self._gone = SurfaceLine(surface, pose, records=courses["line"])
        self._told = SurfaceLine(surface, pose, leads=False, records=self.spaces["told"])
        self.python = not self.line.records["compiled"][0]
        self._begin, self._settle, self._went = _begin_there.entry, _settle.entry, _went_there.entry

    def believe(self, belief: FixtureBelief) -> bool:
        """Take a belief of the fixture's pose; whether it stands elsewhere."""
        way, before = self.spaces[0].way_in, self.line.offset
        elsewhere = self.line.believe(belief.pose)
        if elsewhere:
            self._gone.believe(belief.pose)
            self._told.offset = self.line.offset
            self._told.believe(belief.pose)
        if belief.images != way.images:
            way.images, way.before = belief.images, before
        believe_covariance(self.spaces["way_in"]["pose"], belief.covariance)
        way.believed = belief.contacts + belief.images
        way.contradicted = way.contradicted and not way.believed > way.then
        return elsewhere

    def reshape(self) -> None:
        """Follow a surface that has changed in place; what was felt of it stays where it was."""
        self.line.follow_again()
        self._gone.follow_again()
        self._told.offset = self.line.offset
        self._told.follow_again()

    def touch(self, place: Vector) -> None:
        """Touch a surface of Python's own before `arrive`, with the probe at a position [m]."""
        course = self.spaces["course"][0]
        self.line.touch(place)
        self._gone.touch(course.place.tolist() if course.begun else place)
        if not course.begun:
            self._told.touch(place)

    def settle(self) -> float:
        """Touch it after `go`; returns the coordinate of the course along the normal [m]."""
        course = self.spaces[0].course
        if course.begun and course.open:
            self._gone.touch(course.place.tolist())
            self._settle(course, self.line.shape)
        return float(course.along)

    def went(self, commanded: Vector) -> None:
        """Touch it after `limit`, at the commanded position [m]."""
        if self.spaces["course"][0].begun:
            self._told.touch(commanded)
            self._went(self.spaces[0], self._safety.memories[0], self.line.shape)

    def begin(self, place: Vector) -> None:
        """Begin again at the robot's position [m], at rest."""
        with suppress(Exception):  # the surface may be what has failed, and the robot is to leave it all the same
            self._told.touch(place)
        self._begin(self.spaces[0], self.line.shape, place)
