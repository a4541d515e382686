"""What is known of the way to a surface in space: where the air is free, and how fast it may be gone along."""

from __future__ import annotations

import math

from foretouch.identification import SensorState
from foretouch.messages import FixtureBelief
from foretouch.quantities.pose import Vector, norm, subtract
from foretouch.rendering.surfaces import Surface
from foretouch.session import follower
from foretouch.session.spatial.line import Footing, SurfaceLine
from foretouch.session.spatial.pose_doubt import LARGEST_DOUBT, LARGEST_TURN, PoseDoubt

__all__ = ["MISSED", "MISSED_TICKS", "WayIn"]

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
