"""One raw sample conditioned, compiled. The method and its reasons are in `foretouch.identification.Conditioner`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel, squared
from foretouch.core.compiling import inlined
from foretouch.identification.conditioning.air import (
    START_WINDOW,
    SURE,
    Air,
    Start,
    begin_air,
    begins_now,
    direction,
    drifted,
    follow_air,
)
from foretouch.models.predictor import VELOCITY_CUTOFF

Array = NDArray[np.float64]

CONTACT_FLOOR = 0.05
"""Least force [N] that counts as contact where nothing better is known of the sensor."""

NOISE_FACTOR = 8.0
"""Threshold of contact above the force in free air, in spreads of the quietest window: what chatters in free air is not
the sensor's noise."""

PEAK_TIME = START_WINDOW / 10.0  # Length of a block [s]; the largest force is the lowest in two of them

PEAK_SHARE = 0.05
"""Least threshold of contact above free air, as a fraction of the largest force so far: friction of the mechanism grows
with what presses it, and is no contact."""

RELEASE_SHARE = 0.5  # Threshold of leaving contact, as a fraction of the threshold at which it began

VELOCITY_RATE = 2.0 * math.pi * VELOCITY_CUTOFF


class Quiet(Record):
    """Mean and spread of the force over the window of its newest samples, and those of quiet windows."""

    first: int  # index in the rings of the window's oldest force
    count: int
    most: int  # largest count of a full window
    counted: int  # count of the window of the least spread
    reference: float = math.nan  # force that is subtracted before squaring, so that the sums stay small [N]
    total: float  # of the force over the window [N]
    squares: float  # [N^2]
    lowest_mean: float = math.inf  # of a quiet window [N]
    noise: float  # spread of the window that gave the offset [N]
    least_spread: float = math.inf  # of a window [N]
    start: Start


class Block(Record):
    """Lowest forces of two blocks of time, for the largest force that lasted."""

    time: float = -math.inf  # beginning [s]
    lowest: float = math.inf  # [N]
    before: float = math.inf  # of the previous block [N]


class Late(Record):
    """The samples that wait for a late sensor."""

    first: int  # index in the rings of the oldest
    count: int


class Conditioning(Record):
    """State of a `Conditioner`, beside the rings of its newest samples."""

    lag: float  # of the force sensor [s]
    floor: float  # least force that counts as contact [N]
    surface_given: bool
    surface: float = math.nan  # [m]; NaN while unknown
    surface_error: float = math.nan  # standard error of the surface [m]
    offset: float  # of the force [N], less its drift since
    offset_error: float = math.nan  # standard deviation of the given one [N], 0 if it is exact; NaN if none was given
    zero: float  # of the force at the newest sample: with the drift [N]
    in_contact: bool
    motion_time: float = math.nan  # of the newest sample of the low-pass [s]
    motion_place: float = math.nan  # its position [m]
    velocity: float  # low-passed [m/s]
    last_onset: float = math.nan  # where the previous contact began [m]
    quiet: Quiet
    peak: float  # largest force that lasted [N]
    block: Block
    surface_threshold: float = math.inf  # at which the surface was detected [N]
    free_place: float = math.nan  # last position below the threshold of release [m]
    air: Air
    late: Late


Memory = tuple[NDArray[np.void], Array]
"""One `Conditioning`; and the rings, shape (5, capacity): times [s] and forces [N] of the window, and times [s],
positions [m] and velocities [m/s] of samples that wait for a late sensor."""

FIRST_CAPACITY = 128


@compiled(error_model="numpy")
def expect_zero(state: Conditioning) -> None:
    """Begin with what was given of the zero, if it was not given exactly."""
    is_guess, air = state.offset_error > 0.0, state.air  # not where it is NaN
    begin_air(air, math.nan, state.offset if is_guess else math.nan, 0.0, state.floor)
    air.reference_at, air.reference_in = -math.inf if is_guess else math.inf, -math.inf
    if is_guess:
        air.covariance[0, 0] = squared(state.offset_error)


@inlined
def is_full(memory: Memory) -> bool:
    """Whether a ring has no room for one more sample."""
    capacity = memory[1].shape[1]
    return bool(memory[0][0].quiet.count >= capacity or memory[0][0].late.count >= capacity)


@compiled(error_model="numpy")
def lose_surface(memory: Memory) -> None:
    """Look for the surface again, unless it was given."""
    state = memory[0][0]
    if not state.surface_given:
        state.surface = math.nan
    state.peak = 0.0


