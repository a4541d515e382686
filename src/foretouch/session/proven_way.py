"""What the robot's own motion has proven of the way in, place by place; all else counts as the worst."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["ProvenWay"]

Array = NDArray[np.float64]

CELL = 2.5e-4
"""Length of a cell of the way [m]: a count of 15 um that flickers is 6 % of it, and a millimetre has four."""

CELLS = 1024
"""So many are remembered, 256 mm; the newest take the place of those that lie as far away."""

MEAN = 10
"""Positions are the mean of so many ticks, and forces the largest of the same: noise is no motion, and sensors are
late."""

LARGEST_STEP = 2e-3
"""A position that is further than this from that of the tick before [m] is another place, and no motion to it."""

GROWTH = 4.0
"""A way that was gone at one speed is gone so many times as fast at most the next time: no law is believed further."""

CONTRADICTED = 1.2
"""A force so many times as large as what was proven takes its place."""

LEAST_FORCE = 0.25
"""Damping is reckoned with from at least this force [N]: the sensor's zero errs."""


class ProvenWay:
    r"""Remembers how fast the robot has gone in through each cell of the way, and what that felt like.

    A cell that it went through at the mean speed u, with at most the force F while it was there, and at least the force
    E on the way back out, bounds the force at any other speed v there:

    .. math:: F(v) \le F + (F - E) \max(v / u - 1, 0)

    for a material whose force is elastic, E(x) or more, and damped in proportion to speed, or less; and for linear
    viscoelastic ones at a steady speed. So it may go there at

    .. math:: w = u \Big(1 + \frac{F_a - F}{F - E}\Big) \le 4 u

    with F_a the force that may be reached, and no faster than u where F is above F_a. Speed and place are those of the
    mean of ten measured positions, and the speed is that over a whole cell: what was told, or what an encoder's noise
    shows in one tick, proves nothing. A cell that was never crossed, from its outer to its inner end, proves nothing.
    A crossing that felt 1.2 times as much as was proven, or as much less than that allows, takes its place: it is
    another material. Else the fastest stays.

    Args:
        numbers: Where they are kept, in an array that somebody else holds too, shape
            (`foretouch.session.proven_way_kernel.SIZE`,); None for one of its own.
    """

    __slots__ = ("_forget", "_numbers", "_observe", "_speed")

    def __init__(self, numbers: Array | None = None) -> None:
        # Imported here: it brings a compiler along, and imports the numbers above.
        from foretouch.session import proven_way_kernel as kernel

        self._observe, self._forget, self._speed = kernel.observe_way, kernel.forget_way, kernel.proven_speed
        self._numbers = np.zeros(kernel.SIZE) if numbers is None else numbers
        self.forget()

    def forget(self) -> None:
        """Nothing is proven any more: it is another place."""
        self._forget(self._numbers)

    def observe(self, position: float, force: float, period: float) -> None:
        """One sample of the sensors, finite.

        Args:
            position: [m].
            force: That is felt [N].
            period: Since the one before [s].
        """
        self._observe(self._numbers, position, force, period)

    def speed(self, position: float, allowed: float) -> float:
        """Speed w at which the cell of a place may be gone through [m/s]; NaN where nothing is proven.

        Args:
            position: [m].
            allowed: F_a [N].
        """
        found = self._speed(self._numbers, position, allowed)
        return found if found > 0.0 else math.nan
