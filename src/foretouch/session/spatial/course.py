"""Where the robot is on its way to: what stands between the place that is commanded and the one that is allowed."""

from __future__ import annotations

import math
from typing import NamedTuple

from foretouch.quantities.pose import Vector, add, dot, norm, scaled, subtract
from foretouch.session.force_guard import ForceGuard
from foretouch.session.spatial.line import Footing, SurfaceLine

__all__ = ["Course", "Way"]

HELD = 0.7
"""Share of the largest force that an obstacle sideways is pushed with at most."""

OBSTACLE = 0.5
"""What is more than friction by so much is an obstacle [N]."""

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

    Its coordinate q along the normal n of its footing goes through safety as a position on a line does. What is left of
    it, an aim that is no deeper, is brought into space by a vector h to

    .. math:: c + h, \quad h \to (q - aim)\, n

    which follows the aim at once, and the normal only at the return speed: a normal that flips at an edge moves
    nothing at first. For the same reason a step of q that no motion explains, where the nearest point of the surface is
    another or a fixture is believed elsewhere, is let in at that speed. Where nothing is held back, c + h is the
    command itself, whatever is believed of the surface.

    Args:
        line: Of the course: with an offset of its own.
        ceiling: Of the force [N].
        speed: Largest of the robot [m/s].
        return_speed: At which it takes in what no motion explains [m/s].
        sample_period: [s].

    Attributes:
        place: c [m]; no numbers before it has begun.
        line: As given.
        footing: Of c.
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
        "footing",
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
        self._guard = ForceGuard()
        self._apart = NO_VECTOR  # h
        self._size = 0.0  # q less the aim
        self.place: Vector = NOWHERE
        self.footing: Footing | None = None
        self.way = Way(False, NOWHERE, NO_VECTOR, 0.0, 0.0, 0.0)

    def begin(self, place: Vector) -> None:
        """Begin where the robot is [m]."""
        self.place = place
        self.footing = self.line.follow(place)

    def go(self, target: tuple[float, ...]) -> float:
        """One tick towards a place [m], on the way that was set before; returns q [m]."""
        footing = self.footing
        if footing is None:
            return math.nan
        if self.way.open:
            x, y, z = target
            step = self._step(subtract((x, y, z), self.place), footing.normal)
            self.place = self._held_back(add(self.place, step))
            self.footing = self.line.follow(self.place)
        return self.footing.along if self.footing is not None else math.nan

    def meet(self, offset: float) -> None:
        """Come nearer to the coordinate of the probe, whose line has this offset [m], no faster than it may return."""
        if not self.way.open or self.footing is None:
            return
        apart = offset - self.line.offset
        deeper = min(self._return, max(self.way.deeper, 0.0) * self._period)
        self.line.offset += min(max(apart, -self._return), deeper)
        self.footing = self.line.follow(self.place)

    def held_at(self, aim: float) -> Vector:
        """The place for an aim along the normal [m]."""
        footing = self.footing
        if footing is None:
            return NOWHERE
        before, self._size = self._size, max(footing.along - aim, 0.0)
        apart, normal = self._apart, footing.normal
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
            return self.place  # nobody knows what it would push
        unexplained = force - max(way.pressed, 0.0)
        if self._inwards is None:
            if unexplained <= OBSTACLE:
                return path
            self._inwards = scaled(way.resistance, -1.0 / force)
            self._allowed = dot(self.place, self._inwards)
            self._guard = ForceGuard()
        inwards = self._inwards
        against = -dot(way.resistance, inwards) - max(way.pressed, 0.0)
        self._guard.observe(dot(way.here, inwards), against, against > OBSTACLE)
        self._allowed += max(self._guard.speed(HELD * self._ceiling) * self._period, -self._longest)
        beyond = dot(path, inwards) - self._allowed
        if beyond <= 0.0:
            if unexplained <= OBSTACLE:
                self._inwards = None  # it goes elsewhere
            self._allowed = dot(path, inwards)
            return path
        return subtract(path, scaled(inwards, beyond))
