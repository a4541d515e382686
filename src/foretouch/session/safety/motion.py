"""Last stage before the robot: a path that keeps limits of speed, acceleration and jerk, whatever is commanded.

The types of what Python calls are stated, as in the other kernels of the follower's step: a driver that returns an
integer where a float came before must cause no new compilation in a loop.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled
from foretouch.core.compiling import interpreted
from foretouch.errors.checks import require
from foretouch.models.predictor import VELOCITY_CUTOFF
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces.geometry import Numbers3, add, dot, norm, scaled, subtract, vector, write

RATE = 100.0  # Lambda: decay rate of a lag [rad/s]
LOCKING = 0.1  # Fraction of the largest change of velocity in a tick within which the path locks onto the stream

EMERGENCY = 5.0
"""Largest braking as a multiple of the largest acceleration, for a path that would pass the stream in the direction of
a bound, or is too fast."""

BRAKING = 0.7  # Fraction of the largest acceleration assumed for braking in time
FARTHEST = 1e3  # Largest coordinate of a valid position [m]: beyond it nothing can be computed to a micrometre

Bound = tuple[float, float, float, float]
"""A direction of length 1 in which going on is dangerous, and the largest speed of the path that way [m/s]."""

Bounds = tuple[Bound, Bound, Bound]
UNBOUNDED: Bound = (0.0, 0.0, 0.0, math.inf)  # Bound that limits nothing


class Path(Record):
    r"""Follows a stream of places exactly where that is within its limits, and as quickly as they allow elsewhere.

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

    Once begun at numbers the path has numbers, whatever is asked. On a line the first of three numbers is all of it.
    """

    position: Numbers3 = math.nan  # type: ignore[assignment]  # [m]
    velocity: Numbers3  # v [m/s]
    acceleration: Numbers3  # a [m/s^2]
    before: Numbers3  # newest position of the stream [m]
    stream: Numbers3  # u [m/s]
    speed: float  # V [m/s]
    largest: float  # A [m/s^2]
    jerk: float  # J [m/s^3]
    period: float  # T [s]
    gain: float  # of the low-pass of u
    caught: bool  # whether the stream was caught up with


@compiled
def set_path(path: Path, speed: float, acceleration: float, jerk: float, period: float) -> None:
    """Write V, A, J and T of a path."""
    path.speed, path.largest, path.jerk, path.period = speed, acceleration, jerk, period
    path.gain = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * period)


def new_path(speed: float, acceleration: float, jerk: float, sample_period: float) -> NDArray[np.void]:
    """One `Path` that has not begun, with V, A, J and T, all positive."""
    require("sample_period", sample_period, above=0.0)
    paths = Path.new()
    interpreted(set_path)(paths[0], speed, acceleration, jerk, sample_period)
    return paths


NOTHING: Vector = (0.0, 0.0, 0.0)


@compiled
def _know(vector: Vector, otherwise: Vector) -> Vector:
    """Replace a vector that has no number, or one beyond `FARTHEST`."""
    x, y, z = vector
    return vector if abs(x) <= FARTHEST and abs(y) <= FARTHEST and abs(z) <= FARTHEST else otherwise


@compiled
def _clip(vector: Vector, longest: float) -> Vector:
    """Limit a vector to this length."""
    length = norm(vector)
    return scaled(vector, longest / length) if length > longest else vector


@compiled
def _slow_down(velocity: Vector, bounds: Bounds) -> Vector:
    """Limit a velocity to the bounds."""
    for bound in bounds:
        direction = bound[:3]
        beyond = dot(velocity, direction) - bound[3]
        if beyond > 0.0:
            velocity = subtract(velocity, scaled(direction, beyond))
    return velocity


@compiled
def _is_within(path: Path, velocity: Vector, last_velocity: Vector, last_acceleration: Vector, bounds: Bounds) -> bool:
    """Whether a step at this velocity keeps all limits, and the next ones can."""
    period, speed, jerk = path.period, path.speed, path.jerk
    acceleration = scaled(subtract(velocity, last_velocity), 1.0 / period)
    size = norm(acceleration)
    # While the acceleration returns to 0 at the largest jerk, the velocity grows by this amount.
    coming = max(size / (2.0 * jerk) - 0.5 * period, 0.0)
    if not (norm(velocity) <= speed and norm(add(velocity, scaled(acceleration, coming))) <= speed):
        return False
    for bound in bounds:
        if not dot(velocity, bound[:3]) <= bound[3]:
            return False
    change = norm(subtract(acceleration, last_acceleration))
    return bool(size <= path.largest and change <= jerk * period)


@compiled
def _brake(path: Path, velocity: Vector, last_velocity: Vector, lag: Vector, bounds: Bounds) -> Vector:
    """Brake so as to go no further or faster than commanded in a dangerous direction, if the path can stop."""
    period = path.period
    hardest = EMERGENCY * path.largest * period
    braked = velocity
    for bound in bounds:
        direction = bound[:3]
        most = min(max(dot(lag, direction) / period, 0.0), bound[3])
        fast = dot(braked, direction)
        if fast > most:
            slower = min(fast, max(most, dot(last_velocity, direction) - hardest))
            braked = subtract(braked, scaled(direction, fast - slower))
    return add(last_velocity, _clip(subtract(braked, last_velocity), hardest))


@compiled
def _catch_up(
    path: Path, lag: Vector, stream: Vector, last_velocity: Vector, last_acceleration: Vector, bounds: Bounds
) -> Vector:
    """The velocity with which a path that is not with the stream comes to it."""
    period, largest, jerk = path.period, path.largest, path.jerk
    rate, far = min(RATE, jerk / (4.0 * largest)), norm(lag)
    towards = stream
    if far > 0.0:
        closing = min(0.5 * rate * far, math.sqrt(2.0 * BRAKING * largest * far))
        towards = add(stream, scaled(lag, closing / far))
    towards = _slow_down(_clip(towards, path.speed), bounds)
    acceleration = _clip(scaled(subtract(towards, last_velocity), 2.0 * rate), largest)
    change = _clip(subtract(acceleration, last_acceleration), jerk * period)
    acceleration = _clip(add(last_acceleration, change), largest)
    velocity = _clip(add(last_velocity, scaled(acceleration, period)), path.speed)
    return _brake(path, velocity, last_velocity, lag, bounds)


@compiled
def begin(path: Path, x: float, y: float, z: float) -> None:
    """Begin where the robot is, at rest [m]."""
    write(path.position, (x, y, z))
    write(path.before, (x, y, z))
    for still in (path.velocity, path.acceleration, path.stream):
        write(still, NOTHING)
    path.caught = True


@compiled
def _known(bound: Bound) -> Bound:
    """A bound without numbers is none, and a speed that is no number is 0."""
    x, y, z = _know(bound[:3], NOTHING)
    return x, y, z, bound[3] if bound[3] >= 0.0 else 0.0


@compiled
def go_on(path: Path, wanted: Vector, shifted: Vector, bounds: Bounds) -> None:
    """One tick; the path is written, once it has begun.

    Args:
        path: Written.
        wanted: Newest place of the stream [m]; one with no number, or beyond 1 km, means to stay.
        shifted: Displacement of the stream by a limit since the last tick [m], which is no motion of it; NaN, or more
            than 1 km, is 0.
        bounds: Where they are at odds, the last comes first.
    """
    if math.isnan(path.position[0]):
        return
    period, largest = path.period, path.largest
    last_velocity, last_acceleration = vector(path.velocity), vector(path.acceleration)
    stream, stayed = vector(path.stream), add(vector(path.before), _know(shifted, NOTHING))
    wanted = _know(wanted, stayed)
    bounds = _known(bounds[0]), _known(bounds[1]), _known(bounds[2])
    lag = subtract(wanted, vector(path.position))
    going = _clip(scaled(subtract(wanted, stayed), 1.0 / period), path.speed)  # a jump is no speed to follow
    stream = add(stream, scaled(subtract(going, stream), path.gain))
    velocity = scaled(lag, 1.0 / period)
    near = path.caught or norm(subtract(velocity, stream)) <= LOCKING * largest * period
    path.caught = near and _is_within(path, velocity, last_velocity, last_acceleration, bounds)
    if not path.caught:
        velocity = _catch_up(path, lag, stream, last_velocity, last_acceleration, bounds)
    write(path.before, wanted)
    write(path.stream, stream)
    write(path.velocity, velocity)
    write(path.acceleration, scaled(subtract(velocity, last_velocity), 1.0 / period))
    write(path.position, add(vector(path.position), scaled(velocity, period)))


@compiled
def limited(path: Path, wanted: float, upwards: float, shifted: float) -> float:
    """One tick on a line: the next position [m].

    Where positions grow the path is no faster than `upwards` [m/s]; if it is, it brakes.
    """
    go_on(path, (wanted, 0.0, 0.0), (shifted, 0.0, 0.0), ((1.0, 0.0, 0.0, upwards), UNBOUNDED, UNBOUNDED))
    return float(path.position[0])
