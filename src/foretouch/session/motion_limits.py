"""The last thing before the robot: a path that keeps limits of speed, acceleration and jerk, whatever it is told."""

from __future__ import annotations

import math

from foretouch.models.checks import require
from foretouch.models.motion import VELOCITY_CUTOFF

__all__ = ["MotionLimits"]

RATE = 100.0
"""Lambda: how fast a lag dies away [rad/s]."""

LOCKING = 0.1
"""The stream is caught up with once this share of what acceleration allows in a tick would lead to it."""

EMERGENCY = 5.0
"""Where positions grow, a path that would pass the stream, or is too fast, brakes by up to so many times the largest
acceleration."""

BRAKING = 0.7
"""Share of the largest acceleration with which it reckons when it brakes in time."""


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

    Attributes:
        position: Of the path [m]; NaN before the first sample.
        velocity: [m/s].
        acceleration: [m/s^2].
    """

    __slots__ = (
        "_before",
        "_caught",
        "_gain",
        "_jerk",
        "_largest",
        "_period",
        "_speed",
        "_stream",
        "acceleration",
        "position",
        "velocity",
    )

    def __init__(self, speed: float, acceleration: float, jerk: float, sample_period: float) -> None:
        require("speed", speed, above=0.0)
        require("acceleration", acceleration, above=0.0)
        require("jerk", jerk, above=0.0)
        require("sample_period", sample_period, above=0.0)
        self._speed, self._largest, self._jerk, self._period = speed, acceleration, jerk, sample_period
        self._gain = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period)
        self._before = self.position = math.nan
        self._caught = True
        self._stream = self.velocity = self.acceleration = 0.0

    def update(self, wanted: float, upwards: float = math.inf, shifted: float = 0.0) -> float:
        """One tick: the next position of the path [m]. The first is taken as it is.

        Args:
            wanted: Newest position of the stream [m]; no number means to stay.
            upwards: Where positions grow the path is no faster than this either [m/s], not negative; a path that is,
                brakes.
            shifted: By how far the stream was set elsewhere since the last tick [m]: no motion of it.
        """
        if math.isnan(self.position):
            self._before = self.position = wanted
            return wanted
        if not math.isfinite(wanted):
            wanted = self._before + shifted
        period, lag = self._period, wanted - self.position
        self._stream += self._gain * ((wanted - self._before - shifted) / period - self._stream)
        self._before = wanted
        velocity = lag / period
        acceleration = (velocity - self.velocity) / period
        self._caught = (
            self._caught or abs(velocity - self._stream) <= LOCKING * self._largest * period
        ) and self._kept(velocity, acceleration, upwards)
        if not self._caught:
            closing = min(0.5 * RATE * abs(lag), math.sqrt(2.0 * BRAKING * self._largest * abs(lag)))
            towards = min(_clip(self._stream + math.copysign(closing, lag), self._speed), upwards)
            acceleration = _clip(2.0 * RATE * (towards - self.velocity), self._largest)
            change = _clip(acceleration - self.acceleration, self._jerk * period)
            acceleration = _clip(self.acceleration + change, self._largest)
            velocity = _clip(self.velocity + acceleration * period, self._speed)
            most = min(max(lag / period, 0.0), upwards)
            if velocity > most:  # never deeper, nor deeper faster, than it is told, if it can stop
                velocity = min(velocity, max(most, self.velocity - EMERGENCY * self._largest * period))
            acceleration = (velocity - self.velocity) / period
        self.velocity, self.acceleration = velocity, acceleration
        self.position += velocity * period
        return self.position

    def _kept(self, velocity: float, acceleration: float, upwards: float) -> bool:
        """Whether a step of this speed and acceleration keeps all limits."""
        jerk = abs(acceleration - self.acceleration) / self._period
        return (
            -self._speed <= velocity <= min(self._speed, upwards)
            and abs(acceleration) <= self._largest
            and jerk <= self._jerk
        )


def _clip(value: float, largest: float) -> float:
    return min(max(value, -largest), largest)
