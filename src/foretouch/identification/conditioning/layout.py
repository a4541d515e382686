"""What a conditioner remembers from sample to sample, by its place in one flat array; and what a sensor can be.

First numbers; then the last 50 ms of force, and the samples that wait for a late sensor, both as rings of one length,
which the array's own length tells.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAG = 0  # of the force sensor [s]
FLOOR = 1  # least force that counts as contact [N]
SURFACE_GIVEN, OFFSET_GIVEN = 2, 3  # 1 where somebody has stated it
SURFACE = 4  # [m], NaN while unknown
SURFACE_ERROR = 5  # [m]
OFFSET = 6  # [N]
IN_CONTACT = 7  # 1 in contact
MOTION_TIME, MOTION_PLACE, VELOCITY = 8, 9, 10  # newest sample and velocity of the low-pass
LAST_ONSET = 11  # where the contact before began [m]
REFERENCE = 12  # force that is subtracted before squaring, so that the running sums stay small [N]
SUM, SQUARES = 13, 14  # over the window
LOWEST_MEAN = 15  # of a quiet window [N]
NOISE = 16  # spread of the window that gave the offset [N]
QUIETEST = 17  # least spread of a window [N]
PEAK = 18  # largest force that lasted [N]
BLOCK_TIME, BLOCK_LOWEST, BLOCK_BEFORE = 19, 20, 21  # begin and lowest force of a block, lowest of the one before
SURFACE_THRESHOLD = 22  # at which the surface was found [N]
FREE_PLACE = 23  # last position below the threshold of ending [m]
WINDOW_FIRST, WINDOW_COUNT = 24, 25  # of the ring of forces
LATE_FIRST, LATE_COUNT = 26, 27  # of the ring of samples that wait
RINGS = 28  # from here on: times and forces of the window; times, positions and velocities that wait

COLUMNS = 5
_FIRST_CAPACITY = 128


def make_state(surface: float | None, force_offset: float | None, contact_floor: float, sensor_lag: float) -> Array:
    """The array of a conditioner that has seen nothing: see `conditioning.Conditioner` for the arguments."""
    state = np.zeros(RINGS + COLUMNS * _FIRST_CAPACITY)
    state[LAG], state[FLOOR] = sensor_lag, contact_floor
    state[SURFACE_GIVEN], state[OFFSET_GIVEN] = surface is not None, force_offset is not None
    state[[SURFACE, SURFACE_ERROR]] = math.nan if surface is None else (surface, 0.0)
    state[OFFSET] = 0.0 if force_offset is None else force_offset
    state[[MOTION_TIME, MOTION_PLACE, LAST_ONSET, REFERENCE, FREE_PLACE]] = math.nan
    state[[LOWEST_MEAN, QUIETEST, BLOCK_LOWEST, BLOCK_BEFORE, SURFACE_THRESHOLD]] = math.inf
    state[BLOCK_TIME] = -math.inf
    return state


def grow(state: Array) -> Array:
    """The array, where a ring is full as a copy with rings of twice the length."""
    if not rings_are_full(state):
        return state
    capacity = (state.size - RINGS) // COLUMNS
    grown = np.zeros(RINGS + 2 * COLUMNS * capacity)
    grown[:RINGS] = state[:RINGS]
    old, new = state[RINGS:].reshape(COLUMNS, capacity), grown[RINGS:].reshape(COLUMNS, 2 * capacity)
    for rows, first in ((slice(0, 2), WINDOW_FIRST), (slice(2, 5), LATE_FIRST)):
        new[rows, :capacity] = np.roll(old[rows], -int(state[first]), axis=1)
        grown[first] = 0.0
    return grown


def rings_are_full(state: Array) -> bool:
    """Whether a ring has no room for one more sample."""
    capacity = (state.size - RINGS) // COLUMNS
    return bool(state[WINDOW_COUNT] >= capacity or state[LATE_COUNT] >= capacity)


QUIET_TIME = 0.5
"""A transient fault is over when nothing was found for so long [s]."""

DROPOUT_TIME = 0.02
"""Force and position that both repeat exactly for so long [s] are no new values."""

STUCK_TIME = 0.1
"""A force alone that repeats exactly for so long [s] is stuck."""

REPEAT_FACTOR = 4.0
"""Repeating is unusual from so many times the longest repetition so far: converters with few bits repeat too."""

NOISY_SHARE = 0.2
"""A force whose changes reverse in at least this share of samples has noise, and cannot stand; white noise has 2/3."""

NOISE_SAMPLES = 50
"""Noise is judged over about so many changes."""

SPIKE_FACTOR = 10.0
"""A spike is at least so many times the mean change between samples."""

ACTIVITY_TIME = 0.02
"""Time constant of that mean [s]."""

LARGEST_IMPEDANCE = 600.0
"""An impact at a speed v makes at most so many newtons for each m/s."""

LONGEST_GAP = 0.1
"""Behind a longer gap in time [s] samples are not compared with those before it."""

LARGEST_VALUE = 1e6
"""Numbers beyond this are none that a sensor means [m, N, s: times up to 1e12]."""


class SensorState(IntEnum):
    """What is wrong with the sensors; `SENSOR_SENTENCES` has the sentence."""

    GOOD = 0
    NOT_FINITE = 1
    DROPOUT = 2
    STUCK = 3
    SATURATED = 4
    OFFSET_STEP = 5
    SPIKE = 6
    ENCODER_JUMP = 7
    CONTACT_LOST = 8
    FORCE_DISAGREES = 9


TRANSIENT_STATES: Final = frozenset({SensorState.NOT_FINITE, SensorState.DROPOUT, SensorState.SPIKE})
"""States that pass after `QUIET_TIME` without another finding; the others stay until `SensorWatch.reset`."""
