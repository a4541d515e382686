"""One sample of `foretouch.identification.SensorWatch`, compiled.

Its types are stated: a driver that says a whole number where a fraction came before is no reason to compile anew in a
loop.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.conditioning import layout
from foretouch.identification.conditioning.fault_kernels import (
    AGREES,
    EFFORT,
    LOSS_SIZE,
    LOST,
    begin_loss,
    begin_steps,
    find_loss,
    find_step,
    has_fallen,
    is_falling,
    restart_steps,
)
from foretouch.identification.conditioning.fault_kernels import OFFSET_SIZE as STEP_SIZE
from foretouch.identification.conditioning.layout import SensorState

Array = NDArray[np.float64]

STATE, TIME, BAD_UNTIL = 0, 1, 2
"""Indices in the array: the newest judgement, the time of the newest sample, and the end of a transient fault [s]."""

ACTIVITY = 3
"""Index of the mean change of the force between samples [N]."""

NOISY, SEEN, CHANGE = 4, 5, 6
"""Indices of the fraction of changes that reverse, of the number of changes, and of the newest of them [N]."""

BOTH_REPEAT, LONGEST_BOTH, FORCE_REPEATS, LONGEST_FORCE = 7, 8, 9, 10
"""Indices of the times for which force and position, and the force alone, repeat, each with the longest so far [s]."""

NEAR_END = 11
"""Index of whether the newest sample was at an end of the range."""

KNOWN, OLDER, FURTHER, FURTHEST = 12, 13, 16, 19
"""How many samples before are compared with, at most three; and where they are, the newest first: position [m], force
[N], and force less the tool's [N]."""

LOWEST, HIGHEST, LARGEST_SPEED, LEAST_SPIKE, MASS = 22, 23, 24, 25, 26
"""Indices of the settings: the ends of the range [N], and those of `SensorWatch` [m/s, N, kg]."""

STEP = 27
"""Index at which the state of the offset watch begins (`foretouch.identification.conditioning.fault_kernels`)."""

LOSS = STEP + STEP_SIZE
"""Index at which the state of the loss watch begins, of the same module."""

SIZE = LOSS + LOSS_SIZE

GOOD, NOT_FINITE, DROPOUT, STUCK, SATURATED, OFFSET_STEP, SPIKE, ENCODER_JUMP, CONTACT_LOST, FORCE_DISAGREES = (
    int(state) for state in SensorState
)
PASSING = tuple(sorted(int(state) for state in layout.TRANSIENT_STATES))


@compiled
def _restart(watch: Array) -> None:
    """Forget the samples for comparison."""
    watch[KNOWN] = watch[BOTH_REPEAT] = watch[FORCE_REPEATS] = watch[CHANGE] = watch[NEAR_END] = 0.0
    restart_steps(watch[STEP:LOSS])
    begin_loss(watch[LOSS:])


@compiled("void(f8[::1])")
def begin(watch: Array) -> None:
    """Reset the watch: no fault, no samples."""
    watch[STATE] = float(GOOD)
    watch[TIME] = watch[BAD_UNTIL] = -math.inf
    watch[ACTIVITY] = watch[NOISY] = watch[SEEN] = watch[LONGEST_BOTH] = watch[LONGEST_FORCE] = 0.0
    _restart(watch)
    begin_steps(watch[STEP:LOSS])


@compiled
def _say(watch: Array, found: int, time: float) -> int:
    """Update the judgement: a lasting fault stays, a transient one passes a while after the last finding."""
    state = int(watch[STATE])
    if state != GOOD and state not in PASSING:
        return state
    if found != GOOD:
        state, watch[BAD_UNTIL] = found, time + layout.QUIET_TIME
    elif time >= watch[BAD_UNTIL]:
        state = GOOD
    watch[STATE] = float(state)
    return state


@compiled
def _repeats(watch: Array, position: float, force: float, period: float) -> int:
    """Whether nothing new comes, from sensors that have shown noise."""
    change = force - watch[OLDER + 1]
    if change != 0.0:
        if watch[FORCE_REPEATS] < layout.STUCK_TIME:
            watch[LONGEST_FORCE] = max(watch[LONGEST_FORCE], watch[FORCE_REPEATS])
        watch[SEEN] += 1.0
        reverses = 1.0 if change * watch[CHANGE] < 0.0 else 0.0
        watch[NOISY] += (reverses - watch[NOISY]) / min(watch[SEEN], layout.NOISE_SAMPLES)
        watch[CHANGE] = change
        watch[FORCE_REPEATS] = 0.0
    else:
        watch[FORCE_REPEATS] += period
    if change != 0.0 or position != watch[OLDER]:
        if watch[BOTH_REPEAT] < layout.DROPOUT_TIME:
            watch[LONGEST_BOTH] = max(watch[LONGEST_BOTH], watch[BOTH_REPEAT])
        watch[BOTH_REPEAT] = 0.0
    else:
        watch[BOTH_REPEAT] += period
    if watch[SEEN] < layout.NOISE_SAMPLES or watch[NOISY] < layout.NOISY_SHARE:
        return GOOD
    slack = 0.5 * min(period, layout.DROPOUT_TIME / 10.0)  # sums of periods are not exact
    if watch[BOTH_REPEAT] + slack > max(layout.DROPOUT_TIME, layout.REPEAT_FACTOR * watch[LONGEST_BOTH]):
        return DROPOUT
    if watch[FORCE_REPEATS] + slack > max(layout.STUCK_TIME, layout.REPEAT_FACTOR * watch[LONGEST_FORCE]):
        return STUCK
    return GOOD


