"""One raw sample conditioned, and the sums of the sensor's lag, compiled.

What they do and why is told by `foretouch.identification.Conditioner` and `foretouch.identification.SensorLag`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.conditioning.layout import (
    BLOCK_BEFORE,
    BLOCK_LOWEST,
    BLOCK_TIME,
    COLUMNS,
    FLOOR,
    FREE_PLACE,
    IN_CONTACT,
    LAG,
    LAST_ONSET,
    LATE_COUNT,
    LATE_FIRST,
    LOWEST_MEAN,
    MOTION_PLACE,
    MOTION_TIME,
    NOISE,
    OFFSET,
    OFFSET_GIVEN,
    PEAK,
    QUIETEST,
    REFERENCE,
    RINGS,
    SQUARES,
    SUM,
    SURFACE,
    SURFACE_ERROR,
    SURFACE_GIVEN,
    SURFACE_THRESHOLD,
    VELOCITY,
    WINDOW_COUNT,
    WINDOW_FIRST,
    rings_are_full,
)
from foretouch.models.predictor import VELOCITY_CUTOFF

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


_compiled = compiled(error_model="numpy")
_inlined = compiled(error_model="numpy", forceinline=True)

OFFSET_WINDOW = 0.05
"""Length [s] of the window whose lowest mean so far is taken for the force in free air."""

CONTACT_FLOOR = 0.05
"""Least force [N] that counts as contact where nothing better is known of the sensor."""

SMALLEST_SPREAD = 0.005
"""Windows with less spread than this [N] are quiet, however quiet the quietest was."""

QUIET_FACTOR = 4.0
"""A window tells the force in free air only if its spread is at most this many times that of the quietest so far:
when the tool is jerked, the sensor may show less than nothing for a moment."""

NOISE_FACTOR = 6.0
"""Contact begins this many standard deviations of the free-air force above it."""

QUIET_SPREAD = 1.5
"""The noise is at most this many times the spread of the quietest window so far: what chatters in free air is not the
sensor's noise."""

PEAK_TIME = 0.005
"""The largest force is the lowest in two blocks of this length [s]."""

PEAK_SHARE = 0.05
"""Contact begins at least this share of the largest force so far above free air: friction of the mechanism grows
with what presses it, and is no contact."""

RELEASE_SHARE = 0.5
"""Contact ends at this share of the threshold where it began."""

DOUBT_FACTOR = 2.0
"""A surface that was found at a threshold this many times smaller than today's is looked for again."""

VELOCITY_RATE = 2.0 * math.pi * VELOCITY_CUTOFF

is_full: Callable[[Array], bool] = _inlined(rings_are_full)


def _lose_surface(state: Array) -> None:
    """Look for the surface again, unless it was given."""
    if state[SURFACE_GIVEN] == 0.0:
        state[SURFACE] = math.nan
    state[PEAK] = 0.0


lose_surface: Callable[[Array], None] = _compiled(_lose_surface)


def _move(state: Array, time: float, position: float) -> float:
    """Velocity from positions, as `foretouch.models.MotionFilter` has it [m/s]."""
    period = time - state[MOTION_TIME]
    if not period > 0.0:
        if math.isnan(state[MOTION_TIME]):
            state[MOTION_TIME], state[MOTION_PLACE] = time, position
        return float(state[VELOCITY])
    before = state[VELOCITY]
    slope = (position - state[MOTION_PLACE]) / period
    velocity = before + (1.0 - math.exp(-VELOCITY_RATE * period)) * (slope - before)
    state[VELOCITY], state[MOTION_TIME], state[MOTION_PLACE] = velocity, time, position
    return float(velocity)


move: Callable[[Array, float, float], float] = _inlined(_move)


def _delay(state: Array, time: float, position: float, velocity: float) -> tuple[float, float]:
    """Position and velocity of one lag ago, between the samples around it; the first ones until there are such."""
    capacity = (state.size - RINGS) // COLUMNS
    times = RINGS + 2 * capacity
    places, speeds = times + capacity, times + 2 * capacity
    first, count, wanted = int(state[LATE_FIRST]), int(state[LATE_COUNT]), time - state[LAG]
    at = (first + count) % capacity
    state[times + at], state[places + at], state[speeds + at] = time, position, velocity
    count += 1
    while count > 2 and state[times + (first + 1) % capacity] <= wanted:
        first = (first + 1) % capacity
        count -= 1
    state[LATE_FIRST], state[LATE_COUNT] = first, count
    second = (first + 1) % capacity if count > 1 else first
    span = state[times + second] - state[times + first]
    share = (wanted - state[times + first]) / span if span > 0.0 else 0.0
    share = 0.0 if share < 0.0 else (1.0 if share > 1.0 else share)
    place, speed = state[places + first], state[speeds + first]
    return place + share * (state[places + second] - place), speed + share * (state[speeds + second] - speed)


delay: Callable[[Array, float, float, float], tuple[float, float]] = _compiled(_delay)