@kernel("void(Tuple((Conditioning[::1], f8[:, ::1])), f8)")
def shift(memory: Memory, change: float) -> None:
    """Shift the surface with a material that moved by this [m], positive if deeper; a given surface stays."""
    state = memory[0][0]
    if math.isfinite(change) and not state.surface_given:
        state.surface += change
        state.free_place += change
        state.last_onset += change


@inlined
def move(state: Conditioning, time: float, position: float) -> float:
    """Velocity from positions, as `foretouch.models.MotionFilter` computes it [m/s]."""
    period = time - state.motion_time
    if not period > 0.0:
        if math.isnan(state.motion_time):
            state.motion_time, state.motion_place = time, position
        return float(state.velocity)
    slope = (position - state.motion_place) / period
    state.velocity += (1.0 - math.exp(-VELOCITY_RATE * period)) * (slope - state.velocity)
    state.motion_time, state.motion_place = time, position
    return float(state.velocity)


@compiled(error_model="numpy")
def delay(state: Conditioning, rings: Array, time: float, position: float, velocity: float) -> tuple[float, float]:
    """Position and velocity one lag ago, between the samples around that time; the first ones until there are such."""
    capacity, times, positions, speeds = rings.shape[1], rings[2], rings[3], rings[4]
    late, wanted = state.late, time - state.lag
    index = (late.first + late.count) % capacity
    times[index], positions[index], speeds[index] = time, position, velocity
    late.count += 1
    while late.count > 2 and times[(late.first + 1) % capacity] <= wanted:
        late.first = (late.first + 1) % capacity
        late.count -= 1
    first = late.first
    second = (first + 1) % capacity if late.count > 1 else first
    span = times[second] - times[first]
    weight = min(max((wanted - times[first]) / span, 0.0), 1.0) if span > 0.0 else 0.0
    point, speed = positions[first], speeds[first]
    return point + weight * (positions[second] - point), speed + weight * (speeds[second] - speed)


@inlined
def begin_again(state: Conditioning) -> None:
    """Forget what the force was."""
    quiet, block = state.quiet, state.block
    quiet.count, quiet.most, quiet.counted = 0, 0, 0
    quiet.reference, quiet.total, quiet.squares = math.nan, 0.0, 0.0
    quiet.lowest_mean = quiet.least_spread = math.inf
    block.time, block.lowest, block.before = -math.inf, math.inf, math.inf
    state.quiet.start.over, state.peak = -math.inf, 0.0
    state.in_contact, state.surface_threshold, state.free_place = False, math.inf, math.nan
    air = state.air
    expect_zero(state)
    air.begin = air.level.force = math.nan
    air.touching, air.outermost, air.end_before = False, math.inf, math.inf
    if not state.surface_given:
        state.surface = state.surface_error = math.nan


@inlined
def learn_offset(state: Conditioning, rings: Array, time: float, force: float) -> None:
    """Keep mean and spread of the last 50 ms, and those of the quietest 50 ms so far."""
    quiet = state.quiet
    if math.isnan(quiet.reference):
        quiet.reference = force
    capacity, times, forces = rings.shape[1], rings[0], rings[1]
    shifted, index = force - quiet.reference, (quiet.first + quiet.count) % capacity
    times[index], forces[index] = time, shifted
    quiet.count += 1
    quiet.total += shifted
    quiet.squares += shifted * shifted
    full = False
    while time - times[quiet.first] >= START_WINDOW:
        full, old = True, forces[quiet.first]
        quiet.total -= old
        quiet.squares -= old * old
        quiet.first = (quiet.first + 1) % capacity
        quiet.count -= 1
    mean = quiet.total / quiet.count
    spread = math.sqrt(max(0.0, quiet.squares / quiet.count - mean * mean))
    if full:
        # The few samples after a gap are alike by chance: their spread is not that of the noise.
        quiet.most = max(quiet.most, quiet.count)
        full = 4 * quiet.count >= 3 * quiet.most
        if 4 * quiet.counted < 3 * quiet.most and quiet.counted > 0:
            quiet.least_spread = quiet.noise = spread
            quiet.counted = quiet.count
        elif full and spread < quiet.least_spread:
            quiet.least_spread, quiet.counted = spread, quiet.count
    if not math.isnan(state.air.reference) and quiet.lowest_mean < math.inf:  # what is lower now has drifted
        return
    if full:
        # When the tool is jerked, the sensor may show less than nothing for a moment. Noise that makes the threshold no
        # larger than the floor is quiet, however quiet the quietest window was.
        if mean >= quiet.lowest_mean or spread > max(SURE * quiet.least_spread, state.floor / NOISE_FACTOR):
            return
        quiet.lowest_mean = mean
    elif quiet.lowest_mean < math.inf:
        return
    quiet.noise = spread
    if math.isnan(state.offset_error):
        state.offset = mean + quiet.reference


