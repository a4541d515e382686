"""Last stage before the robot: a path that keeps limits of speed, acceleration and jerk, whatever is commanded.

Like the other kernels of the follower's step it keeps its numbers in one array, and has its types stated: a driver that
returns an integer where a float came before must cause no new compilation in a loop.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.errors.checks import require
from foretouch.models.predictor import VELOCITY_CUTOFF
from foretouch.quantities import pose as rigid
from foretouch.quantities.pose import Vector, norm

Array = NDArray[np.float64]

Bound = tuple[float, float, float, float]
"""A direction of length 1 and the largest speed of the path that way [m/s], not negative."""

UNBOUNDED: Bound = (0.0, 0.0, 0.0, math.inf)
"""Bound that limits nothing."""

RATE = 100.0
"""Lambda: decay rate of a lag [rad/s]."""

LOCKING = 0.1
"""Fraction of the largest change of velocity in a tick within which the path locks onto the stream."""

EMERGENCY = 5.0
"""Largest braking as a multiple of the largest acceleration, for a path that would pass the stream in the direction of
a bound, or is too fast."""

BRAKING = 0.7
"""Fraction of the largest acceleration assumed for braking in time."""

FARTHEST = 1e3
"""Largest coordinate of a valid position [m]: beyond it nothing can be computed to a micrometre."""

POSITION, VELOCITY, ACCELERATION = 0, 3, 6
"""First indices of the path's position, velocity and acceleration in its array [m, m/s, m/s^2], three numbers each; on
a line the first of three is all of it. The others are the kernel's own."""


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

    Bounds are directions in which going on is dangerous: deeper into a surface, or against a force. A path that would
    go further that way than the stream, or faster than the bound allows, brakes harder, at once, and by up to 5 A: to
    press more than commanded is the worst case. In such a tick, and the one after it, the last two limits are

    .. math:: |\Delta v| \le 5 A T, \quad |\Delta a| \le 10 A.

    Two ticks that brake one after the other in opposite directions come near to the last one. On a line the one
    direction is where positions grow, and it is 6 A: 5 A of braking, and A the other way.

    Once begun at numbers the path has numbers, whatever is asked.

    Args:
        speed: V [m/s], positive.
        acceleration: A [m/s^2], positive.
        jerk: J [m/s^3], positive.
        sample_period: T [s], positive.
        path: Array of zeros that holds its numbers, shared with others, shape
            (`foretouch.session.safety.motion.SIZE`,); None for an array of its own.
    """

    __slots__ = ("_asked", "_path")

    def __init__(
        self, speed: float, acceleration: float, jerk: float, sample_period: float, *, path: Array | None = None
    ) -> None:
        require("speed", speed, above=0.0)
        require("acceleration", acceleration, above=0.0)
        require("jerk", jerk, above=0.0)
        require("sample_period", sample_period, above=0.0)
        gain = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period)
        self._path = np.zeros(SIZE) if path is None else path
        self._asked = self._path[WANTED:SPEED]
        self._path[POSITION:VELOCITY] = math.nan
        self._path[SPEED:] = speed, acceleration, jerk, sample_period, gain

    @property
    def place(self) -> Vector:
        """Position of the path [m]; NaN before it has begun."""
        return self._vector(POSITION)

    @property
    def velocity(self) -> Vector:
        """Velocity of the path [m/s]."""
        return self._vector(VELOCITY)

    @property
    def acceleration(self) -> Vector:
        """Acceleration of the path [m/s^2]."""
        return self._vector(ACCELERATION)

    @property
    def speed(self) -> float:
        """Speed of the path [m/s], not negative."""
        return norm(self.velocity)

    def _vector(self, begin: int) -> Vector:
        x, y, z = self._path[begin : begin + 3].tolist()
        return x, y, z

    def begin(self, x: float, y: float = 0.0, z: float = 0.0) -> None:
        """Begin where the robot is, at rest [m]."""
        begin(self._path, x, y, z)

    def update(self, wanted: float, upwards: float = math.inf, shifted: float = 0.0) -> float:
        """One tick on a line: the next position of the path [m]; no number before it has begun.

        Args:
            wanted: Newest position of the stream [m]; no number means to stay.
            upwards: Where positions grow the path is no faster than this either [m/s], not negative; a path that is,
                brakes.
            shifted: Displacement of the stream by a limit since the last tick [m], which is no motion of it; NaN, or
                more than 1 km, is 0.
        """
        return limited(self._path, wanted, upwards, shifted)

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
            shifted: Displacement of the stream by a limit since the last tick [m], which is no motion of it; NaN, or
                more than 1 km, is 0.
        """
        first, second, third = bounds
        self._asked[:] = wanted + shifted + first + second + third
        moved(self._path)
        return self.place


