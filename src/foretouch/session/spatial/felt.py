"""What contacts in space tell: where the surface is that one began at, friction, and when the materials are sent.

Friction is learnt from force and speed along the surface, smoothed alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.identification import Estimator, MaterialFieldLearner
from foretouch.messages import VERSION, FieldUpdate
from foretouch.quantities import Brief
from foretouch.quantities.pose import Vector, add, scaled, subtract
from foretouch.session.settings import SAMPLE_PERIOD
from foretouch.session.spatial.course import ClosestPoint

LATEST = 2e-3
"""A contact that would have been noticed later than this depth tells no surface [m]."""

FELT_WAY, TOUCH_EXPONENT = 1e-3, 1.15
"""The surface is known from how the force grows over this way [m], with this exponent of depth."""


class FeltSurface:
    r"""Where a contact began, once it is 1 mm deep.

    A contact is noticed late, at a force F_1 that the surface gives at a depth d. With F_2 after h more,

    .. math:: d = \frac{r h}{1 - r}, \quad r = (F_1 / F_2)^{1 / n}

    for a law of exponent n, here 1.15: a spring has 1, and Hertz's ball 1.5.

    Attributes:
        ticks: Since this contact began; 0 while there is none.
        place: Where the newest contact began that tells of the surface [m]; no numbers before it.
        tick: And when that was known.
    """

    __slots__ = ("_onset", "_told", "place", "tick", "ticks")

    def __init__(self) -> None:
        self._onset = 0.0, 0.0  # force at which this contact began [N], and the position along the normal then [m]
        self._told = False
        self.place: Vector = (math.nan, math.nan, math.nan)
        self.tick = self.ticks = 0

    def leave(self) -> bool:
        """Nothing is felt in this tick; whether something was in the one before."""
        left, self.ticks = self.ticks > 0, 0
        return left

    def feel(self, force: float, place: Vector, closest: ClosestPoint, tick: int) -> None:
        """Feel a force [N] in a tick.

        Args:
            force: Along the normal.
            place: Of the probe [m].
            closest: The same against the surface.
            tick: Number of this one.
        """
        self.ticks += 1
        if self.ticks == 1:
            self._onset, self._told = (force, closest.along), False
        began, at = self._onset
        way = closest.along - at
        if self._told or way < FELT_WAY:
            return
        self._told = True
        ratio = (began / force) ** (1.0 / TOUCH_EXPONENT) if 0.0 < began < force else 1.0
        if ratio * way > LATEST * (1.0 - ratio):  # it hardly grew: its onset is unknown
            return
        self.place = add(place, scaled(closest.normal, way / (1.0 - ratio)))
        self.tick = tick


FIELD_PERIOD_NS = 100_000_000
"""Between two fields of materials, at least [ns]."""

FIELD_RATE = 30e3
"""Largest byte rate of the fields [byte/s]."""


class FieldSender:
    """Sends a field if it has changed and the last one is some time ago: the longer, the larger that was.

    Args:
        run: Epoch of the follower's process.
    """

    __slots__ = ("_next_ns", "_run", "_sent", "_updates")

    def __init__(self, run: int) -> None:
        self._run = run
        self._next_ns = self._updates = self._sent = 0

    def due(self, estimator: Estimator, now_ns: int) -> FieldUpdate | None:
        """The field that is due, of an estimator that learns one.

        Args:
            estimator: Of the session.
            now_ns: This side's monotonic clock [ns].
        """
        if not isinstance(estimator, MaterialFieldLearner) or estimator.updates == self._updates:
            return None
        if now_ns < self._next_ns:
            return None
        content = estimator.field.to_bytes()
        self._next_ns = now_ns + max(FIELD_PERIOD_NS, round(1e9 * len(content) / FIELD_RATE))
        self._updates = estimator.updates
        self._sent += 1
        return FieldUpdate(VERSION, self._sent, now_ns, content, self._run)


SMOOTHED = -math.expm1(-2.0 * math.pi * 20.0 * SAMPLE_PERIOD)


@dataclass(slots=True)
class SmoothedContact(Brief):
    """What friction is learnt from, through one low-pass of 20 Hz: the speed of one tick is mostly the encoders' noise.

    Attributes:
        pressed: Along the normal [N].
        sideways: Along the surface [N].
        sliding: Velocity along the surface [m/s].
    """

    pressed: float = 0.0
    sideways: Vector = (0.0, 0.0, 0.0)
    sliding: Vector = (0.0, 0.0, 0.0)

    def update(self, pressed: float, sideways: Vector, sliding: Vector) -> None:
        """One tick."""
        self.pressed += SMOOTHED * (pressed - self.pressed)
        self.sideways = add(self.sideways, scaled(subtract(sideways, self.sideways), SMOOTHED))
        self.sliding = add(self.sliding, scaled(subtract(sliding, self.sliding), SMOOTHED))
