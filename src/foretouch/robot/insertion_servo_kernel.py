"""Compiled step of the insertion servo; the equations are in `insertion_servo`.

What it remembers is one array, by the places named here.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

__all__ = [
    "CLIPPED",
    "COMMAND",
    "NEWEST",
    "RAIL",
    "REFERENCE",
    "SERVO_SIZE",
    "VELOCITY",
    "drive",
    "take",
]

COMMAND, COMMAND_SLOPE, COMMAND_VELOCITY, COMMAND_VELOCITY_SLOPE, REFERENCE, VELOCITY, CLIPPED, NEWEST = range(8)

MASS, DAMPING, FORCE_LIMIT, PERIOD, VELOCITY_GAIN = range(8, 13)
RAIL = slice(MASS, VELOCITY_GAIN + 1)
"""What stays, as `InsertionServo` is given it."""

SERVO_SIZE = 13

REFERENCE_RATE = 400.0  # how fast the reference closes in on the command [rad/s]
LARGEST_VELOCITY = 0.5  # of the reference [m/s]
LARGEST_ACCELERATION = 30.0  # of the reference [m/s^2]; the joint could do 37 within 15 N
SERVO_RATE = 300.0  # bandwidth of the position loop [rad/s]
LARGEST_RETRACTION = 100.0  # drive force out of the material [N]


def _move_reference(state: NDArray[np.float64], h: float) -> float:
    """Move the reference and the command on by h seconds; gives the reference's acceleration [m/s^2]."""
    error = state[COMMAND] - state[REFERENCE]
    distance = abs(error)
    closing = min(0.5 * REFERENCE_RATE * distance, math.sqrt(1.4 * LARGEST_ACCELERATION * distance))
    wanted = state[COMMAND_VELOCITY] + math.copysign(closing, error)
    wanted = max(-LARGEST_VELOCITY, min(LARGEST_VELOCITY, wanted))
    acceleration = 2.0 * REFERENCE_RATE * (wanted - state[VELOCITY])
    acceleration = max(-LARGEST_ACCELERATION, min(LARGEST_ACCELERATION, acceleration))
    state[VELOCITY] += h * acceleration
    state[REFERENCE] += h * state[VELOCITY]
    state[COMMAND] += h * state[COMMAND_SLOPE]
    state[COMMAND_VELOCITY] += h * state[COMMAND_VELOCITY_SLOPE]
    return float(acceleration)


move_reference = compiled("f8(f8[::1], f8)")(_move_reference)


def _take(state: NDArray[np.float64], position: float) -> None:
    """See `InsertionServo.command`."""
    slope = (position - state[NEWEST]) / state[PERIOD]
    state[COMMAND] = state[NEWEST]
    state[COMMAND_SLOPE] = slope
    change = state[VELOCITY_GAIN] * (slope - state[COMMAND_VELOCITY])
    state[COMMAND_VELOCITY_SLOPE] = change / state[PERIOD]
    state[CLIPPED] = 0.0
    state[NEWEST] = position


take = compiled("void(f8[::1], f8)")(_take)


def _drive(state: NDArray[np.float64], position: float, velocity: float, contact_force: float, h: float) -> float:
    """Drive force for the next h seconds [N]: see `InsertionServo.effort`."""
    mass, ceiling = state[MASS], state[FORCE_LIMIT]
    stiffness, damping = SERVO_RATE * SERVO_RATE, 2.0 * SERVO_RATE
    restoring = stiffness * (state[REFERENCE] - position) + damping * (state[VELOCITY] - velocity)
    friction = state[DAMPING] * state[VELOCITY]
    effort = mass * (move_reference(state, h) + restoring) + friction + contact_force
    excess = contact_force - ceiling
    if excess > 0.0:  # what speed and the moving mass add: brake, and go back
        ceiling -= excess + damping * mass * max(velocity, 0.0)
    if effort > ceiling:
        effort = ceiling
        state[CLIPPED] = 1.0
        state[REFERENCE] = min(state[REFERENCE], position + max(0.0, -excess) / (mass * stiffness))
        state[VELOCITY] = min(state[VELOCITY], max(velocity, 0.0))
    return float(max(effort, -LARGEST_RETRACTION))


drive = compiled("f8(f8[::1], f8, f8, f8, f8)")(_drive)
