"""Equation (20) compiled, one call a sample; the arithmetic is that of `foretouch.identification.linear.kernel`."""

from __future__ import annotations

import numpy as np
from numba import config
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, entry_point, inlined
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
from foretouch.identification.linear.options import BINS, FREE_AIR, LEARNT, PERTURBED, RESTARTED
from foretouch.identification.linear.recovery import BINS_PER_DECADE
from foretouch.identification.linear.recursion import logarithm

Array = NDArray[np.float64]

BINS_PER_LOG = BINS_PER_DECADE / np.log(10.0)

LARGEST_GAIN = 1e100
"""Beyond this gain of the histogram its bins shrink after all: no overflow."""


@entry_point
def restart(state: Array, options: Array) -> None:
    """Back to theta_0 and P_0, all samples forgotten."""
    state[:] = 0.0
    for i in range(4):
        state[i] = options[at.FIRST_THETA + i]
    for i in (4, 6, 9, 13):
        state[i] = options[at.FIRST_COVARIANCE]
    state[at.LAST_DEPTH] = np.nan
    state[at.GAIN] = 1.0


@inlined
def count_depth(state: Array, log_depth: float, velocity: float, inverse_mu: float, weight: float) -> None:
    """One sample more in the histogram of depths; see `recovery.DepthSummary`."""
    place = int(log_depth * BINS_PER_LOG + BINS)
    place = min(max(place, 0), BINS - 1)
    square = velocity * velocity
    state[at.GAIN] *= inverse_mu
    state[at.BIN + place] += state[at.GAIN] * weight * (square if square < 1e6 else 1e6)
    if state[at.GAIN] > LARGEST_GAIN:
        for i in range(BINS):
            state[at.BIN + i] /= state[at.GAIN]
        state[at.GAIN] = 1.0


@compiled
def forget_depths(state: Array) -> None:
    """An empty histogram of depths."""
    state[at.GAIN] = 1.0
    for i in range(BINS):
        state[at.BIN + i] = 0.0


@entry_point
def update(state: Array, options: Array, depth: float, velocity: float, force: float, in_contact: bool) -> int:
    """One sample, in place.

    Args:
        state: Of one recording, shape (STATE_SIZE,); from `restart`.
        options: Shape (OPTIONS_SIZE,).
        depth: [m].
        velocity: [m/s].
        force: [N].
        in_contact: Whether the probe touches.

    Returns:
        What was done, LEARNT to PERTURBED.
    """
    if not in_contact:
        state[at.LAST_DEPTH] = np.nan
        return FREE_AIR
    refused = refusal(depth, velocity, force, options[at.GATE_DEPTH], options[at.GATE_FORCE])
    if refused != LEARNT:
        return refused
    moved = abs(depth - state[at.LAST_DEPTH])
    moved = moved if moved >= 0.0 else 0.0
    state[at.LAST_DEPTH] = depth
    log_depth = logarithm(depth)
    mu = forgetting(moved, options[at.FLOOR], options[at.SHARE], options[at.RATE])
    weight = weight_of(force, options[at.WEIGHT])
    inverse_mu = 1.0 / mu
    theta, p, residuals = read(state, 0, 1)
    done, theta, p, residuals = learn(
        theta,
        p,
        residuals,
        (
            log_depth - options[at.LOG_SCALE],
            velocity * options[at.VELOCITY_FACTOR],
            bounded_rate(depth, velocity, options[at.LARGEST_RATE]) * options[at.RATE_FACTOR],
        ),
        logarithm(force),
        (mu, inverse_mu, mu / weight),
        rules_of(options),
    )
    if done == RESTARTED:
        restart(state, options)
        return RESTARTED
    write(state, theta, p, residuals)
    if done == PERTURBED:
        forget_depths(state)
    count_depth(state, log_depth, velocity, inverse_mu, weight)
    return done


def warm(state: Array, options: Array) -> None:
    """Compile `update`, or load it, before any loop, and let nothing be compiled inside one.

    Numbers of other types, an integer depth for example, are turned into floats from then on.

    Args:
        state: Left as it is, but for its last depth, which is forgotten.
        options: Left as they are.
    """
    update(state, options, 1.0, 0.0, 1.0, False)
    if not config.DISABLE_JIT:
        update.disable_compile()  # type: ignore[attr-defined]
