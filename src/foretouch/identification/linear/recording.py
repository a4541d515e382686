"""Equation (20) over a whole recording, compiled; the arithmetic is that of `foretouch.identification.linear.kernel`.

In blocks that fit the cache: which samples are refused, then logarithms, rates and forgetting factors of the others in
loops that become vector instructions, then the recursion with theta and P in registers.
"""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, entry_point
from foretouch.core.records import Record
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
from foretouch.identification.linear.options import FREE_AIR, LEARNT, PERTURBED, RESTARTED, Packed, State
from foretouch.identification.linear.recursion import logarithm
from foretouch.identification.linear.sample import count_depth, forget_depths, restart

Array = NDArray[np.float64]

Samples: TypeAlias = tuple[Array, Array, Array, NDArray[np.bool_]]
"""Depth [m], velocity [m/s], force [N] and contact of a recording, shape (n,) each."""

BLOCK = 1024


class Block(Record):
    """The samples of a block that are learnt from."""

    depth: Annotated[NDArray[Any], float, BLOCK]
    velocity: Annotated[NDArray[Any], float, BLOCK]
    force: Annotated[NDArray[Any], float, BLOCK]
    moved: Annotated[NDArray[Any], float, BLOCK]  # distance from the sample before
    log_depth: Annotated[NDArray[Any], float, BLOCK]
    rate: Annotated[NDArray[Any], float, BLOCK]
    log_force: Annotated[NDArray[Any], float, BLOCK]
    memory: Annotated[NDArray[Any], float, BLOCK]  # mu
    inverse_memory: Annotated[NDArray[Any], float, BLOCK]
    weights: Annotated[NDArray[Any], float, BLOCK]
    noise: Annotated[NDArray[Any], float, BLOCK]  # mu over the weight
    index: Annotated[NDArray[Any], int, BLOCK]  # in the block of all samples


_BLOCK = Block.layout


@compiled(error_model="numpy")
def take_all(
    depth: Array, velocity: Array, force: Array, last_depth: float, blocks: NDArray[np.void]
) -> tuple[int, float]:
    """`gather` where no sample is refused, without a branch a sample."""
    block = blocks[0]
    moved = abs(depth[0] - last_depth)
    block.moved[0] = moved if moved >= 0.0 else 0.0
    for i in range(depth.size):
        block.depth[i] = depth[i]
        block.index[i] = i
    for i in range(depth.size):
        block.velocity[i] = velocity[i]
        block.force[i] = force[i]
    for i in range(1, depth.size):
        block.moved[i] = abs(depth[i] - depth[i - 1])
    return depth.size, depth[-1]


@compiled(error_model="numpy")
def gather(
    samples: Samples, options: Packed, last_depth: float, blocks: NDArray[np.void], status: NDArray[np.int8]
) -> tuple[int, float]:
    """Select the samples to learn from; returns their number, and the depth that the next one moves from."""
    depth, velocity, force, in_contact = samples
    block, gate_depth, gate_force = blocks[0], options.gate_depth, options.gate_force
    refused = 0
    for i in range(depth.size):
        code = refusal(depth[i], velocity[i], force[i], gate_depth, gate_force)
        code = code if in_contact[i] else FREE_AIR
        status[i] = code
        refused += code != LEARNT
    if refused == 0:
        return take_all(depth, velocity, force, last_depth, blocks)
    count = 0
    for i in range(depth.size):
        if status[i] != LEARNT:
            last_depth = np.nan if status[i] == FREE_AIR else last_depth
            continue
        moved = abs(depth[i] - last_depth)
        last_depth = depth[i]
        block.depth[count] = last_depth
        block.velocity[count] = velocity[i]
        block.force[count] = force[i]
        block.moved[count] = moved if moved >= 0.0 else 0.0
        block.index[count] = i
        count += 1
    return count, last_depth


@compiled(error_model="numpy")
def features(blocks: NDArray[np.void], count: int, options: Packed) -> None:
    """Compute logarithms, rates, forgetting factors and weights of a block."""
    block, largest = blocks[0], options.largest_rate
    floor, fraction, rate = options.floor, options.share, options.rate
    factor = options.weight
    for i in range(count):
        block.log_depth[i] = logarithm(block.depth[i])
        block.log_force[i] = logarithm(block.force[i])
    for i in range(count):
        block.rate[i] = bounded_rate(block.depth[i], block.velocity[i], largest)
    for i in range(count):
        mu = forgetting(block.moved[i], floor, fraction, rate)
        block.memory[i] = mu
        block.inverse_memory[i] = 1.0 / mu
        block.noise[i] = mu
        block.weights[i] = 1.0
    if factor > 0.0:
        for i in range(count):
            weight = weight_of(block.force[i], factor)
            block.weights[i] = weight
            block.noise[i] = block.memory[i] / weight


@compiled(error_model="numpy")
def recur(
    state: State, options: Packed, blocks: NDArray[np.void], count: int, status: NDArray[np.int8], every: Array
) -> bool:
    """Run the recursion over a block; returns whether its last sample restarted it."""
    block, rules = blocks[0], rules_of(options)
    log_scale = options.log_scale
    velocity_factor, rate_factor = options.velocity_factor, options.rate_factor
    theta, p, residuals = read(state.numbers, 0, 1)
    fresh, row = False, 0
    for i in range(count):
        log_depth, velocity = block.log_depth[i], block.velocity[i]
        mu, inverse_mu = block.memory[i], block.inverse_memory[i]
        noise, weight = block.noise[i], block.weights[i]
        if fresh:  # after a restart there is no depth that the sample could have moved from
            mu = forgetting(0.0, options.floor, options.share, options.rate)
            inverse_mu, noise = 1.0 / mu, mu / weight
            fresh = False
        while row < min(block.index[i], every.shape[0]):  # refused samples left theta as it was
            every[row, 0], every[row, 1], every[row, 2], every[row, 3] = theta
            row += 1
        done, theta, p, residuals = learn(
            theta,
            p,
            residuals,
            (log_depth - log_scale, velocity * velocity_factor, block.rate[i] * rate_factor),
            block.log_force[i],
            (mu, inverse_mu, noise),
            rules,
        )
        if done != LEARNT:
            status[block.index[i]] = done
        if done == RESTARTED:
            restart(state, options)
            theta, p, residuals = read(state.numbers, 0, 1)
            fresh = True
            continue
        if done == PERTURBED:
            forget_depths(state)
        count_depth(state, log_depth, velocity, inverse_mu, weight)
    while row < every.shape[0]:
        every[row, 0], every[row, 1], every[row, 2], every[row, 3] = theta
        row += 1
    write(state.numbers, theta, p, residuals)
    return fresh


@entry_point
def run(recordings: NDArray[np.void], samples: Samples, status: NDArray[np.int8], every: Array) -> None:
    """Process all samples of a recording, as `foretouch.identification.linear.sample.update` one after the other."""
    blocks = np.empty(1, _BLOCK)
    state, options = recordings[0].state, recordings[0].options
    depth, velocity, force, in_contact = samples
    for start in range(0, depth.size, BLOCK):
        end = min(start + BLOCK, depth.size)
        part = depth[start:end], velocity[start:end], force[start:end], in_contact[start:end]
        count, last_depth = gather(part, options, state.last_depth, blocks, status[start:end])
        features(blocks, count, options)
        restarted = recur(state, options, blocks, count, status[start:end], every[start:end])
        # A restart forgets the last depth; so does free air after it.
        state.last_depth = np.nan if restarted else last_depth
