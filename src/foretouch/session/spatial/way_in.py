"""What is known of the way to a surface in space: where the air is free, and how fast it may be gone along."""

from __future__ import annotations

import math

from foretouch.quantities.rigid import Vector, norm, subtract
from foretouch.session import follower
from foretouch.session.spatial.line import Footing, SurfaceLine

__all__ = ["WayIn"]

DOUBT_FACTOR, LEVER, LARGEST_DOUBT = 3.0, 0.1, 0.1
"""A surface that was felt at one place may be nearer at another, by so many standard deviations of the pose, at
a lever of so much [m]; at most so much [m]."""

LARGEST_TURN, LEAST_TURN = 0.2, 0.1
"""A surface may be inclined against what is believed, and a robot's motion against what it is told, for each drive is
late by its own time, by at most and at least this [rad]."""

SAME_PLACE, SAME_HEIGHT = 3e-3, 1e-3
"""What was felt of the way in is of this place [m], half the radius of the tip, and of a surface that is believed no
further away than this [m] from where it was believed then."""

SIDEWAYS_SHARE = 1.0 / 3.0
"""Going along a surface that may be inclined has at least so much of the speed at which the robot may come to it."""

SLID = 2e-5
"""The probe has moved across the surface where it did by more than this in a tick [m]: less is the encoders' noise."""

NAN3 = (math.nan, math.nan, math.nan)


class WayIn:
    """Tells the follower along the normal what it cannot know there: that the probe has come to another place.

    What the robot has proven of its way in is of the place that it is at. Elsewhere the air counts as free to where the
    surface is believed, less the doubt of that, once it was felt or seen; beyond that, and before, nothing is known.
    There what it goes along the surface counts as coming nearer, by the doubt of the turn; it goes along it as fast as
    what it does not go inwards leaves, and at least a third.
    """

    __slots__ = ("_anchor", "_doubt", "_point", "_turn")

    def __init__(self) -> None:
        self._doubt, self._turn = LARGEST_DOUBT, LARGEST_TURN  # until a tracker says otherwise
        self._anchor: tuple[Vector, float] = NAN3, 0.0
        self._point: Vector = NAN3

    def believe(self, deviation: tuple[float, ...]) -> None:
        """Take the standard deviation of the fixture's pose [m, rad]: three of it are doubted."""
        place, turn = math.hypot(*deviation[:3]), math.hypot(*deviation[3:])
        self._doubt = min(DOUBT_FACTOR * (place + LEVER * turn), LARGEST_DOUBT)
        self._turn = min(max(DOUBT_FACTOR * turn, LEAST_TURN), LARGEST_TURN)

    def come_to(self, inner: follower.State, line: SurfaceLine, footing: Footing, *, seen: bool) -> None:
        """Come to a place.

        Args:
            inner: Follower along the normal, which is told.
            line: Of the probe.
            footing: Of the probe.
            seen: Whether a camera has shown the fixture.
        """
        surface, point, offset = inner.learner.conditioner.surface, footing.inner_point, line.offset
        # Who lets go of a soft material meets it deeper again; the surface is where it was believed all the same.
        nearest = min(surface, offset) if math.isfinite(surface) else offset
        inner.free = nearest - self._doubt if seen or math.isfinite(surface) else -math.inf
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
        inner.safety.comes_nearer(self._turn * along)
        if inner.learner.sample.in_contact or footing.along < inner.free:
            return fastest
        blind = inner.safety.blind_speed
        return min(fastest, max(blind - max(inwards, 0.0), SIDEWAYS_SHARE * blind) / self._turn)
