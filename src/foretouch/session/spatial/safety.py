"""Safety in space: what the layer along the normal cannot know of the approach, and its aims brought back into space.

How much nearer or otherwise inclined the surface may be than believed follows from the covariance of the pose, in each
tick and compiled.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel, compiled, kernel
from foretouch.identification import SensorState
from foretouch.messages import FixtureBelief
from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.rendering.surfaces import Surface
from foretouch.session.safety.force_cap import ForceCap
from foretouch.session.safety.motion import Bound
from foretouch.session.safety.safety import Safety
from foretouch.session.spatial.course import ClosestPoint, Course, SurfaceLine
from foretouch.session.steps import follower

Array = NDArray[np.float64]


@compiled
def height_variance(covariance: Array, a: float, b: float, c: float, x: float, y: float, z: float) -> float:
    """J P J^T for J = (-n, n x q), n = (a, b, c) and q = (x, y, z)."""
    derivative = (-a, -b, -c, b * z - c * y, c * x - a * z, a * y - b * x)
    total = 0.0
    for row in range(6):
        for column in range(6):
            total += derivative[row] * covariance[row, column] * derivative[column]
    return total


_height_variance = Kernel(height_variance, "(f8[:, ::1], f8, f8, f8, f8, f8, f8)")


@kernel("(f8[:, ::1], f8, f8, f8, f8, f8, f8)")
def variances(
    covariance: Array, a: float, b: float, c: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Variances at a point q = (x, y, z) of a fixture, with a surface of normal n = (a, b, c) there.

    Returns:
        Variance of its height, of its position in all directions [m^2], and of the normal's inclination [rad^2].
    """
    position = height_variance(covariance, 1.0, 0.0, 0.0, x, y, z) + height_variance(covariance, 0.0, 1.0, 0.0, x, y, z)
    position += height_variance(covariance, 0.0, 0.0, 1.0, x, y, z)
    normal, inclined = (a, b, c), 0.0
    for row in range(3):
        inclined += covariance[3 + row, 3 + row]
        for column in range(3):
            inclined -= normal[row] * covariance[3 + row, 3 + column] * normal[column]
    return height_variance(covariance, a, b, c, x, y, z), position, inclined


FACTOR = 3.0  # Number of standard deviations taken as the largest error

SHARED = 5e-4
"""Error common to all touches, which their number does not reduce [m]: the onset of a contact is computed with one
exponent for all materials, which for a spring or Hertz's ball errs by up to 0.3 mm."""

LARGEST_UNCERTAINTY = 0.1  # Largest uncertainty of the surface that is assumed [m]

LARGEST_TURN, LEAST_TURN = 0.2, 0.1
"""Largest and least inclination assumed of a surface against its belief, and of a robot's motion against its command,
for the drives differ in delay [rad]."""

NUMBERS = 6
ROUNDING = 1e-12  # Rounding error of a sum of variances that may be zero [rad^2]


class PoseUncertainty:
    r"""The uncertainty of a fixture's pose at a point of its surface.

    The pose's error on the right, of covariance P, changes the height of a point q over a surface of normal n by
    J = (-n, n x q) of it. So the surface may be nearer by

    .. math:: 3 \sqrt{J P J^T} + \min(3 \sigma \sin\alpha, h) + 0.5\ \mathrm{mm}

    which is small where it was touched, however little is known of the rest of the pose. The second term is for the
    normal, which changes where the surface is displaced along itself, with a standard deviation of sigma: alpha is the
    largest angle against the mean normal, and h the surface's relief. J is computed for n and for the mean normal, for
    beside the surface's edge they differ; the larger counts. The surface may be inclined otherwise by

    .. math:: 3 \sqrt{\mathrm{tr} P_\phi - n^T P_\phi n} + 2 \sin\alpha\, \min(3 \sigma \sin\alpha / h, 1)

    for a turn about the normal inclines nothing, and a displacement through the whole relief may exchange any two of
    its normals.

    Args:
        surface: Surface in the fixture's frame.
    """

    def __init__(self, surface: Surface) -> None:
        self._slope, self._relief = surface.relief()
        self._facing = surface.facing()
        self._covariance, self._known = np.zeros((NUMBERS, NUMBERS)), False

    def believe(self, covariance: Sequence[float]) -> None:
        """Take the covariance of the pose's error on the right [m, rad], 36 numbers; other lengths mean unknown."""
        self._known = len(covariance) == NUMBERS**2 and all(map(math.isfinite, covariance))
        if self._known:
            self._covariance = np.array(covariance, dtype=np.float64).reshape(NUMBERS, NUMBERS)

    def at(self, point: Vector, normal: Vector) -> tuple[float, float]:
        """Uncertainty at a point of the surface [m] with an outward normal, both in the fixture's frame.

        Returns:
            How much nearer [m] and otherwise inclined [rad] it may be; the largest where the pose is unknown.
        """
        height, position, turn = variances.entry(self._covariance, *normal, *point)
        if self._relief > 0.0:
            height = max(height, _height_variance.entry(self._covariance, *self._facing, *point))
        if not (
            self._known and 0.0 <= height < math.inf and 0.0 <= position < math.inf and -ROUNDING <= turn < math.inf
        ):
            return LARGEST_UNCERTAINTY, LARGEST_TURN  # not a covariance
        uneven = min(FACTOR * math.sqrt(max(position - height, 0.0)) * self._slope, self._relief)
        inclined = FACTOR * math.sqrt(max(turn, 0.0))
        if uneven > 0.0:
            inclined += 2.0 * self._slope * uneven / self._relief
        uncertainty = FACTOR * math.sqrt(height) + uneven + SHARED
        return min(uncertainty, LARGEST_UNCERTAINTY), min(max(inclined, LEAST_TURN), LARGEST_TURN)


