"""What is known of the way to a surface in space: where the air is free, and how fast it may be gone along.

How much nearer the surface may be than it is believed, and how otherwise inclined, comes from the pose's covariance, in
each tick and compiled.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification import SensorState
from foretouch.messages import FixtureBelief
from foretouch.quantities.pose import Vector, norm, subtract
from foretouch.rendering.surfaces import Surface
from foretouch.session.spatial.course import Footing, SurfaceLine
from foretouch.session.steps import follower

Array = NDArray[np.float64]


def _variance(covariance: Array, a: float, b: float, c: float, x: float, y: float, z: float) -> float:
    """J P J^T for J = (-n, n x q), n = (a, b, c) and q = (x, y, z)."""
    derivative = (-a, -b, -c, b * z - c * y, c * x - a * z, a * y - b * x)
    total = 0.0
    for row in range(6):
        for column in range(6):
            total += derivative[row] * covariance[row, column] * derivative[column]
    return total


height_variance = compiled("f8(f8[:,::1], f8, f8, f8, f8, f8, f8)")(_variance)


def _variances(
    covariance: Array, a: float, b: float, c: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Of a point q = (x, y, z) of a fixture, with a surface of normal n = (a, b, c) there.

    Returns:
        Variance of its height, of where it is over all directions [m^2], and of how the normal is inclined [rad^2].
    """
    place = height_variance(covariance, 1.0, 0.0, 0.0, x, y, z) + height_variance(covariance, 0.0, 1.0, 0.0, x, y, z)
    place += height_variance(covariance, 0.0, 0.0, 1.0, x, y, z)
    normal, inclined = (a, b, c), 0.0
    for row in range(3):
        inclined += covariance[3 + row, 3 + row]
        for column in range(3):
            inclined -= normal[row] * covariance[3 + row, 3 + column] * normal[column]
    return height_variance(covariance, a, b, c, x, y, z), place, inclined


variances = compiled("Tuple((f8, f8, f8))(f8[:,::1], f8, f8, f8, f8, f8, f8)")(_variances)


FACTOR = 3.0
"""Standard deviations that are doubted."""

SHARED = 5e-4
"""Besides, what all touches may have in common and their number does not take away [m]: where a contact began is
reckoned with one exponent for all materials, which for a spring or Hertz's ball errs by up to 0.3 mm."""

LARGEST_DOUBT = 0.1
"""Nothing is doubted further than this [m]."""

LARGEST_TURN, LEAST_TURN = 0.2, 0.1
"""A surface may be inclined against what is believed, and a robot's motion against what it is told, for each drive is
late by its own time, by at most and at least this [rad]."""

NUMBERS = 6
ROUNDING = 1e-12
"""Of a sum of variances that may be nothing [rad^2]."""


class PoseDoubt:
    r"""The doubt of a fixture's pose, at a place of its surface.

    The pose's error on the right, of covariance P, changes the height of a place q over a surface of normal n by
    J = (-n, n x q) of it. So the surface may be nearer by

    .. math:: 3 \sqrt{J P J^T} + \min(3 \sigma \sin\alpha, h) + 0.5\ \mathrm{mm}

    which is small where it was touched, however little is known of the rest of the pose. The second term is for the
    normal, which is another where the surface is displaced along itself, with a standard deviation of sigma: alpha is
    the largest angle against the mean normal, and h the surface's relief. J is taken for n and for the mean normal, for
    beside the surface's edge they differ; the larger counts. It may be inclined otherwise by

    .. math:: 3 \sqrt{\mathrm{tr} P_\phi - n^T P_\phi n} + 2 \sin\alpha\, \min(3 \sigma \sin\alpha / h, 1)

    for a turn about the normal inclines nothing, and a displacement through the whole relief may change any normal of
    it for any other.

    Args:
        surface: In the fixture's frame.
    """

    __slots__ = ("_covariance", "_facing", "_height_variance", "_known", "_relief", "_slope", "_variances")

    def __init__(self, surface: Surface) -> None:
        # Imported here: it brings a compiler along.

        self._height_variance, self._variances = height_variance, variances
        self._slope, self._relief = surface.relief()
        self._facing = surface.facing()
        self._covariance, self._known = np.zeros((NUMBERS, NUMBERS)), False

    def believe(self, covariance: Sequence[float]) -> None:
        """Take the covariance of the pose's error on the right [m, rad], 36 numbers; others mean that it is unknown."""
        self._known = len(covariance) == NUMBERS**2 and all(map(math.isfinite, covariance))
        if self._known:
            self._covariance = np.array(covariance, dtype=np.float64).reshape(NUMBERS, NUMBERS)

    def at(self, point: Vector, normal: Vector) -> tuple[float, float]:
        """At a point of the surface [m] with an outward normal, both in the fixture's frame.

        Returns:
            By how much it may be nearer [m], and otherwise inclined [rad]; the largest where the pose is unknown.
        """
        height, place, turn = self._variances(self._covariance, *normal, *point)
        if self._relief > 0.0:
            height = max(height, self._height_variance(self._covariance, *self._facing, *point))
        if not (self._known and 0.0 <= height < math.inf and 0.0 <= place < math.inf and -ROUNDING <= turn < math.inf):
            return LARGEST_DOUBT, LARGEST_TURN  # no covariance has such variances
        uneven = min(FACTOR * math.sqrt(max(place - height, 0.0)) * self._slope, self._relief)
        inclined = FACTOR * math.sqrt(max(turn, 0.0))
        if uneven > 0.0:
            inclined += 2.0 * self._slope * uneven / self._relief
        doubt = FACTOR * math.sqrt(height) + uneven + SHARED
        return min(doubt, LARGEST_DOUBT), min(max(inclined, LEAST_TURN), LARGEST_TURN)


