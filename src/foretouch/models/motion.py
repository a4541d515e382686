"""Velocity and acceleration from positions, causally: what the laws take as velocity, the same at both ends."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require

VELOCITY_CUTOFF = 80.0
"""Cut-off of the velocity low-pass [Hz]: a 5 um encoder at 1 kHz leaves 0.5 mm/s of noise, and it lags by 2 ms."""

ACCELERATION_CUTOFF = 40.0
"""Cut-off of the acceleration low-pass [Hz]."""


class MotionFilter:
    r"""Differences of position through first-order low-passes that allow for uneven sample times.

    .. math::
        v_k = v_{k-1} + \left(1 - e^{-2 \pi f_c T}\right)\left(\frac{x_k - x_{k-1}}{T} - v_{k-1}\right)

    and the same once more, with its own cut-off, from velocity to acceleration. Positions themselves are not
    filtered: that would smear impacts.

    Args:
        velocity_cutoff: f_c of the velocity [Hz], positive.
        acceleration_cutoff: f_c of the acceleration [Hz], positive.

    Attributes:
        velocity: Newest estimate [m/s]; 0 before the second sample.
        acceleration: Newest estimate [m/s^2]; 0 before the second sample.
    """

    __slots__ = ("_acceleration_rate", "_position", "_time", "_velocity_rate", "acceleration", "velocity")

    def __init__(
        self, velocity_cutoff: float = VELOCITY_CUTOFF, acceleration_cutoff: float = ACCELERATION_CUTOFF
    ) -> None:
        require("velocity_cutoff", velocity_cutoff, above=0.0)
        require("acceleration_cutoff", acceleration_cutoff, above=0.0)
        self._velocity_rate = 2.0 * math.pi * velocity_cutoff
        self._acceleration_rate = 2.0 * math.pi * acceleration_cutoff
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._time = math.nan
        self._position = math.nan
        self.velocity = 0.0
        self.acceleration = 0.0

    def shift(self, distance: float) -> None:
        """Count positions from now on from elsewhere: what was at x is at x plus this distance [m]; nothing moved."""
        self._position += distance

    def update(self, time: float, position: float) -> float:
        """Take one sample and return the velocity [m/s].

        A sample that is not finite, or not later than the one before, is left out.
        """
        period = time - self._time
        if not period > 0.0 or not math.isfinite(position):
            if math.isnan(self._time) and math.isfinite(position) and math.isfinite(time):
                self._time, self._position = time, position
            return self.velocity
        before, acceleration = self.velocity, self.acceleration
        slope = (position - self._position) / period
        velocity = before + (1.0 - math.exp(-self._velocity_rate * period)) * (slope - before)
        change = (velocity - before) / period
        self.acceleration = acceleration + (1.0 - math.exp(-self._acceleration_rate * period)) * (change - acceleration)
        self.velocity, self._time, self._position = velocity, time, position
        return velocity

    def run(self, time: Iterable[float], position: Iterable[float]) -> NDArray[np.float64]:
        """Velocities [m/s] of a whole recording, sample by sample."""
        return np.array([self.update(t, x) for t, x in zip(time, position, strict=True)])
