"""The last thing before the robot: a path that keeps limits of speed, acceleration and jerk, whatever it is told."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.models.motion import VELOCITY_CUTOFF
from foretouch.quantities.pose import Vector, norm

__all__ = ["UNBOUNDED", "Bound", "MotionLimits"]

Array = NDArray[np.float64]

Bound = tuple[float, float, float, float]
"""A direction of length 1 and how fast the path may go that way at most [m/s], not negative."""

UNBOUNDED: Bound = (0.0, 0.0, 0.0, math.inf)
"""None."""

RATE = 100.0
"""Lambda: how fast a lag dies away [rad/s]."""

LOCKING = 0.1
"""The stream is caught up with once this share of what acceleration allows in a tick would lead to it."""

EMERGENCY = 5.0
"""In the direction of a bound, a path that would pass the stream, or is too fast, brakes by up to so many times the
largest acceleration."""

BRAKING = 0.7
"""Share of the largest acceleration with which it reckons when it brakes in time."""

FARTHEST = 1e3
"""A place beyond this is none [m]: so far off nothing can be reckoned to a micrometre."""

POSITION, VELOCITY, ACCELERATION = 0, 3, 6
"""Where the three numbers of the path's place, velocity and acceleration begin in its array [m, m/s, m/s^2]; on a line
the first of three is all of it. The others are the kernel's own."""


class MotionLimits:
    r"""Follows a stream of places exactly where that is within the limits, and as quickly as they allow elsewhere.

    A path begins where the robot is, at rest (`begin`). A step that leads to the stream, at a velocity not far from its
    own, and keeps all three limits is taken as it is. Otherwise, with the lag e of the path behind the stream, the
    low-passed velocity u of the stream, which counts as no faster than V in a tick, and v of the path, all of them
    vectors,

    .. math::
        a = 2 \lambda (u + v_c - v), \quad
        v_c = \frac{e}{|e|} \min\left(\frac{\lambda |e|}{2}, \sqrt{1.4\, A\, |e|}\right), \quad
        \lambda = \min\left(100\ \mathrm{s^{-1}}, \frac{J}{4 A}\right)

    is wanted, u + v_c being no longer than V: a lag dies away critically damped, and a large one is closed at a speed
    from which it can brake in time. Then a changes by at most J T, and its length is clipped to A, and that of the
    velocity to V. So in every tick

    .. math:: |v| \le V, \quad |\Delta v| \le A T, \quad |\Delta a| \le J T.

    Bounds are directions in which going on is dangerous: deeper into a surface, or against a force. Who would go
    further that way than the stream, or faster than the bound says, brakes harder, at once, and by up to 5 A: nothing
    is worse than to press more than one is told. In such a tick, and the one after it, the last two limits are

    .. math:: |\Delta v| \le 5 A T, \quad |\Delta a| \le 10 A.

    Two ticks that brake one after the other in opposite directions come near to the last one. On a line the one
    direction is where positions grow, and it is 6 A: 5 A of braking, and A the other way.

    Once begun at numbers the path has numbers, whatever is asked.

    Args:
        speed: V [m/s], positive.
        acceleration: A [m/s^2], positive.
        jerk: J [m/s^3], positive.
        sample_period: T [s], positive.
        path: Where its numbers are kept, in zeros that somebody else holds too, shape
            (`foretouch.session.motion_limits_kernel.SIZE`,); None for an array of its own.
    """

    __slots__ = ("_asked", "_begun", "_limited", "_moved", "_path")

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
        self._begun, self._limited, self._moved = kernel.begin, kernel.limited, kernel.moved
        self._path = np.zeros(kernel.SIZE) if path is None else path
        self._asked = self._path[kernel.WANTED : kernel.SPEED]
        self._path[POSITION:VELOCITY] = math.nan
        self._path[kernel.SPEED :] = speed, acceleration, jerk, sample_period, gain

    @property
    def place(self) -> Vector:
        """Of the path [m]; no numbers before it has begun."""
        return self._vector(POSITION)

    @property
    def velocity(self) -> Vector:
        """Of the path [m/s]."""
        return self._vector(VELOCITY)

    @property
    def acceleration(self) -> Vector:
        """Of the path [m/s^2]."""
        return self._vector(ACCELERATION)

    @property
    def speed(self) -> float:
        """Of the path [m/s], not negative."""
        return norm(self.velocity)

    def _vector(self, begin: int) -> Vector:
        x, y, z = self._path[begin : begin + 3].tolist()
        return x, y, z

    def begin(self, x: float, y: float = 0.0, z: float = 0.0) -> None:
        """Begin where the robot is, at rest [m]."""
        self._begun(self._path, x, y, z)

    def update(self, wanted: float, upwards: float = math.inf, shifted: float = 0.0) -> float:
        """One tick on a line: the next position of the path [m]; no number before it has begun.

        Args:
            wanted: Newest position of the stream [m]; no number means to stay.
            upwards: Where positions grow the path is no faster than this either [m/s], not negative; a path that is,
                brakes.
            shifted: By how far the stream was set elsewhere since the last tick [m]: no motion of it; no number, or
                more than 1 km, is 0.
        """
        return self._limited(self._path, wanted, upwards, shifted)

    def move(
        self,
        wanted: Vector,
        bounds: tuple[Bound, Bound, Bound] = (UNBOUNDED, UNBOUNDED, UNBOUNDED),
        shifted: Vector = (0.0, 0.0, 0.0),
    ) -> Vector:
        """One tick in space: the next place of the path [m]; no numbers before it has begun.

        Args:
            wanted: Newest place of the stream [m]; one with no number, or beyond 1 km, means to stay.
            bounds: Directions in which going on is dangerous; where they are at odds, the last comes first. One without
                numbers is none, and a speed that is no number is 0.
            shifted: By how far the stream was set elsewhere since the last tick [m]: no motion of it; one with no
                number, or beyond 1 km, is 0.
        """
        first, second, third = bounds
        self._asked[:] = wanted + shifted + first + second + third
        self._moved(self._path)
        return self.place
