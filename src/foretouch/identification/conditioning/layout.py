"""What a conditioner remembers from sample to sample, by its place in one flat array.

First numbers; then the last 50 ms of force, and the samples that wait for a late sensor, both as rings of one length,
which the array's own length tells.
"""

from __future__ import annotations

import math

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