@inlined
def learn_peak(state: Conditioning, time: float, force: float) -> None:
    """The largest force that lasted: the lowest in two blocks of time, so that a spike of the sensor does not count."""
    block = state.block
    if time - block.time < PEAK_TIME:
        block.lowest = min(block.lowest, force)
        return
    if block.before < math.inf:
        state.peak = max(state.peak, min(block.before, block.lowest))
    block.time, block.before, block.lowest = time, block.lowest, force


@inlined
def threshold_of(state: Conditioning) -> float:
    """Threshold of contact [N]."""
    noise = NOISE_FACTOR * min(state.quiet.least_spread, state.quiet.noise)
    return float(max(state.floor, noise, PEAK_SHARE * state.peak))


@compiled(error_model="numpy")
def learn_surface(state: Conditioning, position: float, threshold: float) -> None:
    """Take the surface and its uncertainty from the beginning of a contact.

    The uncertainty is the distance over which contact became certain, and where it was last. Where a surface is known
    and certain, the one further out is right.
    """
    point = state.free_place
    # It is looked for again where the threshold of release is above that at which it was detected.
    if math.isnan(state.surface) or RELEASE_SHARE * threshold > state.surface_threshold:
        state.surface = point
        state.surface_threshold = threshold
    elif point < state.surface:
        state.surface = point
    width = abs(position - point) / math.sqrt(12.0)
    apart = 0.0 if math.isnan(state.last_onset) else abs(point - state.last_onset) / math.sqrt(2.0)
    state.last_onset = point
    newest, error = width * width + apart * apart, state.surface_error
    state.surface_error = math.sqrt(newest if math.isnan(error) else 0.5 * (error * error + newest))


@inlined
def condition(
    memory: Memory, time: float, position: float, force: float, velocity: float, measured: bool
) -> tuple[float, float, float, bool]:
    """One sample, in place; both rings have room for it (`is_full`).

    Args:
        memory: Of the conditioner.
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
    state, rings = memory[0][0], memory[1]
    if not measured:
        velocity = move(state, time, position)
    if state.lag > 0.0:
        position, velocity = delay(state, rings, time, position, velocity)
    if begins_now(state.quiet.start, state.quiet.reference, time, force):
        begin_again(state)
    learn_offset(state, rings, time, force)
    raw, air = force, state.air
    state.zero = state.offset + drifted(air, time)
    force -= state.zero
    learn_peak(state, time, force)
    threshold = threshold_of(state)
    way = direction(velocity)
    pushed = force - way * max(air.known[2], 0.0)  # friction of the mechanism is no contact
    if state.in_contact:
        touching = pushed > RELEASE_SHARE * threshold
    else:
        if pushed <= RELEASE_SHARE * threshold or math.isnan(state.free_place):
            state.free_place = position
        touching = pushed > threshold
        if touching and not state.surface_given:
            learn_surface(state, position, threshold)
    if state.offset_error != 0.0:
        before, quiet = air.reference, min(max(3.0 * state.quiet.noise, state.floor / NOISE_FACTOR), state.floor)
        limits = state.floor, quiet, state.zero
        if not follow_air(air, time, (position, raw, way), touching, state.surface, limits) and touching:
            # It was no contact, and the surface is where the next one begins.
            state.surface_threshold, state.free_place, touching = 0.0, position, False
        if math.isnan(before) and not math.isnan(air.reference):
            state.offset = air.reference
        elif math.isnan(air.reference) and not math.isnan(before):
            state.offset = air.level.force
    state.in_contact = touching
    if touching and not state.surface_given and position < state.surface:
        state.surface = position
    return position - state.surface, velocity, force, touching


@kernel("(Tuple((Conditioning[::1], f8[:, ::1])), f8, f8, f8, f8, b1)", error_model="numpy")
def take(
    memory: Memory, time: float, position: float, force: float, velocity: float, measured: bool
) -> tuple[float, float, float, bool, bool]:
    """`condition` for a loop in Python, and whether the rings need room before the next sample.

    Its numbers are Python's own, also where nothing is compiled.
    """
    depth, velocity, force, touching = condition(memory, time, position, force, velocity, measured)
    return float(depth), float(velocity), float(force), bool(touching), is_full(memory)
