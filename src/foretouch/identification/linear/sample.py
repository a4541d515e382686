"""Equation (20) compiled, one call a sample; the arithmetic is that of `foretouch.identification.linear.kernel`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.core import compiled, kernel
from foretouch.core.compiling import inlined
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
from foretouch.identification.linear.options import (
    BINS,
    FREE_AIR,
    LEARNT,
    PERTURBED,
    RESTARTED,
    Packed,
    Recording,
    State,
)
from foretouch.identification.linear.recovery import BINS_PER_DECADE
from foretouch.identification.linear.recursion import logarithm

Array = NDArray[np.float64]

BINS_PER_LOG = BINS_PER_DECADE / np.log(10.0)

LARGEST_GAIN = 1e100  # Beyond this gain of the histogram its bins shrink after all: no overflow


@compiled
def forget_depths(state: State) -> None:
    """An empty histogram of depths."""
    state.gain = 1.0
    state.bins[:] = 0.0


@compiled
def restart(state: State, options: Packed) -> None:
    """Back to theta_0 and P_0, all samples forgotten."""
    state.numbers[:] = 0.0
    for i in range(4):
        state.numbers[i] = options.first_theta[i]
    for i in (4, 6, 9, 13):
        state.numbers[i] = options.first_covariance
    state.last_depth = np.nan
    forget_depths(state)


@inlined
def count_depth(state: State, log_depth: float, velocity: float, inverse_mu: float, weight: float) -> None:
    """One sample more in the histogram of depths; see `recovery.DepthSummary`."""
    index = int(log_depth * BINS_PER_LOG + BINS)
    index = min(max(index, 0), BINS - 1)
    square = velocity * velocity
    state.gain *= inverse_mu
    state.bins[index] += state.gain * weight * (square if square < 1e6 else 1e6)
    if state.gain > LARGEST_GAIN:
        for i in range(BINS):
            state.bins[i] /= state.gain
        state.gain = 1.0


@kernel("(Recording[::1], f8, f8, f8, b1)", Recording, error_model="numpy")
def update(recordings: NDArray[np.void], depth: float, velocity: float, force: float, in_contact: bool) -> int:
    """One sample, in place.

    Returns:
        What was done, LEARNT to PERTURBED.
    """
    state, options = recordings[0].state, recordings[0].options
    if not in_contact:
        state.last_depth = np.nan
        return FREE_AIR
    refused = refusal(depth, velocity, force, options.gate_depth, options.gate_force)
    if refused != LEARNT:
        return refused
    moved = abs(depth - state.last_depth)
    moved = moved if moved >= 0.0 else 0.0
    state.last_depth = depth
    log_depth = logarithm(depth)
    mu = forgetting(moved, options.floor, options.share, options.rate)
    weight = weight_of(force, options.weight)
    inverse_mu = 1.0 / mu
    theta, p, residuals = read(state.numbers, 0, 1)
    done, theta, p, residuals = learn(
        theta,
        p,
        residuals,
        (
            log_depth - options.log_scale,
            velocity * options.velocity_factor,
            bounded_rate(depth, velocity, options.largest_rate) * options.rate_factor,
        ),
        logarithm(force),
        (mu, inverse_mu, mu / weight),
        rules_of(options),
    )
    if done == RESTARTED:
        restart(state, options)
        return RESTARTED
    write(state.numbers, theta, p, residuals)
    if done == PERTURBED:
        forget_depths(state)
    count_depth(state, log_depth, velocity, inverse_mu, weight)
    return done


@kernel("(Recording[::1],)", Recording, error_model="numpy")
def begin(recordings: NDArray[np.void]) -> None:
    """Back to theta_0 and P_0, all samples forgotten."""
    restart(recordings[0].state, recordings[0].options)