@compiled
def _is_spike(watch: Array, position: float, force: float, period: float) -> bool:
    """Whether the sample before this one stands far out, and no impact explains it."""
    if watch[KNOWN] < 3.0:
        return False
    near, peak = watch[OLDER], watch[OLDER + 2]
    further, before = watch[FURTHER], watch[FURTHER + 2]
    furthest, earlier = watch[FURTHEST], watch[FURTHEST + 2]
    up, down = peak - before, peak - force
    size = min(abs(up), abs(down)) if up * down > 0.0 else 0.0
    threshold = max(watch[LEAST_SPIKE], layout.SPIKE_FACTOR * watch[ACTIVITY])
    found = size > threshold and abs(force - before) < 0.5 * size and abs(before - earlier) < 0.5 * size
    if found and up > 0.0:
        speed = (further - furthest) / period
        slowed = speed - min(near - further, position - near) / period
        found = speed * layout.LARGEST_IMPEDANCE < size or slowed < 0.5 * size * period / watch[MASS]
    share = 1.0 - math.exp(-period / layout.ACTIVITY_TIME)
    watch[ACTIVITY] += share * (min(abs(force - peak), 3.0 * threshold) - watch[ACTIVITY])
    return bool(found)


@compiled
def _compare(watch: Array, position: float, force: float, contact: float, period: float) -> int:
    """Compare a sample with those before it."""
    if watch[KNOWN] == 0.0:
        return GOOD
    since = period + watch[BOTH_REPEAT]  # a value that is new
    repeated = _repeats(watch, position, force, period)
    stepped = find_step(watch[STEP:LOSS], position, contact, period)
    was_near, near = watch[NEAR_END] != 0.0, not watch[LOWEST] < force < watch[HIGHEST]
    watch[NEAR_END] = 1.0 if near else 0.0
    if near and was_near:
        return SATURATED
    # 20 um: an encoder's count and noise, which at high rates are fast
    if abs(position - watch[OLDER]) > watch[LARGEST_SPEED] * since + 2e-5:
        _restart(watch)
        return ENCODER_JUMP
    if repeated != GOOD:
        return repeated
    if _is_spike(watch, position, contact, period):
        return SPIKE
    return OFFSET_STEP if stepped else GOOD


@compiled
def _bears_out(
    watch: Array, time: float, position: float, force: float, zero: float, effort: float, slid: float
) -> int:
    """Fault of a force, if any."""
    found = find_loss(watch[LOSS:], time, position, force, zero, effort, slid)
    if found == AGREES:
        return GOOD
    return CONTACT_LOST if found == LOST else FORCE_DISAGREES


@compiled("Tuple((i8, b1, f8))(f8[::1], f8, f8, f8, f8, f8, f8, f8)")
def look(
    watch: Array,
    time: float,
    position: float,
    force: float,
    tool_force: float,
    zero: float,
    effort: float,
    slid: float,
) -> tuple[int, bool, float]:
    """Take one sample, as `SensorWatch.update` does.

    Args:
        watch: Written, shape (SIZE,).
        time: [s].
        position: [m].
        force: [N].
        tool_force: [N].
        zero: [N].
        effort: [N].
        slid: [m].

    Returns:
        A `SensorState`; whether it is being judged if the force has fallen for no reason; and the drive's effort,
        low-passed [N], 0 where it is not told.
    """
    numbers = (
        abs(position) < layout.LARGEST_VALUE
        and abs(force) < layout.LARGEST_VALUE
        and abs(tool_force) < layout.LARGEST_VALUE
    )
    if not (abs(time) < 1e6 * layout.LARGEST_VALUE and numbers):
        _restart(watch)
        return _say(watch, NOT_FINITE, watch[TIME]), False, watch[LOSS + EFFORT]
    period = time - watch[TIME]
    if not period > 0.0:
        return int(watch[STATE]), False, watch[LOSS + EFFORT]
    contact = force - tool_force
    if period > layout.LONGEST_GAP:
        _restart(watch)
        found = GOOD
    else:
        found = _compare(watch, position, force, contact, period)
    zero = zero if math.isfinite(zero) else 0.0
    lost = _bears_out(watch, time, position, contact, zero, effort, slid if slid > 0.0 else 0.0)
    found = lost if found == GOOD else found
    watch[TIME] = time
    for place in range(FURTHEST + 2, FURTHER - 1, -1):
        watch[place] = watch[place - 3]
    watch[OLDER], watch[OLDER + 1], watch[OLDER + 2] = position, force, contact
    watch[KNOWN] = min(watch[KNOWN] + 1.0, 3.0)
    uncertain = has_fallen(watch[STEP:LOSS]) or is_falling(watch[LOSS:])
    return _say(watch, found, time), uncertain, watch[LOSS + EFFORT]