def _learn_offset(state: Array, time: float, force: float) -> None:
    """Keep mean and spread of the last 50 ms, and those of the quietest 50 ms so far."""
    if math.isnan(state[REFERENCE]):
        state[REFERENCE] = force
    capacity = (state.size - RINGS) // COLUMNS
    forces = RINGS + capacity
    shifted = force - state[REFERENCE]
    first, count = int(state[WINDOW_FIRST]), int(state[WINDOW_COUNT])
    at = first + count
    at = at - capacity if at >= capacity else at
    state[RINGS + at], state[forces + at] = time, shifted
    count += 1
    total, squares = state[SUM] + shifted, state[SQUARES] + shifted * shifted
    full = False
    while time - state[RINGS + first] >= OFFSET_WINDOW:
        full = True
        old = state[forces + first]
        total -= old
        squares -= old * old
        first = first + 1 if first + 1 < capacity else 0
        count -= 1
    state[WINDOW_FIRST], state[WINDOW_COUNT] = first, count
    state[SUM], state[SQUARES] = total, squares
    mean = total / count
    variance = squares / count - mean * mean
    spread = math.sqrt(variance) if variance > 0.0 else 0.0
    if full:
        if spread < state[QUIETEST]:
            state[QUIETEST] = spread
        limit = QUIET_FACTOR * state[QUIETEST]
        if mean >= state[LOWEST_MEAN] or spread > (limit if limit > SMALLEST_SPREAD else SMALLEST_SPREAD):
            return
        state[LOWEST_MEAN] = mean
    elif state[LOWEST_MEAN] < math.inf:
        return
    state[NOISE] = spread
    if state[OFFSET_GIVEN] == 0.0:
        state[OFFSET] = mean + state[REFERENCE]


learn_offset: Callable[[Array, float, float], None] = _inlined(_learn_offset)


def _learn_peak(state: Array, time: float, force: float) -> None:
    """The largest force that lasted: the lowest in two blocks of time, so that a spike of the sensor is none."""
    lowest, before = state[BLOCK_LOWEST], state[BLOCK_BEFORE]
    if time - state[BLOCK_TIME] < PEAK_TIME:
        if force < lowest:
            state[BLOCK_LOWEST] = force
        return
    state[BLOCK_TIME], state[BLOCK_LOWEST], state[BLOCK_BEFORE] = time, force, lowest
    lasted = before if before < lowest else lowest
    if before < math.inf and lasted > state[PEAK]:
        state[PEAK] = lasted


learn_peak: Callable[[Array, float, float], None] = _inlined(_learn_peak)


def _threshold(state: Array) -> float:
    """Where contact begins [N]."""
    noise, largest = state[NOISE], QUIET_SPREAD * state[QUIETEST]
    noise = NOISE_FACTOR * (largest if largest < noise else noise)
    found, share = state[FLOOR], PEAK_SHARE * state[PEAK]
    found = noise if noise > found else found
    return float(share if share > found else found)


threshold_of: Callable[[Array], float] = _inlined(_threshold)


def _learn_surface(state: Array, position: float, threshold: float) -> None:
    """Take the surface from a contact that begins, and its doubt: how far on contact was sure, and where it was last.

    Where a surface is known and not in doubt, the one further out is right.
    """
    place = state[FREE_PLACE]
    if math.isnan(state[SURFACE]) or threshold > DOUBT_FACTOR * state[SURFACE_THRESHOLD]:
        state[SURFACE] = place
        state[SURFACE_THRESHOLD] = threshold
    elif place < state[SURFACE]:
        state[SURFACE] = place
    width = abs(position - place) / math.sqrt(12.0)
    apart = 0.0 if math.isnan(state[LAST_ONSET]) else abs(place - state[LAST_ONSET]) / math.sqrt(2.0)
    state[LAST_ONSET] = place
    newest, error = width * width + apart * apart, state[SURFACE_ERROR]
    state[SURFACE_ERROR] = math.sqrt(newest if math.isnan(error) else 0.5 * (error * error + newest))


learn_surface: Callable[[Array, float, float], None] = _compiled(_learn_surface)


def _condition(
    state: Array, time: float, position: float, force: float, velocity: float, measured: bool
) -> tuple[float, float, float, bool]:
    """One sample, in place; both rings have room for it (`is_full`).

    Args:
        state: Shape (RINGS + 5 n,).
        time: [s].
        position: [m].
        force: With the offset [N].
        velocity: [m/s].
        measured: Whether that was measured; else it is found from the positions.

    Returns:
        Depth [m], velocity [m/s], force less the offset [N], and whether there is contact.
    """
    if not (math.isfinite(time) and math.isfinite(position) and math.isfinite(force)):
        return math.nan, 0.0, 0.0, False
    if not measured:
        velocity = move(state, time, position)
    if state[LAG] > 0.0:
        position, velocity = delay(state, time, position, velocity)
    learn_offset(state, time, force)
    force -= state[OFFSET]
    learn_peak(state, time, force)
    threshold = threshold_of(state)
    given = state[SURFACE_GIVEN] != 0.0
    touching = state[IN_CONTACT] != 0.0
    if touching:
        touching = force > RELEASE_SHARE * threshold
    else:
        if force <= RELEASE_SHARE * threshold or math.isnan(state[FREE_PLACE]):
            state[FREE_PLACE] = position
        if force > threshold:
            touching = True
            if not given:
                learn_surface(state, position, threshold)
    state[IN_CONTACT] = 1.0 if touching else 0.0
    if touching and not given and position < state[SURFACE]:
        state[SURFACE] = position
    return position - state[SURFACE], velocity, force, touching


condition: Callable[[Array, float, float, float, float, bool], tuple[float, float, float, bool]] = _inlined(_condition)

Taken = tuple[float, float, float, bool, float, float, float, bool]


def _take(state: Array, time: float, position: float, force: float, velocity: float, measured: bool) -> Taken:
    """`condition` for a loop in Python.

    Returns:
        What `condition` returns; then the surface [m], its error [m], the force offset [N], and whether the rings must
        `grow` before the next sample.
    """
    depth, velocity, force, touching = condition(state, time, position, force, velocity, measured)
    surface, error, offset = float(state[SURFACE]), float(state[SURFACE_ERROR]), float(state[OFFSET])
    return depth, velocity, force, touching, surface, error, offset, is_full(state)


take: Callable[[Array, float, float, float, float, bool], Taken] = _compiled(_take)