SAME_PLACE, SAME_HEIGHT = 3e-3, 1e-3
"""Distances within which forces felt during the approach still hold [m]: along the surface, half the radius of the tip,
and of the believed surface from its earlier position."""

SIDEWAYS_SHARE = 1.0 / 3.0
"""Least sliding speed along a surface of uncertain inclination, as a fraction of the robot's speed of approach."""

SLID = 2e-5
"""Displacement across the surface in a tick above which the probe has moved [m]: less is the encoders' noise."""

MISSED, MISSED_TICKS = 1e-3, 50
"""Depth below a surface [m] and number of ticks without force after which the surface is taken to be deeper."""

NAN3 = (math.nan, math.nan, math.nan)


class WayIn:
    """Informs the follower along the normal, which cannot know it, that the probe has come to another point.

    What the robot has proven of its approach holds at its present point. Elsewhere the air counts as free up to the
    believed surface, less its uncertainty at this point (`PoseUncertainty`), once the surface was felt or seen; beyond
    that, and before, nothing is known. There motion along the surface counts as coming nearer, by the uncertainty of
    the inclination; its speed is limited to what the motion inwards leaves, and to no less than a third.

    A contact in air that counts as free, and a surface that is missed below where it may be, contradict the belief:
    then none of it counts until it includes a newer touch or image.

    Args:
        surface: Surface in the fixture's frame.

    Attributes:
        uncertainty: Uncertainty of the surface at the newest point [m].
        turn: Uncertainty of its inclination there [rad].
    """

    def __init__(self, surface: Surface) -> None:
        self.uncertainty, self.turn = LARGEST_UNCERTAINTY, LARGEST_TURN  # until a tracker says otherwise
        self._pose = PoseUncertainty(surface)
        self._known = 0  # number of touches and images in the belief
        self._against: int | None = None  # that number when something contradicted the belief
        self._felt, self._missed = False, 0
        self._anchor: tuple[Vector, float] = NAN3, 0.0
        self._point: Vector = NAN3

    def believe(self, belief: FixtureBelief) -> None:
        """Take the uncertainty of the fixture's pose."""
        self._pose.believe(belief.covariance)
        self._known = belief.contacts + belief.images
        if self._against is not None and self._known > self._against:
            self._against = None

    def come_to(self, inner: follower.State, line: SurfaceLine, closest: ClosestPoint, *, seen: bool) -> None:
        """Take a new point of the surface.

        Args:
            inner: Follower along the normal, which is informed.
            line: Line of the probe.
            closest: Closest point of the probe.
            seen: Whether a camera has shown the fixture.
        """
        surface, point, offset = inner.learner.conditioner.surface, closest.inner_point, line.offset
        self.uncertainty, self.turn = self._pose.at(point, line.motion.rotate_back(closest.normal))
        self._compare(inner, closest.depth)
        if self._against is not None:
            self.uncertainty, self.turn = LARGEST_UNCERTAINTY, LARGEST_TURN
        # After it leaves a soft material, the probe meets it deeper again, though the surface is where it was believed.
        nearest = min(surface, offset) if math.isfinite(surface) else offset
        inner.free = nearest - self.uncertainty if seen or math.isfinite(surface) else -math.inf
        inner.slid = max(norm(subtract(point, self._point)) - SLID, 0.0)  # NaN in the first tick
        self._point = point
        aside, further = norm(subtract(point, self._anchor[0])), abs(offset - self._anchor[1])
        if not (aside <= SAME_PLACE and further <= SAME_HEIGHT):
            self._anchor = point, offset
            inner.safety.forget_way()

    def along_speed(
        self, inner: follower.State, closest: ClosestPoint, commanded: tuple[float, float], fastest: float
    ) -> float:
        """Largest speed of the robot along the surface [m/s].

        Args:
            inner: Follower along the normal, which takes the speed at which this brings it nearer.
            closest: Closest point of the probe.
            commanded: Commanded speed along the surface, and into it, in the tick before [m/s].
            fastest: Speed where the surface is felt, or far [m/s].
        """
        along, inwards = commanded
        inner.safety.comes_nearer(self.turn * along)
        if inner.learner.sample.in_contact or closest.along < inner.free:
            return fastest
        blind = inner.safety.blind_speed
        return min(fastest, max(blind - max(inwards, 0.0), SIDEWAYS_SHARE * blind) / self.turn)

    def _compare(self, inner: follower.State, depth: float) -> None:
        """Whether the force in the tick before, at a depth in the believed surface [m], contradicts the belief."""
        before, self._felt = self._felt, inner.learner.sample.in_contact
        below = not self._felt and depth > self.uncertainty + MISSED and inner.watch.state is SensorState.GOOD
        self._missed = self._missed + 1 if below else 0
        early = self._felt and not before and depth < -self.uncertainty
        if early or self._missed >= MISSED_TICKS:
            self._against = self._known


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