SAME_PLACE, SAME_HEIGHT = 3e-3, 1e-3
"""What was felt of the way in is of this place [m], half the radius of the tip, and of a surface that is believed no
further away than this [m] from where it was believed then."""

SIDEWAYS_SHARE = 1.0 / 3.0
"""Going along a surface that may be inclined has at least so much of the speed at which the robot may come to it."""

SLID = 2e-5
"""The probe has moved across the surface where it did by more than this in a tick [m]: less is the encoders' noise."""

MISSED, MISSED_TICKS = 1e-3, 50
"""Nothing felt so deep below a surface [m] for so many ticks: it is deeper."""

NAN3 = (math.nan, math.nan, math.nan)


class WayIn:
    """Tells the follower along the normal what it cannot know there: that the probe has come to another place.

    What the robot has proven of its way in is of the place that it is at. Elsewhere the air counts as free to where the
    surface is believed, less the doubt of that at this place (`PoseDoubt`), once it was felt or seen; beyond that, and
    before, nothing is known. There what it goes along the surface counts as coming nearer, by the doubt of the turn; it
    goes along it as fast as what it does not go inwards leaves, and at least a third.

    A contact in air that counts as free, and a surface that is missed below where it may be, speak against the belief:
    then nothing of it counts until a newer touch or image is in it.

    Args:
        surface: In the fixture's frame.

    Attributes:
        doubt: Of the surface at the newest place [m].
        turn: Of its inclination there [rad].
    """

    __slots__ = ("_against", "_anchor", "_felt", "_known", "_missed", "_point", "_pose", "doubt", "turn")

    def __init__(self, surface: Surface) -> None:
        self.doubt, self.turn = LARGEST_DOUBT, LARGEST_TURN  # until a tracker says otherwise
        self._pose = PoseDoubt(surface)
        self._known = 0  # touches and images that the belief is made of
        self._against: int | None = None  # and was, when something spoke against it
        self._felt, self._missed = False, 0
        self._anchor: tuple[Vector, float] = NAN3, 0.0
        self._point: Vector = NAN3

    def believe(self, belief: FixtureBelief) -> None:
        """Take the doubt of the fixture's pose."""
        self._pose.believe(belief.covariance)
        self._known = belief.contacts + belief.images
        if self._against is not None and self._known > self._against:
            self._against = None

    def come_to(self, inner: follower.State, line: SurfaceLine, footing: Footing, *, seen: bool) -> None:
        """Come to a place.

        Args:
            inner: Follower along the normal, which is told.
            line: Of the probe.
            footing: Of the probe.
            seen: Whether a camera has shown the fixture.
        """
        surface, point, offset = inner.learner.conditioner.surface, footing.inner_point, line.offset
        self.doubt, self.turn = self._pose.at(point, line.motion.rotate_back(footing.normal))
        self._compare(inner, footing.depth)
        if self._against is not None:
            self.doubt, self.turn = LARGEST_DOUBT, LARGEST_TURN
        # Who lets go of a soft material meets it deeper again; the surface is where it was believed all the same.
        nearest = min(surface, offset) if math.isfinite(surface) else offset
        inner.free = nearest - self.doubt if seen or math.isfinite(surface) else -math.inf
        inner.slid = max(norm(subtract(point, self._point)) - SLID, 0.0)  # no number in the first tick
        self._point = point
        aside, further = norm(subtract(point, self._anchor[0])), abs(offset - self._anchor[1])
        if not (aside <= SAME_PLACE and further <= SAME_HEIGHT):
            self._anchor = point, offset
            inner.safety.forget_way()

    def along_speed(self, inner: follower.State, footing: Footing, told: tuple[float, float], fastest: float) -> float:
        """How fast the robot may go along the surface [m/s].

        Args:
            inner: Follower along the normal, which is told how fast it comes nearer by that.
            footing: Of the probe.
            told: How fast it was told to, and into the surface, in the tick before [m/s].
            fastest: Where the surface is felt, or far [m/s].
        """
        along, inwards = told
        inner.safety.comes_nearer(self.turn * along)
        if inner.learner.sample.in_contact or footing.along < inner.free:
            return fastest
        blind = inner.safety.blind_speed
        return min(fastest, max(blind - max(inwards, 0.0), SIDEWAYS_SHARE * blind) / self.turn)

    def _compare(self, inner: follower.State, depth: float) -> None:
        """Whether what was felt in the tick before, at a depth in the believed surface [m], speaks against it."""
        before, self._felt = self._felt, inner.learner.sample.in_contact
        below = not self._felt and depth > self.doubt + MISSED and inner.watch.state is SensorState.GOOD
        self._missed = self._missed + 1 if below else 0
        early = self._felt and not before and depth < -self.doubt
        if early or self._missed >= MISSED_TICKS:
            self._against = self._known
