"""Equation (20) compiled, one call a sample; the arithmetic is that of `foretouch.identification.linear.kernel`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import config
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, entry_point
from foretouch.identification.linear.kernel import bounded_rate, forgetting, learn, refusal, rules_of, weight_of
from foretouch.identification.linear.options import (
    BIN,
    BINS,
    FIRST_COVARIANCE,
    FIRST_THETA,
    FLOOR,
    FREE_AIR,
    GAIN,
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
from foretouch.identification.linear.recovery import BINS_PER_DECADE, LARGEST_GAIN
from foretouch.identification.linear.recursion import logarithm

Array = NDArray[np.float64]

BINS_PER_LOG = BINS_PER_DECADE / np.log(10.0)

_inlined = compiled(error_model="numpy", forceinline=True)


def _restart(state: Array, options: Array) -> None:
    """Back to theta_0 and P_0, all samples forgotten."""
    state[:] = 0.0
    for i in range(4):
        state[i] = options[FIRST_THETA + i]
    for i in (4, 6, 9, 13):
        state[i] = options[FIRST_COVARIANCE]
    state[LAST_DEPTH] = np.nan
    state[GAIN] = 1.0


restart: Callable[[Array, Array], None] = entry_point(_restart)


def _count_depth(state: Array, log_depth: float, velocity: float, inverse_mu: float, weight: float) -> None:
    """One sample more in the histogram of depths; see `recovery.DepthSummary`."""
    place = int(log_depth * BINS_PER_LOG + BINS)
    place = min(max(place, 0), BINS - 1)
    square = velocity * velocity
    state[GAIN] *= inverse_mu
    state[BIN + place] += state[GAIN] * weight * (square if square < 1e6 else 1e6)
    if state[GAIN] > LARGEST_GAIN:
        for i in range(BINS):
            state[BIN + i] /= state[GAIN]
        state[GAIN] = 1.0


def _forget_depths(state: Array) -> None:
    state[GAIN] = 1.0
    for i in range(BINS):
        state[BIN + i] = 0.0


count_depth: Any = _inlined(_count_depth)
forget_depths: Any = compiled(_forget_depths)


def _update(state: Array, options: Array, depth: float, velocity: float, force: float, in_contact: bool) -> int:
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
        state[LAST_DEPTH] = np.nan
        return FREE_AIR
    refused = refusal(depth, velocity, force, options[GATE_DEPTH], options[GATE_FORCE])
    if refused != LEARNT:
        return refused  # type: ignore[no-any-return]
    moved = abs(depth - state[LAST_DEPTH])
    moved = moved if moved >= 0.0 else 0.0
    state[LAST_DEPTH] = depth
    log_depth = logarithm(depth)
    mu = forgetting(moved, options[FLOOR], options[SHARE], options[RATE])
    weight = weight_of(force, options[WEIGHT])
    inverse_mu = 1.0 / mu
    done, theta, p, residuals = learn(
        (state[0], state[1], state[2], state[3]),
        (
            state[4],
            state[5],
            state[6],
            state[7],
            state[8],
            state[9],
            state[10],
            state[11],
            state[12],
            state[13],
        ),
        (state[RESIDUALS], state[RESIDUALS + 1]),
        (
            log_depth - options[LOG_SCALE],
            velocity * options[VELOCITY_FACTOR],
            bounded_rate(depth, velocity, options[LARGEST_RATE]) * options[RATE_FACTOR],
        ),
        logarithm(force),
        (mu, inverse_mu, mu / weight),
        rules_of(options),
    )
    if done == RESTARTED:
        restart(state, options)
        return RESTARTED
    state[0], state[1], state[2], state[3] = theta
    (
        state[4],
        state[5],
        state[6],
        state[7],
        state[8],
        state[9],
        state[10],
        state[11],
        state[12],
        state[13],
    ) = p
    state[RESIDUALS], state[RESIDUALS + 1] = residuals
    if done == PERTURBED:
        forget_depths(state)
    count_depth(state, log_depth, velocity, inverse_mu, weight)
    return done  # type: ignore[no-any-return]


update: Callable[[Array, Array, float, float, float, bool], int] = entry_point(_update)


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
