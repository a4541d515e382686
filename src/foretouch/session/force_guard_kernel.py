"""One tick of `foretouch.session.force_guard.ForceGuard`, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.session.force_guard import (
    AWAY,
    KEPT,
    ONSET,
    PATIENCE,
    SHORTEST_DEPTH,
    SOFTEST,
    STEEPER,
    STIFFNESS,
    STRIDE,
)

__all__ = ["SIZE", "allowed_speed", "forget", "observe"]

Array = NDArray[np.float64]

FORCE, REFERENCE, REFERENCE_FORCE = 2, 3, 4
"""Places in the array, behind those of what `ForceGuard` tells, of the newest force [N], NaN where nobody knows it; and
of where the newest tangent is taken from [m, N], NaN for none."""

SIZE = 5


@compiled("void(f8[::1])")
def forget(guard: Array) -> None:
    """Nothing has been touched, and nobody knows the force."""
    guard[:] = math.nan
    guard[STIFFNESS] = SOFTEST


@compiled("void(f8[::1], f8, f8, b1)")
def observe(guard: Array, position: float, force: float, in_contact: bool) -> None:
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
    way = position - guard[REFERENCE]
    if way >= STRIDE:  # the stiffness here, each time that it has gone so much deeper
        tangent = (force - guard[REFERENCE_FORCE]) / way
        guard[STIFFNESS] = max(KEPT * guard[STIFFNESS], STEEPER * tangent, SOFTEST)
    if way >= STRIDE or way < 0.0:
        guard[REFERENCE], guard[REFERENCE_FORCE] = position, force
    depth = position - guard[ONSET]
    guard[STIFFNESS] = max(guard[STIFFNESS], STEEPER * force / max(depth, SHORTEST_DEPTH))


@compiled("f8(f8[::1], f8, f8)")
def allowed_speed(guard: Array, limit: float, damping: float) -> float:
    """See `ForceGuard.speed`."""
    if math.isnan(guard[FORCE]):
        return 0.0
    missing = limit - guard[FORCE]
    return float(missing / (guard[STIFFNESS] * PATIENCE + (damping if missing > 0.0 else 0.0)))
