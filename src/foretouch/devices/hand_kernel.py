"""The motion of a hand and a device between two ticks, compiled.

While the intention moves in a straight line, the rendered force is held and the friction keeps its sign, the equation
of `foretouch.devices.Hand` is linear with constant coefficients, and its solution is a power series in time. Its
coefficients follow from each other, for any mass, damping and stiffness (none included), without cases for light and
heavy damping; in steps that are short against every time constant a few of them give all digits.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.core.compiling import scratch
from foretouch.quantities.pose import Vector, dot, rotation_of

Array = NDArray[np.float64]


class Held(Record):
    """A hand and the device that it holds."""

    position: float  # [m]
    velocity: float  # [m/s]
    mass: float  # of hand and device [kg]
    damping: float  # of both [N s/m]
    hand_damping: float  # of the hand alone [N s/m]
    stiffness: float  # of the hand [N/m]
    friction: float  # Coulomb friction of the device [N]


TERMS = 14
"""Number of terms of the series; a step is so short that each is less than half as large as the one before it."""

LONGEST = 1e-3  # Bound on a step [s]
EVENTS = 8  # Largest number of starts and stops in one step; after these the hand rests until the next one
HALVINGS = 60  # Halvings that find the time of zero velocity: to the last digit


@compiled
def _terms(held: Held, position: float, push: float, slope: float, terms: Array) -> None:
    """Write the coefficients of the position over time [m/s^n].

    Args:
        held: With its velocity now.
        position: Relative to where the intention is now [m].
        push: All of the force that does not depend on position and velocity, now [N].
        slope: Slope of that force over time [N/s].
        terms: Shape (TERMS,).
    """
    terms[0], terms[1] = position, held.velocity
    for n in range(TERMS - 2):
        force = -held.damping * (n + 1) * terms[n + 1] - held.stiffness * terms[n]
        if n == 0:
            force += push
        elif n == 1:
            force += slope
        terms[n + 2] = force / (held.mass * (n + 1) * (n + 2))


@compiled
def _position_at(terms: Array, time: float) -> float:
    """The series at a time [m]."""
    value = 0.0
    for n in range(TERMS - 1, -1, -1):
        value = value * time + terms[n]
    return value


@compiled
def _velocity_at(terms: Array, time: float) -> float:
    """Slope of the velocity at a time [m/s]."""
    value = 0.0
    for n in range(TERMS - 1, 0, -1):
        value = value * time + n * terms[n]
    return value


@compiled
def _stops_at(terms: Array, sign: float, time: float) -> float:
    """Time at which the velocity becomes zero [s], at most `time`; it has this sign before, not at `time`."""
    early, late = 0.0, time
    for _ in range(HALVINGS):
        middle = 0.5 * (early + late)
        if sign * _velocity_at(terms, middle) > 0.0:
            early = middle
        else:
            late = middle
    return late


@compiled
def _short_step(held: Held, aim: float, aim_speed: float, force: float, period: float) -> None:
    """One short step, with every start and stop that friction makes in it."""
    terms = scratch(np.float64, TERMS)
    stiffness, friction = held.stiffness, held.friction
    push = held.hand_damping * aim_speed - force
    time = 0.0
    for _ in range(EVENTS):
        left, here = period - time, aim + aim_speed * time
        sign = 0.0
        if friction > 0.0:
            sign = math.copysign(1.0, held.velocity)
            if held.velocity == 0.0:
                pull = push + stiffness * (here - held.position)
                growth = stiffness * aim_speed
                if abs(pull) <= friction:
                    if growth == 0.0 or abs(pull + growth * left) <= friction:
                        return
                    sign = math.copysign(1.0, growth)
                    wait = max((sign * friction - pull) / growth, 0.0)
                    time += wait
                    left, here = left - wait, here + aim_speed * wait
                else:
                    sign = math.copysign(1.0, pull)
        _terms(held, held.position - here, push - sign * friction, stiffness * aim_speed, terms)
        done = left
        stopping = sign != 0.0 and sign * _velocity_at(terms, left) < 0.0
        if stopping:
            done = _stops_at(terms, sign, left)
        held.position = here + _position_at(terms, done)
        held.velocity = 0.0 if stopping else _velocity_at(terms, done)
        time += done
        if not stopping:
            return
    held.velocity = 0.0


@kernel("void(Held[::1], f8, f8, f8, f8)")
def move(hands: NDArray[np.void], aim: float, aim_speed: float, force: float, period: float) -> None:
    """Move one hand and its device on by a time.

    Args:
        hands: One `Held`, written.
        aim: Position of the intention at the beginning [m].
        aim_speed: Speed of the intention [m/s].
        force: Rendered force [N], held; it pushes the hand out of the material, to smaller positions.
        period: The time [s], positive.
    """
    held = hands[0]
    fastest = max(math.sqrt(held.stiffness / held.mass), held.damping / held.mass)
    steps = max(math.ceil(period * max(2.0 * fastest, 1.0 / LONGEST) - 1e-6), 1)
    step = period / steps
    for n in range(steps):
        _short_step(held, aim + aim_speed * n * step, aim_speed, force, step)


class Seeing(Record):
    """Pose of a fixture, a place [m] and a rotation vector [rad], by which a hand goes that follows an eye."""

    shown: Annotated[Array, float, 6]
    aimed: Annotated[Array, float, 6]  # the newest that was seen


_dot, _rotation_of = compiled(dot), compiled(error_model="numpy")(rotation_of)


@kernel("UniTuple(f8, 3)(Seeing[::1], f8[:, ::1], f8, f8, f8)", allocates=True, error_model="numpy")
def look(seeings: NDArray[np.void], path: Array, at: float, elapsed: float, scale: float) -> Vector:
    """Place of a hand [m] on a fixture that it follows, at a row of a path in the fixture's frame [m], or between two.

    The time elapsed since the last look is in time constants.
    """
    shown, aimed, fraction = seeings[0].shown, seeings[0].aimed, -math.expm1(-elapsed)
    for i in range(6):
        shown[i] += fraction * (aimed[i] - shown[i])
    row = min(int(at), path.shape[0] - 2)
    point = path[row] + (at - row) * (path[row + 1] - path[row])
    first, second, third = _rotation_of(shown[3], shown[4], shown[5])
    x, y, z = _dot(first, point) + shown[0], _dot(second, point) + shown[1], _dot(third, point) + shown[2]
    return float(x / scale), float(y / scale), float(z / scale)
