"""Layout of the conditioner's memory in one flat array; and the states of a sensor.

Single numbers come first; then the last 50 ms of force, and the samples that wait for a late sensor, both as rings of
one length, which follows from the length of the array.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAG = 0  # lag of the force sensor [s]
FLOOR = 1  # least force that counts as contact [N]
SURFACE_GIVEN, OFFSET_GIVEN = 2, 3  # 1 where the value was given
SURFACE = 4  # position of the surface [m], NaN while unknown
SURFACE_ERROR = 5  # standard error of the surface [m]
OFFSET = 6  # force offset [N]
IN_CONTACT = 7  # 1 in contact
MOTION_TIME, MOTION_PLACE, VELOCITY = 8, 9, 10  # newest sample and velocity of the low-pass
LAST_ONSET = 11  # where the previous contact began [m]
REFERENCE = 12  # force that is subtracted before squaring, so that the running sums stay small [N]
SUM, SQUARES = 13, 14  # sums of the force and its square over the window
LOWEST_MEAN = 15  # lowest mean of a quiet window [N]
NOISE = 16  # spread of the window that gave the offset [N]
QUIETEST = 17  # least spread of a window [N]
PEAK = 18  # largest force that lasted [N]
BLOCK_TIME, BLOCK_LOWEST, BLOCK_BEFORE = 19, 20, 21  # begin and lowest force of a block, lowest of the previous one
SURFACE_THRESHOLD = 22  # threshold at which the surface was detected [N]
FREE_PLACE = 23  # last position below the threshold of release [m]
WINDOW_FIRST, WINDOW_COUNT = 24, 25  # first and number of the ring of forces
LATE_FIRST, LATE_COUNT = 26, 27  # first and number of the ring of samples that wait
RINGS = 28  # from here on: times and forces of the window; times, positions and velocities that wait

COLUMNS = 5
_FIRST_CAPACITY = 128


def make_state(surface: float | None, force_offset: float | None, contact_floor: float, sensor_lag: float) -> Array:
    """Make the array of a conditioner without samples: see `conditioning.Conditioner` for the arguments."""
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
    """The array; where a ring is full, a copy with rings of twice the length."""
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
"""Time without another finding after which a transient fault is over [s]."""

DROPOUT_TIME = 0.02
"""Time after which force and position that both repeat exactly are not new values [s]."""

STUCK_TIME = 0.1
"""Time after which a force that alone repeats exactly is stuck [s]."""

REPEAT_FACTOR = 4.0
"""Least ratio of a repetition to the longest so far to be unusual: converters with few bits repeat too."""

NOISY_SHARE = 0.2
"""Least fraction of reversing changes of a force with noise, which cannot repeat; white noise has 2/3."""

NOISE_SAMPLES = 50
"""Number of changes over which noise is judged, about."""

SPIKE_FACTOR = 10.0
"""Least size of a spike, as a multiple of the mean change between samples."""

ACTIVITY_TIME = 0.02
"""Time constant of the mean change between samples [s]."""

LARGEST_IMPEDANCE = 600.0
"""Largest ratio of the force of an impact to its speed [N s/m]."""

LONGEST_GAP = 0.1
"""Longest gap in time [s] across which samples are compared."""

LARGEST_VALUE = 1e6
"""Largest magnitude of a valid measurement [m, N, s: times up to 1e12]."""


class SensorState(IntEnum):
    """Fault of the sensors; `SENSOR_SENTENCES` has the sentence."""

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
