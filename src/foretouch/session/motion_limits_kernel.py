"""One tick of `foretouch.session.motion_limits.MotionLimits`, compiled.

Like the other kernels of the follower's step it keeps its numbers in one array, and has its types stated: a driver that
says a whole number where a fraction came before is no reason to compile anew in a loop.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.session.motion_limits import ACCELERATION, BRAKING, EMERGENCY, LOCKING, POSITION, RATE, VELOCITY

__all__ = ["BEFORE", "CAUGHT", "SIZE", "SPEED", "limited"]

Array = NDArray[np.float64]

BEFORE, STREAM, CAUGHT = 3, 4, 5
"""Places in the array, behind those of the path, of what is known of the stream: its newest position [m], its
low-passed speed u [m/s], and whether it was caught up with."""

SPEED, LARGEST, JERK, PERIOD, GAIN = 6, 7, 8, 9, 10
"""What stays: V [m/s], A [m/s^2], J [m/s^3], T [s], and the gain of the low-pass."""

SIZE = 11


def _clip(value: float, largest: float) -> float:
    return min(max(value, -largest), largest)


_clipped = compiled(_clip)


def _limit(path: Array, wanted: float, upwards: float, shifted: float) -> float:
    """One tick: the next position [m]. The arguments are those of `MotionLimits.update`; the array is written."""
    if math.isnan(path[POSITION]):
        path[BEFORE] = path[POSITION] = wanted
        return float(wanted)
    period, largest, speed, before, stream = path[PERIOD], path[LARGEST], path[SPEED], path[BEFORE], path[STREAM]
    last_velocity, last_acceleration = path[VELOCITY], path[ACCELERATION]
    if not math.isfinite(wanted):
        wanted = before + shifted
    lag = wanted - path[POSITION]
    stream += path[GAIN] * ((wanted - before - shifted) / period - stream)
    path[BEFORE], path[STREAM] = wanted, stream
    velocity = lag / period
    acceleration = (velocity - last_velocity) / period
    near = path[CAUGHT] != 0.0 or abs(velocity - stream) <= LOCKING * largest * period
    kept = (
        -speed <= velocity <= min(speed, upwards)
        and abs(acceleration) <= largest
        and abs(acceleration - last_acceleration) / period <= path[JERK]
    )
    path[CAUGHT] = 1.0 if near and kept else 0.0
    if not (near and kept):
        closing = min(0.5 * RATE * abs(lag), math.sqrt(2.0 * BRAKING * largest * abs(lag)))
        towards = min(_clipped(stream + math.copysign(closing, lag), speed), upwards)
        acceleration = _clipped(2.0 * RATE * (towards - last_velocity), largest)
        change = _clipped(acceleration - last_acceleration, path[JERK] * period)
        acceleration = _clipped(last_acceleration + change, largest)
        velocity = _clipped(last_velocity + acceleration * period, speed)
        most = min(max(lag / period, 0.0), upwards)
        if velocity > most:  # never deeper, nor deeper faster, than it is told, if it can stop
            velocity = min(velocity, max(most, last_velocity - EMERGENCY * largest * period))
        acceleration = (velocity - last_velocity) / period
    path[VELOCITY], path[ACCELERATION] = velocity, acceleration
    path[POSITION] += velocity * period
    return float(path[POSITION])


limited = compiled("f8(f8[::1], f8, f8, f8)")(_limit)
