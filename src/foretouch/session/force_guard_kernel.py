"""One tick of `foretouch.session.force_guard.ForceGuard`, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.session.force_guard import (
    AWAY,
    DAMPING,
    IMPACT_DEPTH,
    KEPT,
    PATIENCE,
    SHORTEST_DEPTH,
    SOFTEST,
    STEEPER,
    STEEPEST,
    STIFFNESS,
    STRIDE,
    STRUCK_FOR,
    STRUCK_FROM,
)

__all__ = ["SIZE", "allowed_speed", "forget", "observe"]

Array = NDArray[np.float64]

FORCE = 3
"""Place in the array, behind those of what `ForceGuard` tells, of the newest force [N]; NaN where nobody knows it."""

ONSET, REFERENCE, REFERENCE_FORCE = 4, 5, 6
"""Where this contact began [m], and where the newest tangent [m, N]; NaN for none."""

ENTRY_SPEED, TICKS = 7, 8
"""At which the contact began [m/s], and its ticks so far."""

SIZE = 9


def _forget(guard: Array) -> None:
    """Nothing has been touched, and nobody knows the force."""
    guard[:] = math.nan
    guard[STIFFNESS], guard[STEEPEST], guard[ENTRY_SPEED], guard[TICKS] = SOFTEST, 0.0, 0.0, 0.0


forget = compiled("void(f8[::1])")(_forget)


def _observe(guard: Array, position: float, force: float, in_contact: bool, speed: float) -> None:
    """See `ForceGuard.observe`; the array is written."""
    known = math.isfinite(position) and math.isfinite(force)
    guard[FORCE] = force if known else math.nan
    if not known:
        return
    if not in_contact:
        if position < guard[ONSET] - AWAY:
            guard[ONSET], guard[STIFFNESS] = math.nan, SOFTEST
        return
    if math.isnan(guard[ONSET]):
        guard[ONSET] = guard[REFERENCE] = position
        guard[REFERENCE_FORCE] = force
        guard[ENTRY_SPEED], guard[TICKS] = speed, 0.0
    guard[TICKS] += 1.0
    if guard[ENTRY_SPEED] >= STRUCK_FROM and guard[TICKS] <= STRUCK_FOR:
        known_damping = 0.0 if math.isnan(guard[DAMPING]) else guard[DAMPING]
        guard[DAMPING] = max(force / guard[ENTRY_SPEED], known_damping)
    way = position - guard[REFERENCE]
    if way >= STRIDE:  # the stiffness here, each time that it has gone so much deeper
        tangent = (force - guard[REFERENCE_FORCE]) / way
        guard[STIFFNESS] = max(KEPT * guard[STIFFNESS], STEEPER * tangent, SOFTEST)
    if way >= STRIDE or way < 0.0:
        guard[REFERENCE], guard[REFERENCE_FORCE] = position, force
    depth = position - guard[ONSET]
    guard[STIFFNESS] = max(guard[STIFFNESS], STEEPER * force / max(depth, SHORTEST_DEPTH))
    guard[STEEPEST] = max(guard[STEEPEST], force / max(depth, IMPACT_DEPTH))


observe = compiled("void(f8[::1], f8, f8, b1, f8)")(_observe)


def _allowed(guard: Array, limit: float, damping: float) -> float:
    """See `ForceGuard.speed`."""
    if math.isnan(guard[FORCE]):
        return 0.0
    missing = limit - guard[FORCE]
    return float(missing / (guard[STIFFNESS] * PATIENCE + (damping if missing > 0.0 else 0.0)))


allowed_speed = compiled("f8(f8[::1], f8, f8)")(_allowed)
