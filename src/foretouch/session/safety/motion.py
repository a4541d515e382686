"""The last thing before the robot: a path that keeps limits of speed, acceleration and jerk, whatever it is told.

Like the other kernels of the follower's step it keeps its numbers in one array, and has its types stated: a driver that
says a whole number where a fraction came before is no reason to compile anew in a loop.
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
        begin(self._path, x, y, z)

    def update(self, wanted: float, upwards: float = math.inf, shifted: float = 0.0) -> float:
        """One tick on a line: the next position of the path [m]; no number before it has begun.

        Args:
            wanted: Newest position of the stream [m]; no number means to stay.
            upwards: Where positions grow the path is no faster than this either [m/s], not negative; a path that is,
                brakes.
            shifted: By how far the stream was set elsewhere since the last tick [m]: no motion of it; no number, or
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
            shifted: By how far the stream was set elsewhere since the last tick [m]: no motion of it; one with no
                number, or beyond 1 km, is 0.
        """
        first, second, third = bounds
        self._asked[:] = wanted + shifted + first + second + third
        moved(self._path)
        return self.place


BEFORE, STREAM, CAUGHT = 9, 12, 15
"""Places in the array, behind those of the path, of what is known of the stream: its newest place [m] and its
low-passed velocity u [m/s], three numbers each, and whether it was caught up with."""

WANTED, SHIFTED, BOUNDS = 16, 19, (22, 26, 30)
"""What is asked in this tick: three numbers [m], three [m], and directions with the speed that is allowed there."""

SPEED, LARGEST, JERK, PERIOD, GAIN = 34, 35, 36, 37, 38
"""What stays: V [m/s], A [m/s^2], J [m/s^3], T [s], and the gain of the low-pass."""

SIZE = 39

NOTHING: Vector = (0.0, 0.0, 0.0)

_add = compiled(rigid.add)
_dot = compiled(rigid.dot)
_norm = compiled(rigid.norm)
_scaled = compiled(rigid.scaled)
_subtract = compiled(rigid.subtract)


def _read(path: Array, begin: int) -> Vector:
    return path[begin], path[begin + 1], path[begin + 2]


_three = compiled(_read)


def _write(path: Array, begin: int, vector: Vector) -> None:
    path[begin], path[begin + 1], path[begin + 2] = vector


_keep = compiled(_write)


def _know(vector: Vector, otherwise: Vector) -> Vector:
    """What to take for it where it has no number, or one beyond `FARTHEST`."""
    x, y, z = vector
    return vector if abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(z) <= FARTHEST else otherwise


_known = compiled(_know)


def _clip(vector: Vector, longest: float) -> Vector:
    """With a length of at most this."""
    length = _norm(vector)
    return _scaled(vector, longest / length) if length > longest else vector


_clipped = compiled(_clip)


def _slow_down(path: Array, velocity: Vector) -> Vector:
    """No faster than the bounds allow."""
    for bound in BOUNDS:
        direction = _three(path, bound)
        beyond = _dot(velocity, direction) - path[bound + 3]
        if beyond > 0.0:
            velocity = _subtract(velocity, _scaled(direction, beyond))
    return velocity


_slowed = compiled(_slow_down)


def _is_kept(path: Array, velocity: Vector, last_velocity: Vector, last_acceleration: Vector) -> bool:
    """Whether a step at this velocity keeps all limits, and the next ones can."""
    period, speed, jerk = path[PERIOD], path[SPEED], path[JERK]
    acceleration = _scaled(_subtract(velocity, last_velocity), 1.0 / period)
    size = _norm(acceleration)
    # While the acceleration comes back to 0 at the largest jerk, the velocity grows by so much of it.
    coming = max(size / (2.0 * jerk) - 0.5 * period, 0.0)
    if not (_norm(velocity) <= speed and _norm(_add(velocity, _scaled(acceleration, coming))) <= speed):
        return False
    for bound in BOUNDS:
        if not _dot(velocity, _three(path, bound)) <= path[bound + 3]:
            return False
    change = _norm(_subtract(acceleration, last_acceleration))
    return bool(size <= path[LARGEST] and change <= jerk * period)


_is_within = compiled(_is_kept)


def _brake(path: Array, velocity: Vector, last_velocity: Vector, lag: Vector) -> Vector:
    """Never further in a dangerous direction, nor faster, than is told, if it can stop."""
    period = path[PERIOD]
    hardest = EMERGENCY * path[LARGEST] * period
    braked = velocity
    for bound in BOUNDS:
        direction = _three(path, bound)
        most = min(max(_dot(lag, direction) / period, 0.0), path[bound + 3])
        fast = _dot(braked, direction)
        if fast > most:
            slower = min(fast, max(most, _dot(last_velocity, direction) - hardest))
            braked = _subtract(braked, _scaled(direction, fast - slower))
    return _add(last_velocity, _clipped(_subtract(braked, last_velocity), hardest))


_braked = compiled(_brake)


def _catch_up(path: Array, lag: Vector, stream: Vector, last_velocity: Vector, last_acceleration: Vector) -> Vector:
    """The velocity with which a path that is not with the stream comes to it."""
    period, largest, jerk = path[PERIOD], path[LARGEST], path[JERK]
    rate, far = min(RATE, jerk / (4.0 * largest)), _norm(lag)
    towards = stream
    if far > 0.0:
        closing = min(0.5 * rate * far, math.sqrt(2.0 * BRAKING * largest * far))
        towards = _add(stream, _scaled(lag, closing / far))
    towards = _slowed(path, _clipped(towards, path[SPEED]))
    acceleration = _clipped(_scaled(_subtract(towards, last_velocity), 2.0 * rate), largest)
    change = _clipped(_subtract(acceleration, last_acceleration), jerk * period)
    acceleration = _clipped(_add(last_acceleration, change), largest)
    velocity = _clipped(_add(last_velocity, _scaled(acceleration, period)), path[SPEED])
    return _braked(path, velocity, last_velocity, lag)


_caught_up = compiled(_catch_up)


def _begin(path: Array, x: float, y: float, z: float) -> None:
    """See `MotionLimits.begin`; the array is written."""
    path[: CAUGHT + 1] = 0.0
    path[POSITION], path[POSITION + 1], path[POSITION + 2] = x, y, z
    path[BEFORE], path[BEFORE + 1], path[BEFORE + 2] = x, y, z
    path[CAUGHT] = 1.0


begin = compiled("void(f8[::1], f8, f8, f8)")(_begin)


def _move(path: Array) -> None:
    """One tick: see `MotionLimits.move`; what is asked has been written, and the path is."""
    if math.isnan(path[POSITION]):
        return
    period, largest = path[PERIOD], path[LARGEST]
    last_velocity, last_acceleration = _three(path, VELOCITY), _three(path, ACCELERATION)
    before, stream = _three(path, BEFORE), _three(path, STREAM)
    stayed = _add(before, _known(_three(path, SHIFTED), NOTHING))
    wanted = _known(_three(path, WANTED), stayed)
    for bound in BOUNDS:
        _keep(path, bound, _known(_three(path, bound), NOTHING))
        if not path[bound + 3] >= 0.0:
            path[bound + 3] = 0.0
    lag = _subtract(wanted, _three(path, POSITION))
    going = _clipped(_scaled(_subtract(wanted, stayed), 1.0 / period), path[SPEED])  # a jump is no speed to follow
    stream = _add(stream, _scaled(_subtract(going, stream), path[GAIN]))
    velocity = _scaled(lag, 1.0 / period)
    near = path[CAUGHT] != 0.0 or _norm(_subtract(velocity, stream)) <= LOCKING * largest * period
    kept = near and _is_within(path, velocity, last_velocity, last_acceleration)
    if not kept:
        velocity = _caught_up(path, lag, stream, last_velocity, last_acceleration)
    path[CAUGHT] = 1.0 if kept else 0.0
    _keep(path, BEFORE, wanted)
    _keep(path, STREAM, stream)
    _keep(path, VELOCITY, velocity)
    _keep(path, ACCELERATION, _scaled(_subtract(velocity, last_velocity), 1.0 / period))
    _keep(path, POSITION, _add(_three(path, POSITION), _scaled(velocity, period)))


moved = compiled("void(f8[::1])")(_move)


def _limit(path: Array, wanted: float, upwards: float, shifted: float) -> float:
    """One tick on a line: the next position [m]. The arguments are those of `MotionLimits.update`."""
    path[WANTED:SPEED] = 0.0
    path[WANTED], path[SHIFTED] = wanted, shifted
    for bound in BOUNDS:
        path[bound + 3] = math.inf
    path[BOUNDS[0]], path[BOUNDS[0] + 3] = 1.0, upwards
    moved(path)
    return float(path[POSITION])


limited = compiled("f8(f8[::1], f8, f8, f8)")(_limit)
