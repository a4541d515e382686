"""Sums of the sensor's lag, compiled; what they tell is in `sensor_lag`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled

__all__ = ["MEANS", "ORIGIN", "PRODUCTS", "SIZE", "TIME", "WEIGHT", "clear", "take_lagged"]

Array = NDArray[np.float64]

MEMORY = 5.0
"""Time in moving contact over which samples are remembered [s]."""

SLOWEST = 2e-3
"""Slower than this [m/s] nothing tells a lag."""

TIME, WEIGHT = 0, 1  # in moving contact, and the same fading [s]
ORIGIN = 2  # of position and force, so that what is squared stays small; NaN before the first sample
MEANS = 4  # of position, velocity, force
PRODUCTS = 7  # centred: xx, xv, vv, xF, vF, FF
SIZE = 13


def _clear(state: Array) -> None:
    """Forget all samples."""
    state[:] = 0.0
    state[ORIGIN : ORIGIN + 2] = math.nan


clear = compiled(_clear)


def _take_lagged(state: Array, position: float, velocity: float, force: float, period: float) -> None:
    """`SensorLag.update` on its numbers, shape (SIZE,), in place."""
    if abs(velocity) < SLOWEST or not 0.0 < period < 1.0:
        return
    if math.isnan(state[ORIGIN]):
        state[ORIGIN], state[ORIGIN + 1] = position, force
    fading = math.exp(-period / MEMORY)
    state[TIME] += period
    state[WEIGHT] = state[WEIGHT] * fading + period
    share = period / state[WEIGHT]
    kept = 1.0 - share
    x = position - state[ORIGIN] - state[MEANS]
    v = velocity - state[MEANS + 1]
    f = force - state[ORIGIN + 1] - state[MEANS + 2]
    state[MEANS] += share * x
    state[MEANS + 1] += share * v
    state[MEANS + 2] += share * f
    state[PRODUCTS] = kept * (state[PRODUCTS] + share * (x * x))
    state[PRODUCTS + 1] = kept * (state[PRODUCTS + 1] + share * (x * v))
    state[PRODUCTS + 2] = kept * (state[PRODUCTS + 2] + share * (v * v))
    state[PRODUCTS + 3] = kept * (state[PRODUCTS + 3] + share * (x * f))
    state[PRODUCTS + 4] = kept * (state[PRODUCTS + 4] + share * (v * f))
    state[PRODUCTS + 5] = kept * (state[PRODUCTS + 5] + share * (f * f))


take_lagged = compiled(error_model="numpy")(_take_lagged)
