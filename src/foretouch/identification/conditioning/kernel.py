"""One raw sample conditioned, and the sums of the sensor's lag, compiled.

The method and its reasons are in `foretouch.identification.Conditioner` and `foretouch.identification.SensorLag`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined
from foretouch.identification.conditioning import layout as at
from foretouch.identification.conditioning.layout import COLUMNS, rings_are_full
from foretouch.models.predictor import VELOCITY_CUTOFF

Array = NDArray[np.float64]

MEMORY = 5.0
"""Time in moving contact over which samples are remembered [s]."""

SLOWEST = 2e-3
"""Least speed [m/s] at which the lag can be estimated."""

TIME, WEIGHT = 0, 1  # in moving contact, and the same fading [s]
ORIGIN = 2  # of position and force, so that what is squared stays small; NaN before the first sample
MEANS = 4  # of position, velocity, force
PRODUCTS = 7  # centred: xx, xv, vv, xF, vF, FF
SIZE = 13


@compiled
def clear(state: Array) -> None:
    """Forget all samples."""
    state[:] = 0.0
    state[ORIGIN : ORIGIN + 2] = math.nan


@compiled(error_model="numpy")
def take_lagged(state: Array, position: float, velocity: float, force: float, period: float) -> None:
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


OFFSET_WINDOW = 0.05
"""Length [s] of the window whose lowest mean so far is taken for the force in free air."""

CONTACT_FLOOR = 0.05
"""Least force [N] that counts as contact where nothing better is known of the sensor."""

SMALLEST_SPREAD = 0.005
"""Windows with less spread than this [N] are quiet, however quiet the quietest was."""

QUIET_FACTOR = 4.0
"""A window shows the force in free air only if its spread is at most this many times that of the quietest so far: when
the tool is jerked, the sensor may show less than nothing for a moment."""

NOISE_FACTOR = 6.0
"""Threshold of contact above the free-air force, in standard deviations of that force."""

QUIET_SPREAD = 1.5
"""Largest ratio of the noise to the spread of the quietest window so far: what chatters in free air is not the sensor's
noise."""

PEAK_TIME = 0.005
"""Length of a block [s]; the largest force is the lowest in two of them."""

PEAK_SHARE = 0.05
"""Least threshold of contact above free air, as a fraction of the largest force so far: friction of the mechanism grows
with what presses it, and is no contact."""

RELEASE_SHARE = 0.5
"""Threshold of leaving contact, as a fraction of the threshold at which it began."""

UNCERTAINTY_FACTOR = 2.0
"""Ratio of the threshold at which the surface was detected to that of now, from which on it is looked for again."""

VELOCITY_RATE = 2.0 * math.pi * VELOCITY_CUTOFF

is_full = inlined(rings_are_full)


@compiled(error_model="numpy")
def lose_surface(state: Array) -> None:
    """Look for the surface again, unless it was given."""
    if state[at.SURFACE_GIVEN] == 0.0:
        state[at.SURFACE] = math.nan
    state[at.PEAK] = 0.0


@inlined
def move(state: Array, time: float, position: float) -> float:
    """Velocity from positions, as `foretouch.models.MotionFilter` computes it [m/s]."""
    period = time - state[at.MOTION_TIME]
    if not period > 0.0:
        if math.isnan(state[at.MOTION_TIME]):
            state[at.MOTION_TIME], state[at.MOTION_PLACE] = time, position
        return float(state[at.VELOCITY])
    before = state[at.VELOCITY]
    slope = (position - state[at.MOTION_PLACE]) / period
    velocity = before + (1.0 - math.exp(-VELOCITY_RATE * period)) * (slope - before)
    state[at.VELOCITY], state[at.MOTION_TIME], state[at.MOTION_PLACE] = velocity, time, position
    return float(velocity)


@compiled(error_model="numpy")
def delay(state: Array, time: float, position: float, velocity: float) -> tuple[float, float]:
    """Position and velocity one lag ago, between the samples around that time; the first ones until there are such."""
    capacity = (state.size - at.RINGS) // COLUMNS
    times = at.RINGS + 2 * capacity
    places, speeds = times + capacity, times + 2 * capacity
    first, count, wanted = int(state[at.LATE_FIRST]), int(state[at.LATE_COUNT]), time - state[at.LAG]
    index = (first + count) % capacity
    state[times + index], state[places + index], state[speeds + index] = time, position, velocity
    count += 1
    while count > 2 and state[times + (first + 1) % capacity] <= wanted:
        first = (first + 1) % capacity
        count -= 1
    state[at.LATE_FIRST], state[at.LATE_COUNT] = first, count
    second = (first + 1) % capacity if count > 1 else first
    span = state[times + second] - state[times + first]
    share = (wanted - state[times + first]) / span if span > 0.0 else 0.0
    share = 0.0 if share < 0.0 else (1.0 if share > 1.0 else share)
    place, speed = state[places + first], state[speeds + first]
    return place + share * (state[places + second] - place), speed + share * (state[speeds + second] - speed)


@inlined
def learn_offset(state: Array, time: float, force: float) -> None:
    """Keep mean and spread of the last 50 ms, and those of the quietest 50 ms so far."""
    if math.isnan(state[at.REFERENCE]):
        state[at.REFERENCE] = force
    capacity = (state.size - at.RINGS) // COLUMNS
    forces = at.RINGS + capacity
    shifted = force - state[at.REFERENCE]
    first, count = int(state[at.WINDOW_FIRST]), int(state[at.WINDOW_COUNT])
    index = first + count
    index = index - capacity if index >= capacity else index
    state[at.RINGS + index], state[forces + index] = time, shifted
    count += 1
    total, squares = state[at.SUM] + shifted, state[at.SQUARES] + shifted * shifted
    full = False
    while time - state[at.RINGS + first] >= OFFSET_WINDOW:
        full = True
        old = state[forces + first]
        total -= old
        squares -= old * old
        first = first + 1 if first + 1 < capacity else 0
        count -= 1
    state[at.WINDOW_FIRST], state[at.WINDOW_COUNT] = first, count
    state[at.SUM], state[at.SQUARES] = total, squares
    mean = total / count
    variance = squares / count - mean * mean
    spread = math.sqrt(variance) if variance > 0.0 else 0.0
    if full:
        if spread < state[at.QUIETEST]:
            state[at.QUIETEST] = spread
        limit = QUIET_FACTOR * state[at.QUIETEST]
        if mean >= state[at.LOWEST_MEAN] or spread > (limit if limit > SMALLEST_SPREAD else SMALLEST_SPREAD):
            return
        state[at.LOWEST_MEAN] = mean
    elif state[at.LOWEST_MEAN] < math.inf:
        return
    state[at.NOISE] = spread
    if state[at.OFFSET_GIVEN] == 0.0:
        state[at.OFFSET] = mean + state[at.REFERENCE]


@inlined
def learn_peak(state: Array, time: float, force: float) -> None:
    """The largest force that lasted: the lowest in two blocks of time, so that a spike of the sensor does not count."""
    lowest, before = state[at.BLOCK_LOWEST], state[at.BLOCK_BEFORE]
    if time - state[at.BLOCK_TIME] < PEAK_TIME:
        if force < lowest:
            state[at.BLOCK_LOWEST] = force
        return
    state[at.BLOCK_TIME], state[at.BLOCK_LOWEST], state[at.BLOCK_BEFORE] = time, force, lowest
    lasted = before if before < lowest else lowest
    if before < math.inf and lasted > state[at.PEAK]:
        state[at.PEAK] = lasted


@inlined
def threshold_of(state: Array) -> float:
    """Threshold of contact [N]."""
    noise, largest = state[at.NOISE], QUIET_SPREAD * state[at.QUIETEST]
    noise = NOISE_FACTOR * (largest if largest < noise else noise)
    found, share = state[at.FLOOR], PEAK_SHARE * state[at.PEAK]
    found = noise if noise > found else found
    return float(share if share > found else found)


@compiled(error_model="numpy")
def learn_surface(state: Array, position: float, threshold: float) -> None:
    """Take the surface and its uncertainty from the beginning of a contact.

    The uncertainty is the distance over which contact became certain, and where it was last. Where a surface is known
    and certain, the one further out is right.
    """
    place = state[at.FREE_PLACE]
    if math.isnan(state[at.SURFACE]) or threshold > UNCERTAINTY_FACTOR * state[at.SURFACE_THRESHOLD]:
        state[at.SURFACE] = place
        state[at.SURFACE_THRESHOLD] = threshold
    elif place < state[at.SURFACE]:
        state[at.SURFACE] = place
    width = abs(position - place) / math.sqrt(12.0)
    apart = 0.0 if math.isnan(state[at.LAST_ONSET]) else abs(place - state[at.LAST_ONSET]) / math.sqrt(2.0)
    state[at.LAST_ONSET] = place
    newest, error = width * width + apart * apart, state[at.SURFACE_ERROR]
    state[at.SURFACE_ERROR] = math.sqrt(newest if math.isnan(error) else 0.5 * (error * error + newest))


@inlined
def condition(
    state: Array, time: float, position: float, force: float, velocity: float, measured: bool
) -> tuple[float, float, float, bool]:
    """One sample, in place; both rings have room for it (`is_full`).

    Args:
        state: Shape (RINGS + 5 n,).
        time: Time of the sample [s].
        position: Measured position [m].
        force: Measured force with the offset [N].
        velocity: Velocity [m/s].
        measured: Whether the velocity was measured; else it is estimated from the positions.

    Returns:
        Depth [m], velocity [m/s], force less the offset [N], and whether there is contact.
    """
    if not (math.isfinite(time) and math.isfinite(position) and math.isfinite(force)):
        return math.nan, 0.0, 0.0, False
    if not measured:
        velocity = move(state, time, position)
    if state[at.LAG] > 0.0:
        position, velocity = delay(state, time, position, velocity)
    learn_offset(state, time, force)
    force -= state[at.OFFSET]
    learn_peak(state, time, force)
    threshold = threshold_of(state)
    given = state[at.SURFACE_GIVEN] != 0.0
    touching = state[at.IN_CONTACT] != 0.0
    if touching:
        touching = force > RELEASE_SHARE * threshold
    else:
        if force <= RELEASE_SHARE * threshold or math.isnan(state[at.FREE_PLACE]):
            state[at.FREE_PLACE] = position
        if force > threshold:
            touching = True
            if not given:
                learn_surface(state, position, threshold)
    state[at.IN_CONTACT] = 1.0 if touching else 0.0
    if touching and not given and position < state[at.SURFACE]:
        state[at.SURFACE] = position
    return position - state[at.SURFACE], velocity, force, touching


Taken = tuple[float, float, float, bool, float, float, float, bool]


@compiled(error_model="numpy")
def take(state: Array, time: float, position: float, force: float, velocity: float, measured: bool) -> Taken:
    """`condition` for a loop in Python.

    Returns:
        What `condition` returns; then the surface [m], its error [m], the force offset [N], and whether the rings must
        `grow` before the next sample.
    """
    depth, velocity, force, touching = condition(state, time, position, force, velocity, measured)
    surface, error, offset = float(state[at.SURFACE]), float(state[at.SURFACE_ERROR]), float(state[at.OFFSET])
    return depth, velocity, force, touching, surface, error, offset, is_full(state)
