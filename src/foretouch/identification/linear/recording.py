"""Equation (20) over a whole recording, compiled; the arithmetic is that of `foretouch.identification.linear.kernel`.

In blocks that fit the cache: which samples are refused, then logarithms, rates and forgetting factors of the others in
loops that become vector instructions, then the recursion with theta and P in registers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, entry_point
from foretouch.identification.linear import options as at
from foretouch.identification.linear.kernel import (
    bounded_rate,
    forgetting,
    learn,
    read,
    refusal,
    rules_of,
    weight_of,
    write,
)
from foretouch.identification.linear.options import FREE_AIR, LEARNT, PERTURBED, RESTARTED
from foretouch.identification.linear.recursion import logarithm
from foretouch.identification.linear.sample import count_depth, forget_depths, restart

Array = NDArray[np.float64]

BLOCK = 1024

# Rows of the scratch, BLOCK numbers each, for the samples of a block that are learnt from.
DEPTH, VELOCITY, FORCE, MOVED = 0, 1 * BLOCK, 2 * BLOCK, 3 * BLOCK
LOG_DEPTH, RATE_SEEN, LOG_FORCE = 4 * BLOCK, 5 * BLOCK, 6 * BLOCK
MEMORY, INVERSE_MEMORY, WEIGHTS, NOISE = 7 * BLOCK, 8 * BLOCK, 9 * BLOCK, 10 * BLOCK
SCRATCH = 11 * BLOCK


@compiled(error_model="numpy")
def take_all(
    depth: Array, velocity: Array, force: Array, last_depth: float, scratch: Array, place: NDArray[np.int64]
) -> tuple[int, float]:
    """`gather` where no sample is refused, without a branch a sample."""
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


@compiled(error_model="numpy")
def gather(
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
    """Select the samples to learn from; returns their number, and the depth that the next one moves from."""
    gate_depth, gate_force = options[at.GATE_DEPTH], options[at.GATE_FORCE]
    refused = 0
    for i in range(depth.size):
        code = refusal(depth[i], velocity[i], force[i], gate_depth, gate_force)
        code = code if in_contact[i] else FREE_AIR
        status[i] = code
        refused += code != LEARNT
    if refused == 0:
        return take_all(depth, velocity, force, last_depth, scratch, place)
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


@compiled(error_model="numpy")
def features(scratch: Array, count: int, options: Array) -> None:
    """Compute logarithms, rates, forgetting factors and weights of a block."""
    largest = options[at.LARGEST_RATE]
    floor, share, rate = options[at.FLOOR], options[at.SHARE], options[at.RATE]
    factor = options[at.WEIGHT]
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


@compiled(error_model="numpy")
def recur(
    state: Array,
    options: Array,
    scratch: Array,
    place: NDArray[np.int64],
    count: int,
    status: NDArray[np.int8],
    every: Array,
) -> bool:
    """Run the recursion over a block; returns whether its last sample restarted it."""
    rules = rules_of(options)
    log_scale = options[at.LOG_SCALE]
    velocity_factor, rate_factor = options[at.VELOCITY_FACTOR], options[at.RATE_FACTOR]
    theta, p, residuals = read(state, 0, 1)
    fresh, row = False, 0
    for i in range(count):
        log_depth, velocity = scratch[LOG_DEPTH + i], scratch[VELOCITY + i]
        mu, inverse_mu = scratch[MEMORY + i], scratch[INVERSE_MEMORY + i]
        noise, weight = scratch[NOISE + i], scratch[WEIGHTS + i]
        if fresh:  # after a restart there is no depth that the sample could have moved from
            mu = forgetting(0.0, options[at.FLOOR], options[at.SHARE], options[at.RATE])
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
            theta, p, residuals = read(state, 0, 1)
            fresh = True
            continue
        if done == PERTURBED:
            forget_depths(state)
        count_depth(state, log_depth, velocity, inverse_mu, weight)
    while row < every.shape[0]:
        every[row, 0], every[row, 1], every[row, 2], every[row, 3] = theta
        row += 1
    write(state, theta, p, residuals)
    return fresh


@entry_point
def run(
    state: Array,
    options: Array,
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    status: NDArray[np.int8],
    every: Array,
) -> None:
    """Process all samples of a recording, as `foretouch.identification.linear.sample.update` one after the other.

    Args:
        state: State of `foretouch.identification.linear.options`, shape (STATE_SIZE,); changed in place.
        options: Options of the estimator, shape (OPTIONS_SIZE,).
        depth: Depths [m], shape (m,).
        velocity: Velocities [m/s], shape (m,).
        force: Forces [N], shape (m,).
        in_contact: Whether each sample is in contact, shape (m,).
        status: Status of each sample, shape (m,); filled.
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
            state[at.LAST_DEPTH],
            scratch,
            place,
            status[start:end],
        )
        features(scratch, count, options)
        restarted = recur(state, options, scratch, place, count, status[start:end], every[start:end])
        # A restart forgets the last depth; so does free air after it.
        state[at.LAST_DEPTH] = np.nan if restarted else last_depth
