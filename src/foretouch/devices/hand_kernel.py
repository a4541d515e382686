"""The motion of a hand and a device between two ticks, compiled.

While the intention moves in a straight line, the rendered force is held and the friction keeps its sign, the equation
of `foretouch.devices.Hand` is linear with constant coefficients, and its solution is a power series in time. Its
coefficients follow from each other, for any mass, damping and stiffness (none included), without cases for light and
heavy damping; in steps that are short against every time constant a few of them give all digits.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

Array = NDArray[np.float64]

POSITION, VELOCITY = 0, 1
"""Places in the state [m, m/s]."""

MASS, BOTH, DAMPING, STIFFNESS, FRICTION = range(5)
"""Places in the constants: mass of hand and device [kg], damping of both, damping of the hand alone [N s/m], stiffness
of the hand [N/m], Coulomb friction [N]."""

TERMS = 14
"""Number of terms of the series; a step is so short that each is less than half as large as the one before it."""

LONGEST = 1e-3
"""Bound on a step [s]."""

EVENTS = 8
"""Largest number of starts and stops in one step; after these the hand rests until the next one."""

HALVINGS = 60
"""Halvings that find the time of zero velocity: to the last digit."""


@compiled
def _terms(position: float, velocity: float, push: float, slope: float, constants: Array, terms: Array) -> None:
    """Coefficients of the position over time.

    Args:
        position: Relative to where the intention is now [m].
        velocity: [m/s].
        push: All of the force that does not depend on position and velocity, now [N].
        slope: Slope of that force over time [N/s].
        constants: `MASS` to `FRICTION`.
        terms: [m/s^n], shape (TERMS,), written.
    """
    terms[0], terms[1] = position, velocity
    for n in range(TERMS - 2):
        force = -constants[BOTH] * (n + 1) * terms[n + 1] - constants[STIFFNESS] * terms[n]
        if n == 0:
            force += push
        elif n == 1:
            force += slope
        terms[n + 2] = force / (constants[MASS] * (n + 1) * (n + 2))


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
def _stops_at(terms: Array, way: float, time: float) -> float:
    """Time at which the velocity becomes zero [s], at most `time`; it has the sign of `way` before, not at `time`."""
    early, late = 0.0, time
    for _ in range(HALVINGS):
        middle = 0.5 * (early + late)
        if way * _velocity_at(terms, middle) > 0.0:
            early = middle
        else:
            late = middle
    return late


@compiled
def _short_step(state: Array, constants: Array, aim: float, aim_speed: float, force: float, period: float) -> None:
    """One short step, with every start and stop that friction makes in it."""
    terms = np.empty(TERMS)
    stiffness, friction = constants[STIFFNESS], constants[FRICTION]
    push = constants[DAMPING] * aim_speed - force
    time = 0.0
    for _ in range(EVENTS):
        left, here = period - time, aim + aim_speed * time
        velocity = state[VELOCITY]
        way = 0.0
        if friction > 0.0:
            way = math.copysign(1.0, velocity)
            if velocity == 0.0:
                pull = push + stiffness * (here - state[POSITION])
                growth = stiffness * aim_speed
                if abs(pull) <= friction:
                    if growth == 0.0 or abs(pull + growth * left) <= friction:
                        return
                    way = math.copysign(1.0, growth)
                    wait = max((way * friction - pull) / growth, 0.0)
                    time += wait
                    left, here = left - wait, here + aim_speed * wait
                else:
                    way = math.copysign(1.0, pull)
        _terms(state[POSITION] - here, velocity, push - way * friction, stiffness * aim_speed, constants, terms)
        done = left
        stopping = way != 0.0 and way * _velocity_at(terms, left) < 0.0
        if stopping:
            done = _stops_at(terms, way, left)
        state[POSITION] = here + _position_at(terms, done)
        state[VELOCITY] = 0.0 if stopping else _velocity_at(terms, done)
        time += done
        if not stopping:
            return
    state[VELOCITY] = 0.0


@compiled
def move(state: Array, constants: Array, aim: float, aim_speed: float, force: float, period: float) -> None:
    """Move hand and device on by a time.

    Args:
        state: `POSITION` and `VELOCITY`, shape (2,), written.
        constants: `MASS` to `FRICTION`, shape (5,).
        aim: Position of the intention at the beginning [m].
        aim_speed: Speed of the intention [m/s].
        force: Rendered force [N], held; it pushes the hand out of the material, to smaller positions.
        period: The time [s], positive.
    """
    shortest = math.sqrt(constants[STIFFNESS] / constants[MASS])
    shortest = max(shortest, constants[BOTH] / constants[MASS])
    steps = math.ceil(period * max(2.0 * shortest, 1.0 / LONGEST) - 1e-6)
    step = period / max(steps, 1)
    for n in range(max(steps, 1)):
        _short_step(state, constants, aim + aim_speed * n * step, aim_speed, force, step)
