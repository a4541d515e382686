"""Equation (20) over a whole recording, compiled; the arithmetic is that of `foretouch.identification.linear.kernel`.

In blocks that fit the cache: which samples are refused, then logarithms, rates and forgetting factors of the others in
loops that become vector instructions, then the recursion with theta and P in registers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, entry_point
from foretouch.identification.linear.kernel import bounded_rate, forgetting, learn, refusal, rules_of, weight_of
from foretouch.identification.linear.options import (
    FIRST_COVARIANCE,
    FIRST_THETA,
    FLOOR,
    FREE_AIR,
    GATE_DEPTH,
    GATE_FORCE,
    LARGEST_RATE,
    LAST_DEPTH,
    LEARNT,
    LOG_SCALE,
    PERTURBED,
    RATE,
    RATE_FACTOR,
    RESIDUALS,
    RESTARTED,
    SHARE,
    VELOCITY_FACTOR,
    WEIGHT,
)
from foretouch.identification.linear.recursion import logarithm
from foretouch.identification.linear.sample import count_depth, forget_depths, restart

Array = NDArray[np.float64]

BLOCK = 1024

# Rows of the scratch, BLOCK numbers each: what the samples of a block that are learnt from have.
DEPTH, VELOCITY, FORCE, MOVED = 0, 1 * BLOCK, 2 * BLOCK, 3 * BLOCK
LOG_DEPTH, RATE_SEEN, LOG_FORCE = 4 * BLOCK, 5 * BLOCK, 6 * BLOCK
MEMORY, INVERSE_MEMORY, WEIGHTS, NOISE = 7 * BLOCK, 8 * BLOCK, 9 * BLOCK, 10 * BLOCK
SCRATCH = 11 * BLOCK

_inlined = compiled(error_model="numpy", forceinline=True)


def _take_all(
    depth: Array, velocity: Array, force: Array, last_depth: float, scratch: Array, place: NDArray[np.int64]
) -> tuple[int, float]:
    """What `_gather` does where nothing is refused, without a branch a sample."""
    moved = abs(depth[0] - last_depth)
    scratch[MOVED] = moved if moved >= 0.0 else 0.0
    for i in range(depth.size):
        scratch[DEPTH + i] = depth[i]
        place[i] = i
    for i in range(depth.size):
        scratch[VELOCITY + i] = velocity[i]
        scratch[FORCE + i] = force[i]
    for i in range(1, depth.size):
        scratch[MOVED + i] = abs(depth[i] - depth[i - 1])
    return depth.size, depth[-1]


take_all: Any = compiled(error_model="numpy")(_take_all)


def _gather(
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    options: Array,
    last_depth: float,
    scratch: Array,
    place: NDArray[np.int64],
    status: NDArray[np.int8],
) -> tuple[int, float]:
    """The samples to learn from, one after the other; their number, and the depth that the next one moves from."""
    gate_depth, gate_force = options[GATE_DEPTH], options[GATE_FORCE]
    refused = 0
    for i in range(depth.size):
        code = refusal(depth[i], velocity[i], force[i], gate_depth, gate_force)
        code = code if in_contact[i] else FREE_AIR
        status[i] = code
        refused += code != LEARNT
    if refused == 0:
        return take_all(depth, velocity, force, last_depth, scratch, place)  # type: ignore[no-any-return]
    count = 0
    for i in range(depth.size):
        if status[i] != LEARNT:
            last_depth = np.nan if status[i] == FREE_AIR else last_depth
            continue
        moved = abs(depth[i] - last_depth)
        last_depth = depth[i]
        scratch[DEPTH + count] = last_depth
        scratch[VELOCITY + count] = velocity[i]
        scratch[FORCE + count] = force[i]
        scratch[MOVED + count] = moved if moved >= 0.0 else 0.0
        place[count] = i
        count += 1
    return count, last_depth


def _features(scratch: Array, count: int, options: Array) -> None:
    """Logarithms, rates, forgetting factors and weights of a block."""
    largest = options[LARGEST_RATE]
    floor, share, rate = options[FLOOR], options[SHARE], options[RATE]
    factor = options[WEIGHT]
    for i in range(count):
        scratch[LOG_DEPTH + i] = logarithm(scratch[DEPTH + i])
        scratch[LOG_FORCE + i] = logarithm(scratch[FORCE + i])
    for i in range(count):
        scratch[RATE_SEEN + i] = bounded_rate(scratch[DEPTH + i], scratch[VELOCITY + i], largest)
    for i in range(count):
        mu = forgetting(scratch[MOVED + i], floor, share, rate)
        scratch[MEMORY + i] = mu
        scratch[INVERSE_MEMORY + i] = 1.0 / mu
        scratch[NOISE + i] = mu
        scratch[WEIGHTS + i] = 1.0
    if factor > 0.0:
        for i in range(count):
            weight = weight_of(scratch[FORCE + i], factor)
            scratch[WEIGHTS + i] = weight
            scratch[NOISE + i] = scratch[MEMORY + i] / weight


gather: Any = compiled(error_model="numpy")(_gather)
features: Any = compiled(error_model="numpy")(_features)


def _recur(
    state: Array,
    options: Array,
    scratch: Array,
    place: NDArray[np.int64],
    count: int,
    status: NDArray[np.int8],
    every: Array,
) -> bool:
    """The recursion over a block; whether its last sample restarted it."""
    rules = rules_of(options)
    log_scale, velocity_factor, rate_factor = options[LOG_SCALE], options[VELOCITY_FACTOR], options[RATE_FACTOR]
    theta = (state[0], state[1], state[2], state[3])
    p = (state[4], state[5], state[6], state[7], state[8], state[9], state[10], state[11], state[12], state[13])
    residuals = (state[RESIDUALS], state[RESIDUALS + 1])
    fresh, row = False, 0
    for i in range(count):
        log_depth, velocity = scratch[LOG_DEPTH + i], scratch[VELOCITY + i]
        mu, inverse_mu = scratch[MEMORY + i], scratch[INVERSE_MEMORY + i]
        noise, weight = scratch[NOISE + i], scratch[WEIGHTS + i]
        if fresh:  # after a restart there is no depth that the sample could have moved from
            mu = forgetting(0.0, options[FLOOR], options[SHARE], options[RATE])
            inverse_mu, noise = 1.0 / mu, mu / weight
            fresh = False
        while row < min(place[i], every.shape[0]):  # refused samples left theta as it was
            every[row, 0], every[row, 1], every[row, 2], every[row, 3] = theta
            row += 1
        done, theta, p, residuals = learn(
            theta,
            p,
            residuals,
            (log_depth - log_scale, velocity * velocity_factor, scratch[RATE_SEEN + i] * rate_factor),
            scratch[LOG_FORCE + i],
            (mu, inverse_mu, noise),
            rules,
        )
        if done != LEARNT:
            status[place[i]] = done
        if done == RESTARTED:
            restart(state, options)
            first = options[FIRST_COVARIANCE]
            theta = (
                options[FIRST_THETA],
                options[FIRST_THETA + 1],
                options[FIRST_THETA + 2],
                options[FIRST_THETA + 3],
            )
            p = (first, 0.0, first, 0.0, 0.0, first, 0.0, 0.0, 0.0, first)
            residuals = (0.0, 0.0)
            fresh = True
            continue
        if done == PERTURBED:
            forget_depths(state)
        count_depth(state, log_depth, velocity, inverse_mu, weight)
    while row < every.shape[0]:
        every[row, 0], every[row, 1], every[row, 2], every[row, 3] = theta
        row += 1
    state[0], state[1], state[2], state[3] = theta
    state[4], state[5], state[6], state[7], state[8], state[9], state[10], state[11], state[12], state[13] = p
    state[RESIDUALS], state[RESIDUALS + 1] = residuals
    return fresh


recur: Any = compiled(error_model="numpy")(_recur)


def _run(
    state: Array,
    options: Array,
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    status: NDArray[np.int8],
    every: Array,
) -> None:
    """All samples of a recording, as `foretouch.identification.linear.sample.update` with one after the other.

    Args:
        state: Of `foretouch.identification.linear.options`, shape (STATE_SIZE,); changed in place.
        options: Shape (OPTIONS_SIZE,).
        depth: [m], shape (m,).
        velocity: [m/s], shape (m,).
        force: [N], shape (m,).
        in_contact: Shape (m,).
        status: What was done with each sample, shape (m,); filled.
        every: Theta after each sample, shape (m, 4), filled; or shape (0, 4), left alone.
    """
    scratch = np.empty(SCRATCH)
    place = np.empty(BLOCK, np.int64)
    for start in range(0, depth.size, BLOCK):
        end = min(start + BLOCK, depth.size)
        count, last_depth = gather(
            depth[start:end],
            velocity[start:end],
            force[start:end],
            in_contact[start:end],
            options,
            state[LAST_DEPTH],
            scratch,
            place,
            status[start:end],
        )
        features(scratch, count, options)
        restarted = recur(state, options, scratch, place, count, status[start:end], every[start:end])
        # A restart forgets where it was; so does free air after it.
        state[LAST_DEPTH] = np.nan if restarted else last_depth


run: Callable[[Array, Array, Array, Array, Array, NDArray[np.bool_], NDArray[np.int8], Array], None] = entry_point(_run)