BEFORE, STREAM, CAUGHT = 9, 12, 15
"""Indices, after those of the path, of the stream's newest position [m] and its low-passed velocity u [m/s], three
numbers each, and of whether it was caught up with."""

WANTED, SHIFTED, BOUNDS = 16, 19, (22, 26, 30)
"""Indices of this tick's inputs: three numbers [m], three [m], and directions with the speed allowed there."""

SPEED, LARGEST, JERK, PERIOD, GAIN = 34, 35, 36, 37, 38
"""Indices of the constants V [m/s], A [m/s^2], J [m/s^3], T [s], and the gain of the low-pass."""

SIZE = 39

NOTHING: Vector = (0.0, 0.0, 0.0)

_add = compiled(rigid.add)
_dot = compiled(rigid.dot)
_norm = compiled(rigid.norm)
_scaled = compiled(rigid.scaled)
_subtract = compiled(rigid.subtract)


@compiled
def _read(path: Array, begin: int) -> Vector:
    return path[begin], path[begin + 1], path[begin + 2]


@compiled
def _write(path: Array, begin: int, vector: Vector) -> None:
    path[begin], path[begin + 1], path[begin + 2] = vector


@compiled
def _know(vector: Vector, otherwise: Vector) -> Vector:
    """Replace a vector that has no number, or one beyond `FARTHEST`."""
    x, y, z = vector
    return vector if abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(z) <= FARTHEST else otherwise


@compiled
def _clip(vector: Vector, longest: float) -> Vector:
    """Limit a vector to this length."""
    length = _norm(vector)
    return _scaled(vector, longest / length) if length > longest else vector


@compiled
def _slow_down(path: Array, velocity: Vector) -> Vector:
    """Limit a velocity to the bounds."""
    for bound in BOUNDS:
        direction = _read(path, bound)
        beyond = _dot(velocity, direction) - path[bound + 3]
        if beyond > 0.0:
            velocity = _subtract(velocity, _scaled(direction, beyond))
    return velocity


@compiled
def _is_within(path: Array, velocity: Vector, last_velocity: Vector, last_acceleration: Vector) -> bool:
    """Whether a step at this velocity keeps all limits, and the next ones can."""
    period, speed, jerk = path[PERIOD], path[SPEED], path[JERK]
    acceleration = _scaled(_subtract(velocity, last_velocity), 1.0 / period)
    size = _norm(acceleration)
    # While the acceleration returns to 0 at the largest jerk, the velocity grows by this amount.
    coming = max(size / (2.0 * jerk) - 0.5 * period, 0.0)
    if not (_norm(velocity) <= speed and _norm(_add(velocity, _scaled(acceleration, coming))) <= speed):
        return False
    for bound in BOUNDS:
        if not _dot(velocity, _read(path, bound)) <= path[bound + 3]:
            return False
    change = _norm(_subtract(acceleration, last_acceleration))
    return bool(size <= path[LARGEST] and change <= jerk * period)


@compiled
def _brake(path: Array, velocity: Vector, last_velocity: Vector, lag: Vector) -> Vector:
    """Brake so as to go no further or faster than commanded in a dangerous direction, if the path can stop."""
    period = path[PERIOD]
    hardest = EMERGENCY * path[LARGEST] * period
    braked = velocity
    for bound in BOUNDS:
        direction = _read(path, bound)
        most = min(max(_dot(lag, direction) / period, 0.0), path[bound + 3])
        fast = _dot(braked, direction)
        if fast > most:
            slower = min(fast, max(most, _dot(last_velocity, direction) - hardest))
            braked = _subtract(braked, _scaled(direction, fast - slower))
    return _add(last_velocity, _clip(_subtract(braked, last_velocity), hardest))


