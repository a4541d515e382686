"""Equation (20) over many independent recordings at once, compiled; the arithmetic is that of `linear.kernel`.

One sample of `LANES` recordings is one loop that becomes vector instructions: what belongs to a recording stands in
rows of one buffer, recordings innermost. There are no branches by sample; what is refused, restarted or perturbed is
selected. Recordings are taken block by block. Serial and parallel are two functions each, for what Numba compiles for
all cores is slower on one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, entry_point, inlined
from foretouch.identification.linear import options as at
from foretouch.identification.linear.kernel import bounded_rate, forgetting, learn, read, refusal, rules_of, weight_of
from foretouch.identification.linear.options import LEARNT, PERTURBED, RESTARTED
from foretouch.identification.linear.recursion import logarithm

Array = NDArray[np.float64]

LANES = 128
"""Recordings of a block: their numbers stay in the first cache."""

RESULT_SIZE = 19
COUNTS = 16
"""Of a recording: theta, triangle of P, two sums of residuals, then samples learnt from since the last restart,
restarts, perturbations. One row of the buffer each, by the same numbers; further rows follow."""

LAST = 19 * LANES  # depth that the next sample moves from
IN_DEPTH, IN_VELOCITY, IN_FORCE, IN_CONTACT = 20 * LANES, 21 * LANES, 22 * LANES, 23 * LANES
TAKEN = 24 * LANES  # 1 where the sample is learnt from
LOG_DEPTH, RATE_SEEN, LOG_FORCE = 25 * LANES, 26 * LANES, 27 * LANES
MEMORY, INVERSE_MEMORY, NOISE, SPEED = 28 * LANES, 29 * LANES, 30 * LANES, 31 * LANES
BUFFER = 32 * LANES


@compiled(error_model="numpy")
def set_first(buffer: Array, options: Array, lane: int) -> None:
    """One lane at theta_0 and P_0, all that it counted forgotten."""
    for i in range(RESULT_SIZE):
        buffer[i * LANES + lane] = 0.0
    for i in range(4):
        buffer[i * LANES + lane] = options[at.FIRST_THETA + i]
    for i in (4, 6, 9, 13):
        buffer[i * LANES + lane] = options[at.FIRST_COVARIANCE]
    buffer[LAST + lane] = np.nan


@compiled(error_model="numpy")
def begin(buffer: Array, options: Array) -> None:
    """All lanes at theta_0 and P_0."""
    buffer[:LOG_DEPTH] = 0.0
    buffer[LOG_DEPTH:] = 1.0
    for lane in range(LANES):
        set_first(buffer, options, lane)


@compiled(error_model="numpy")
def load(
    buffer: Array, depth: Array, velocity: Array, force: Array, in_contact: NDArray[np.bool_], row: int, first: int
) -> None:
    """One sample of each recording of a block; lanes beyond the last recording stay in free air."""
    for lane in range(min(LANES, depth.shape[1] - first)):
        buffer[IN_DEPTH + lane] = depth[row, first + lane]
        buffer[IN_VELOCITY + lane] = velocity[row, first + lane]
        buffer[IN_FORCE + lane] = force[row, first + lane]
        buffer[IN_CONTACT + lane] = in_contact[row, first + lane]


@inlined
def _features(buffer: Array, options: Array, factor: float) -> None:
    """Logarithms, rates, forgetting factors of one sample of each lane; those of depth 1 m and 1 N where refused."""
    gate_depth, gate_force, largest = options[at.GATE_DEPTH], options[at.GATE_FORCE], options[at.LARGEST_RATE]
    floor, share, rate = options[at.FLOOR], options[at.SHARE], options[at.RATE]
    log_scale = options[at.LOG_SCALE]
    velocity_factor, rate_factor = options[at.VELOCITY_FACTOR], options[at.RATE_FACTOR]
    for lane in range(LANES):
        depth, velocity, force = buffer[IN_DEPTH + lane], buffer[IN_VELOCITY + lane], buffer[IN_FORCE + lane]
        touching = buffer[IN_CONTACT + lane] > 0.0
        taken = touching & (refusal(depth, velocity, force, gate_depth, gate_force) == LEARNT)
        last = buffer[LAST + lane]
        moved = abs(depth - last)
        moved = moved if moved >= 0.0 else 0.0
        last = last if touching else np.nan
        buffer[LAST + lane] = depth if taken else last
        buffer[TAKEN + lane] = 1.0 if taken else 0.0
        depth, velocity, force = depth if taken else 1.0, velocity if taken else 0.0, force if taken else 1.0
        mu = forgetting(moved, floor, share, rate)
        buffer[MEMORY + lane] = mu
        buffer[INVERSE_MEMORY + lane] = 1.0 / mu
        buffer[NOISE + lane] = mu / weight_of(force, factor)
        buffer[LOG_DEPTH + lane] = logarithm(depth) - log_scale
        buffer[SPEED + lane] = velocity * velocity_factor
        buffer[RATE_SEEN + lane] = bounded_rate(depth, velocity, largest) * rate_factor
        buffer[LOG_FORCE + lane] = logarithm(force)


@inlined
def _recur(buffer: Array, rules: Any) -> int:
    """One step of (20) in each lane whose sample is taken; how many broke.

    Those are marked by a `TAKEN` of 2, and left as the step left them.
    """
    broken = 0
    for lane in range(LANES):
        theta, p, residuals = read(buffer, lane, LANES)
        done, theta, p, residuals = learn(
            theta,
            p,
            residuals,
            (buffer[LOG_DEPTH + lane], buffer[SPEED + lane], buffer[RATE_SEEN + lane]),
            buffer[LOG_FORCE + lane],
            (buffer[MEMORY + lane], buffer[INVERSE_MEMORY + lane], buffer[NOISE + lane]),
            rules,
        )
        taken = buffer[TAKEN + lane] > 0.0
        buffer[0 * LANES + lane] = theta[0] if taken else buffer[0 * LANES + lane]
        buffer[1 * LANES + lane] = theta[1] if taken else buffer[1 * LANES + lane]
        buffer[2 * LANES + lane] = theta[2] if taken else buffer[2 * LANES + lane]
        buffer[3 * LANES + lane] = theta[3] if taken else buffer[3 * LANES + lane]
        buffer[4 * LANES + lane] = p[0] if taken else buffer[4 * LANES + lane]
        buffer[5 * LANES + lane] = p[1] if taken else buffer[5 * LANES + lane]
        buffer[6 * LANES + lane] = p[2] if taken else buffer[6 * LANES + lane]
        buffer[7 * LANES + lane] = p[3] if taken else buffer[7 * LANES + lane]
        buffer[8 * LANES + lane] = p[4] if taken else buffer[8 * LANES + lane]
        buffer[9 * LANES + lane] = p[5] if taken else buffer[9 * LANES + lane]
        buffer[10 * LANES + lane] = p[6] if taken else buffer[10 * LANES + lane]
        buffer[11 * LANES + lane] = p[7] if taken else buffer[11 * LANES + lane]
        buffer[12 * LANES + lane] = p[8] if taken else buffer[12 * LANES + lane]
        buffer[13 * LANES + lane] = p[9] if taken else buffer[13 * LANES + lane]
        buffer[14 * LANES + lane] = residuals[0] if taken else buffer[14 * LANES + lane]
        buffer[15 * LANES + lane] = residuals[1] if taken else buffer[15 * LANES + lane]
        buffer[16 * LANES + lane] += 1.0 if taken else 0.0
        buffer[18 * LANES + lane] += 1.0 if taken & (done == PERTURBED) else 0.0
        again = taken & (done == RESTARTED)
        buffer[TAKEN + lane] = 2.0 if again else buffer[TAKEN + lane]
        broken += again
    return broken


@compiled(error_model="numpy")
def begin_again(buffer: Array, options: Array) -> None:
    """The lanes that broke, at theta_0 and P_0."""
    for lane in range(LANES):
        if buffer[TAKEN + lane] == 2.0:
            restarts, trips = buffer[17 * LANES + lane], buffer[18 * LANES + lane]
            set_first(buffer, options, lane)
            buffer[17 * LANES + lane], buffer[18 * LANES + lane] = restarts + 1.0, trips


# Two of each: what equal weights and the printed choices do not need is known to the compiler, and not computed.
@compiled(error_model="numpy")
def _features_weighted(buffer: Array, options: Array) -> None:
    _features(buffer, options, options[at.WEIGHT])


@compiled(error_model="numpy")
def _features_equal(buffer: Array, options: Array) -> None:
    _features(buffer, options, 0.0)


@compiled(error_model="numpy")
def _recur_generally(buffer: Array, options: Array) -> int:
    return _recur(buffer, rules_of(options))


@compiled(error_model="numpy")
def _recur_as_printed(buffer: Array, options: Array) -> int:
    rules = (options[at.SENSITIVITY], options[at.PERTURBATION], False, False, False, np.inf)
    return _recur(buffer, rules)


@compiled(error_model="numpy")
def step(buffer: Array, options: Array) -> None:
    """One step of the lanes that take their sample, by the quicker of the two where the options allow it."""
    choices = options[at.NEWTONS] + options[at.BEFORE] + options[at.RESETTING]
    if choices > 0.0 or options[at.TRACE_LIMIT] < np.inf:
        broken = _recur_generally(buffer, options)
    else:
        broken = _recur_as_printed(buffer, options)
    if broken > 0:
        begin_again(buffer, options)


@compiled(error_model="numpy")
def load_regressors(
    buffer: Array, log_depth: Array, velocity: Array, rate: Array, log_force: Array, memory: Array, row: int, first: int
) -> None:
    """Regressors, target and forgetting factor of one sample of each recording of a block; taken where finite."""
    for lane in range(min(LANES, memory.shape[1] - first)):
        a, b, c = log_depth[row, first + lane], velocity[row, first + lane], rate[row, first + lane]
        target, mu = log_force[row, first + lane], memory[row, first + lane]
        finite = (((a + b) + (c + target)) + mu) * 0.0 == 0.0
        taken = finite & (mu > 0.0) & (mu <= 1.0)
        mu = mu if taken else 1.0
        buffer[LOG_DEPTH + lane] = a if taken else 0.0
        buffer[SPEED + lane] = b if taken else 0.0
        buffer[RATE_SEEN + lane] = c if taken else 0.0
        buffer[LOG_FORCE + lane] = target if taken else 0.0
        buffer[MEMORY + lane] = mu
        buffer[INVERSE_MEMORY + lane] = 1.0 / mu
        buffer[NOISE + lane] = mu
        buffer[TAKEN + lane] = 1.0 if taken else 0.0


@compiled(error_model="numpy")
def block(
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    options: Array,
    first: int,
    result: Array,
    every: Array,
) -> None:
    """All samples of the recordings from `first` on, `LANES` at most."""
    buffer = np.empty(BUFFER)
    begin(buffer, options)
    width = min(LANES, depth.shape[1] - first)
    for row in range(depth.shape[0]):
        load(buffer, depth, velocity, force, in_contact, row, first)
        if options[at.WEIGHT] == 0.0:
            _features_equal(buffer, options)
        else:
            _features_weighted(buffer, options)
        step(buffer, options)
        if row < every.shape[0]:
            for i in range(4):
                every[row, i, first : first + width] = buffer[i * LANES : i * LANES + width]
    for i in range(RESULT_SIZE):
        result[i, first : first + width] = buffer[i * LANES : i * LANES + width]


@compiled(error_model="numpy")
def block_of_regressors(
    log_depth: Array,
    velocity: Array,
    rate: Array,
    log_force: Array,
    memory: Array,
    options: Array,
    first: int,
    result: Array,
) -> None:
    """`block` of regressors that are known."""
    buffer = np.empty(BUFFER)
    begin(buffer, options)
    width = min(LANES, memory.shape[1] - first)
    for row in range(memory.shape[0]):
        load_regressors(buffer, log_depth, velocity, rate, log_force, memory, row, first)
        step(buffer, options)
    for i in range(RESULT_SIZE):
        result[i, first : first + width] = buffer[i * LANES : i * LANES + width]


@entry_point
def run_serial(
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    options: Array,
    result: Array,
    every: Array,
) -> None:
    """All samples of n recordings, each from the beginning.

    Args:
        depth: [m], shape (m, n).
        velocity: [m/s], shape (m, n).
        force: [N], shape (m, n).
        in_contact: Shape (m, n).
        options: Of all, shape (OPTIONS_SIZE,).
        result: Filled, shape (RESULT_SIZE, n); see `COUNTS`.
        every: Theta after each sample, filled, shape (m, 4, n); or left alone, shape (0, 4, n).
    """
    for first in range(0, depth.shape[1], LANES):
        block(depth, velocity, force, in_contact, options, first, result, every)


@entry_point(parallel=True)
def run_parallel(
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    options: Array,
    result: Array,
    every: Array,
) -> None:
    """The same on all cores."""
    for number in prange((depth.shape[1] + LANES - 1) // LANES):
        block(depth, velocity, force, in_contact, options, number * LANES, result, every)


@entry_point
def regressors_serial(
    log_depth: Array, velocity: Array, rate: Array, log_force: Array, memory: Array, options: Array, result: Array
) -> None:
    """As `run_serial`, of regressors that are known.

    Args:
        log_depth: ln x, in the unit of the regressors as all of these, shape (m, n).
        velocity: v, shape (m, n).
        rate: v / x, shape (m, n).
        log_force: ln F, shape (m, n).
        memory: Forgetting factors mu, shape (m, n).
        options: Of all, shape (OPTIONS_SIZE,).
        result: Filled, shape (RESULT_SIZE, n).
    """
    for first in range(0, memory.shape[1], LANES):
        block_of_regressors(log_depth, velocity, rate, log_force, memory, options, first, result)


@entry_point(parallel=True)
def regressors_parallel(
    log_depth: Array, velocity: Array, rate: Array, log_force: Array, memory: Array, options: Array, result: Array
) -> None:
    """The same on all cores."""
    for number in prange((memory.shape[1] + LANES - 1) // LANES):
        block_of_regressors(log_depth, velocity, rate, log_force, memory, options, number * LANES, result)
