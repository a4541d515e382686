"""Where the surface is that a contact began at."""

from __future__ import annotations

import math

from foretouch.quantities.pose import Vector, add, scaled
from foretouch.session.spatial.line import Footing

__all__ = ["FeltSurface"]

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

    def feel(self, force: float, place: Vector, footing: Footing, tick: int) -> None:
        """Feel a force [N] in a tick.

        Args:
            force: Along the normal.
            place: Of the probe [m].
            footing: The same against the surface.
            tick: Number of this one.
        """
        self.ticks += 1
        if self.ticks == 1:
            self._onset, self._told = (force, footing.along), False
        began, at = self._onset
        way = footing.along - at
        if self._told or way < FELT_WAY:
            return
        self._told = True
        ratio = (began / force) ** (1.0 / TOUCH_EXPONENT) if 0.0 < began < force else 1.0
        if ratio * way > LATEST * (1.0 - ratio):  # it hardly grew: nobody can say where it began
            return
        self.place = add(place, scaled(footing.normal, way / (1.0 - ratio)))
        self.tick = tick