@compiled
def _catch_up(path: Array, lag: Vector, stream: Vector, last_velocity: Vector, last_acceleration: Vector) -> Vector:
    """The velocity with which a path that is not with the stream comes to it."""
    period, largest, jerk = path[PERIOD], path[LARGEST], path[JERK]
    rate, far = min(RATE, jerk / (4.0 * largest)), _norm(lag)
    towards = stream
    if far > 0.0:
        closing = min(0.5 * rate * far, math.sqrt(2.0 * BRAKING * largest * far))
        towards = _add(stream, _scaled(lag, closing / far))
    towards = _slow_down(path, _clip(towards, path[SPEED]))
    acceleration = _clip(_scaled(_subtract(towards, last_velocity), 2.0 * rate), largest)
    change = _clip(_subtract(acceleration, last_acceleration), jerk * period)
    acceleration = _clip(_add(last_acceleration, change), largest)
    velocity = _clip(_add(last_velocity, _scaled(acceleration, period)), path[SPEED])
    return _brake(path, velocity, last_velocity, lag)


@compiled("void(f8[::1], f8, f8, f8)")
def begin(path: Array, x: float, y: float, z: float) -> None:
    """See `MotionLimits.begin`; the array is written."""
    path[: CAUGHT + 1] = 0.0
    path[POSITION], path[POSITION + 1], path[POSITION + 2] = x, y, z
    path[BEFORE], path[BEFORE + 1], path[BEFORE + 2] = x, y, z
    path[CAUGHT] = 1.0


@compiled("void(f8[::1])")
def moved(path: Array) -> None:
    """One tick: see `MotionLimits.move`; what is asked has been written, and the path is."""
    if math.isnan(path[POSITION]):
        return
    period, largest = path[PERIOD], path[LARGEST]
    last_velocity, last_acceleration = _read(path, VELOCITY), _read(path, ACCELERATION)
    before, stream = _read(path, BEFORE), _read(path, STREAM)
    stayed = _add(before, _know(_read(path, SHIFTED), NOTHING))
    wanted = _know(_read(path, WANTED), stayed)
    for bound in BOUNDS:
        _write(path, bound, _know(_read(path, bound), NOTHING))
        if not path[bound + 3] >= 0.0:
            path[bound + 3] = 0.0
    lag = _subtract(wanted, _read(path, POSITION))
    going = _clip(_scaled(_subtract(wanted, stayed), 1.0 / period), path[SPEED])  # a jump is no speed to follow
    stream = _add(stream, _scaled(_subtract(going, stream), path[GAIN]))
    velocity = _scaled(lag, 1.0 / period)
    near = path[CAUGHT] != 0.0 or _norm(_subtract(velocity, stream)) <= LOCKING * largest * period
    kept = near and _is_within(path, velocity, last_velocity, last_acceleration)
    if not kept:
        velocity = _catch_up(path, lag, stream, last_velocity, last_acceleration)
    path[CAUGHT] = 1.0 if kept else 0.0
    _write(path, BEFORE, wanted)
    _write(path, STREAM, stream)
    _write(path, VELOCITY, velocity)
    _write(path, ACCELERATION, _scaled(_subtract(velocity, last_velocity), 1.0 / period))
    _write(path, POSITION, _add(_read(path, POSITION), _scaled(velocity, period)))


@compiled("f8(f8[::1], f8, f8, f8)")
def limited(path: Array, wanted: float, upwards: float, shifted: float) -> float:
    """One tick on a line: the next position [m]. The arguments are those of `MotionLimits.update`."""
    path[WANTED:SPEED] = 0.0
    path[WANTED], path[SHIFTED] = wanted, shifted
    for bound in BOUNDS:
        path[bound + 3] = math.inf
    path[BOUNDS[0]], path[BOUNDS[0] + 3] = 1.0, upwards
    moved(path)
    return float(path[POSITION])
