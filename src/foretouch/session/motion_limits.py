"""The last thing before the robot: a path that keeps limits of speed, acceleration and jerk, whatever it is told."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.models.checks import require
from foretouch.models.motion import VELOCITY_CUTOFF

__all__ = ["MotionLimits"]

Array = NDArray[np.float64]

RATE = 100.0
"""Lambda: how fast a lag dies away [rad/s]."""

LOCKING = 0.1
"""The stream is caught up with once this share of what acceleration allows in a tick would lead to it."""

EMERGENCY = 5.0
"""Where positions grow, a path that would pass the stream, or is too fast, brakes by up to so many times the largest
acceleration."""

BRAKING = 0.7
"""Share of the largest acceleration with which it reckons when it brakes in time."""

POSITION, VELOCITY, ACCELERATION = 0, 1, 2
"""Places of the path among its numbers [m, m/s, m/s^2]; the others are the kernel's own."""


class MotionLimits:
    r"""Follows a stream of positions exactly where that is within the limits, and as quickly as they allow elsewhere.

    A step that leads to the stream, at a speed not far from its own, and keeps all three limits is taken as it is.
    Otherwise, with the lag e of the path behind the stream, the low-passed speed u of the stream and v of the path,

    .. math::
        a = 2 \lambda (u + v_c - v), \quad
        v_c = \operatorname{sign}(e) \min\left(\frac{\lambda |e|}{2}, \sqrt{1.4\, A\, |e|}\right), \quad
        \lambda = 100\ \mathrm{s^{-1}}

    is wanted: a lag dies away critically damped, and a large one is closed at a speed from which it can brake in time.
    Then a changes by at most J T, is clipped to A, and the speed to V. Only who would go deeper than the stream, which
    is where positions grow, or there faster than is said, brakes harder, by up to 5 A at once: nothing is worse than to
    press more than one is told.

    Args:
        speed: V [m/s], positive.
        acceleration: A [m/s^2], positive.
        jerk: J [m/s^3], positive.
        sample_period: T [s], positive.
        path: Where its numbers are kept, in zeros that somebody else holds too, shape
            (`foretouch.session.motion_limits_kernel.SIZE`,); None for an array of its own.
    """

    __slots__ = ("_limited", "_path")

    def __init__(
        self, speed: float, acceleration: float, jerk: float, sample_period: float, *, path: Array | None = None
    ) -> None:
        require("speed", speed, above=0.0)
        require("acceleration", acceleration, above=0.0)
        require("jerk", jerk, above=0.0)
        require("sample_period", sample_period, above=0.0)
        # Imported here: it brings a compiler along, and imports the numbers above.
        from foretouch.session import motion_limits_kernel as kernel

        gain = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period)
        self._limited = kernel.limited
        self._path = np.zeros(kernel.SIZE) if path is None else path
        self._path[POSITION] = self._path[kernel.BEFORE] = math.nan
        self._path[kernel.CAUGHT] = 1.0
        self._path[kernel.SPEED :] = speed, acceleration, jerk, sample_period, gain

    @property
    def position(self) -> float:
        """Of the path [m]; NaN before the first sample."""
        return float(self._path[POSITION])

    @property
    def velocity(self) -> float:
        """Of the path [m/s]."""
        return float(self._path[VELOCITY])

    @property
    def acceleration(self) -> float:
        """Of the path [m/s^2]."""
        return float(self._path[ACCELERATION])

    def update(self, wanted: float, upwards: float = math.inf, shifted: float = 0.0) -> float:
        """One tick: the next position of the path [m]. The first is taken as it is.

        Args:
            wanted: Newest position of the stream [m]; no number means to stay.
            upwards: Where positions grow the path is no faster than this either [m/s], not negative; a path that is,
                brakes.
            shifted: By how far the stream was set elsewhere since the last tick [m]: no motion of it.
        """
        return self._limited(self._path, wanted, upwards, shifted)
