"""Equation (20) over many independent recordings at once, compiled; the arithmetic is that of `linear.kernel`.

One sample of `LANES` recordings is one loop that becomes vector instructions: what belongs to a recording stands in
rows of one buffer, recordings innermost. There are no branches by sample; what is refused, restarted or perturbed is
selected. Recordings are taken block by block. Serial and parallel are two functions each, for what Numba compiles for
all cores is slower on one.
"""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

import numpy as np
from numba import prange
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, entry_point, inlined
from foretouch.core.records import Record
from foretouch.identification.linear.kernel import bounded_rate, forgetting, learn, read, refusal, rules_of, weight_of
from foretouch.identification.linear.options import LEARNT, PERTURBED, RESTARTED, Packed
from foretouch.identification.linear.recursion import logarithm

Array = NDArray[np.float64]

LANES = 128  # Recordings of a block: their numbers stay in the first cache

RESULT_SIZE = 19
COUNTS = 16
"""Of a recording: theta, triangle of P, two sums of residuals, then samples learnt from since the last restart,
restarts, perturbations."""


class Lanes(Record):
    """One sample of each recording of a block, and what is known of the recording."""

    numbers: Annotated[NDArray[Any], float, RESULT_SIZE * LANES]  # rows of `LANES` numbers each; see `COUNTS`
    last: Annotated[NDArray[Any], float, LANES]  # depth that the next sample moves from [m]
    depth: Annotated[NDArray[Any], float, LANES]
    velocity: Annotated[NDArray[Any], float, LANES]
    force: Annotated[NDArray[Any], float, LANES]
    in_contact: Annotated[NDArray[Any], float, LANES]
    taken: Annotated[NDArray[Any], float, LANES]  # 1 where the sample is learnt from, 2 where that broke P
    log_depth: Annotated[NDArray[Any], float, LANES]
    rate: Annotated[NDArray[Any], float, LANES]
    log_force: Annotated[NDArray[Any], float, LANES]
    memory: Annotated[NDArray[Any], float, LANES]  # mu
    inverse_memory: Annotated[NDArray[Any], float, LANES]
    noise: Annotated[NDArray[Any], float, LANES]  # mu over the weight
    speed: Annotated[NDArray[Any], float, LANES]


_LANES = Lanes.layout


@compiled(error_model="numpy")
def set_first(lanes: Lanes, options: Packed, lane: int) -> None:
    """One lane at theta_0 and P_0, all that it counted forgotten."""
    for i in range(RESULT_SIZE):
        lanes.numbers[i * LANES + lane] = 0.0
    for i in range(4):
        lanes.numbers[i * LANES + lane] = options.first_theta[i]
    for i in (4, 6, 9, 13):
        lanes.numbers[i * LANES + lane] = options.first_covariance
    lanes.last[lane] = np.nan


@compiled(error_model="numpy")
def begin(buffers: NDArray[np.void], options: Packed) -> None:
    """All lanes at theta_0 and P_0, without a sample."""
    lanes = buffers[0]
    buffers.view(np.float64)[:] = 1.0
    lanes.in_contact[:], lanes.taken[:] = 0.0, 0.0
    for lane in range(LANES):
        set_first(lanes, options, lane)


Samples: TypeAlias = tuple[Array, Array, Array, NDArray[np.bool_]]
"""Depth [m], velocity [m/s], force [N] and contact of n recordings, shape (m, n) each."""

Regressors: TypeAlias = tuple[Array, Array, Array, Array, Array]
"""ln x, v, v / x and ln F, in one unit, and forgetting factors mu of n recordings, shape (m, n) each."""


@compiled(error_model="numpy")
def load(lanes: Lanes, samples: Samples, row: int, first: int) -> None:
    """One sample of each recording of a block; lanes beyond the last recording stay in free air."""
    depth, velocity, force, in_contact = samples
    for lane in range(min(LANES, depth.shape[1] - first)):
        lanes.depth[lane] = depth[row, first + lane]
        lanes.velocity[lane] = velocity[row, first + lane]
        lanes.force[lane] = force[row, first + lane]
        lanes.in_contact[lane] = in_contact[row, first + lane]


@inlined
def _features(lanes: Lanes, options: Packed, factor: float) -> None:
    """Logarithms, rates, forgetting factors of one sample of each lane; those of depth 1 m and 1 N where refused."""
    gate_depth, gate_force, largest = options.gate_depth, options.gate_force, options.largest_rate
    floor, weight, rate = options.floor, options.share, options.rate
    log_scale = options.log_scale
    velocity_factor, rate_factor = options.velocity_factor, options.rate_factor
    for lane in range(LANES):
        depth, velocity, force = lanes.depth[lane], lanes.velocity[lane], lanes.force[lane]
        touching = lanes.in_contact[lane] > 0.0
        taken = touching & (refusal(depth, velocity, force, gate_depth, gate_force) == LEARNT)
        last = lanes.last[lane]
        moved = abs(depth - last)
        moved = moved if moved >= 0.0 else 0.0
        last = last if touching else np.nan
        lanes.last[lane] = depth if taken else last
        lanes.taken[lane] = 1.0 if taken else 0.0
        depth, velocity, force = depth if taken else 1.0, velocity if taken else 0.0, force if taken else 1.0
        mu = forgetting(moved, floor, weight, rate)
        lanes.memory[lane] = mu
        lanes.inverse_memory[lane] = 1.0 / mu
        lanes.noise[lane] = mu / weight_of(force, factor)
        lanes.log_depth[lane] = logarithm(depth) - log_scale
        lanes.speed[lane] = velocity * velocity_factor
        lanes.rate[lane] = bounded_rate(depth, velocity, largest) * rate_factor
        lanes.log_force[lane] = logarithm(force)


@inlined
def _recur(lanes: Lanes, rules: Any) -> int:
    """One step of (20) in each lane whose sample is taken; how many broke.

    Those are marked by a `taken` of 2, and left as the step left them.
    """
    numbers, broken = lanes.numbers, 0
    for lane in range(LANES):
        theta, p, residuals = read(numbers, lane, LANES)
        done, theta, p, residuals = learn(
            theta,
            p,
            residuals,
            (lanes.log_depth[lane], lanes.speed[lane], lanes.rate[lane]),
            lanes.log_force[lane],
            (lanes.memory[lane], lanes.inverse_memory[lane], lanes.noise[lane]),
            rules,
        )
        taken = lanes.taken[lane] > 0.0
        numbers[0 * LANES + lane] = theta[0] if taken else numbers[0 * LANES + lane]
        numbers[1 * LANES + lane] = theta[1] if taken else numbers[1 * LANES + lane]
        numbers[2 * LANES + lane] = theta[2] if taken else numbers[2 * LANES + lane]
        numbers[3 * LANES + lane] = theta[3] if taken else numbers[3 * LANES + lane]
        numbers[4 * LANES + lane] = p[0] if taken else numbers[4 * LANES + lane]
        numbers[5 * LANES + lane] = p[1] if taken else numbers[5 * LANES + lane]
        numbers[6 * LANES + lane] = p[2] if taken else numbers[6 * LANES + lane]
        numbers[7 * LANES + lane] = p[3] if taken else numbers[7 * LANES + lane]
        numbers[8 * LANES + lane] = p[4] if taken else numbers[8 * LANES + lane]
        numbers[9 * LANES + lane] = p[5] if taken else numbers[9 * LANES + lane]
        numbers[10 * LANES + lane] = p[6] if taken else numbers[10 * LANES + lane]
        numbers[11 * LANES + lane] = p[7] if taken else numbers[11 * LANES + lane]
        numbers[12 * LANES + lane] = p[8] if taken else numbers[12 * LANES + lane]
        numbers[13 * LANES + lane] = p[9] if taken else numbers[13 * LANES + lane]
        numbers[14 * LANES + lane] = residuals[0] if taken else numbers[14 * LANES + lane]
        numbers[15 * LANES + lane] = residuals[1] if taken else numbers[15 * LANES + lane]
        numbers[16 * LANES + lane] += 1.0 if taken else 0.0
        numbers[18 * LANES + lane] += 1.0 if taken & (done == PERTURBED) else 0.0
        again = taken & (done == RESTARTED)
        lanes.taken[lane] = 2.0 if again else lanes.taken[lane]
        broken += again
    return broken


@compiled(error_model="numpy")
def begin_again(lanes: Lanes, options: Packed) -> None:
    """The lanes that broke, at theta_0 and P_0."""
    numbers = lanes.numbers
    for lane in range(LANES):
        if lanes.taken[lane] == 2.0:
            restarts, trips = numbers[17 * LANES + lane], numbers[18 * LANES + lane]
            set_first(lanes, options, lane)
            numbers[17 * LANES + lane], numbers[18 * LANES + lane] = restarts + 1.0, trips


# Two of each: what equal weights and the printed choices do not need is known to the compiler, and not computed.
@compiled(error_model="numpy")
def _features_weighted(lanes: Lanes, options: Packed) -> None:
    _features(lanes, options, options.weight)


@compiled(error_model="numpy")
def _features_equal(lanes: Lanes, options: Packed) -> None:
    _features(lanes, options, 0.0)


@compiled(error_model="numpy")
def _recur_generally(lanes: Lanes, options: Packed) -> int:
    return _recur(lanes, rules_of(options))


@compiled(error_model="numpy")
def _recur_as_printed(lanes: Lanes, options: Packed) -> int:
    rules = (options.sensitivity, options.perturbation, False, False, False, np.inf)
    return _recur(lanes, rules)


@compiled(error_model="numpy")
def step(lanes: Lanes, options: Packed) -> None:
    """One step of the lanes that take their sample, by the quicker of the two where the options allow it."""
    if options.newtons or options.before or options.resetting or options.trace_limit < np.inf:
        broken = _recur_generally(lanes, options)
    else:
        broken = _recur_as_printed(lanes, options)
    if broken > 0:
        begin_again(lanes, options)


@compiled(error_model="numpy")
def load_regressors(lanes: Lanes, regressors: Regressors, row: int, first: int) -> None:
    """Regressors, target and forgetting factor of one sample of each recording of a block; taken where finite."""
    log_depth, velocity, rate, log_force, memory = regressors
    for lane in range(min(LANES, memory.shape[1] - first)):
        a, b, c = log_depth[row, first + lane], velocity[row, first + lane], rate[row, first + lane]
        target, mu = log_force[row, first + lane], memory[row, first + lane]
        finite = (((a + b) + (c + target)) + mu) * 0.0 == 0.0
        taken = finite & (mu > 0.0) & (mu <= 1.0)
        mu = mu if taken else 1.0
        lanes.log_depth[lane] = a if taken else 0.0
        lanes.speed[lane] = b if taken else 0.0
        lanes.rate[lane] = c if taken else 0.0
        lanes.log_force[lane] = target if taken else 0.0
        lanes.memory[lane] = mu
        lanes.inverse_memory[lane] = 1.0 / mu
        lanes.noise[lane] = mu
        lanes.taken[lane] = 1.0 if taken else 0.0


@compiled(error_model="numpy")
def block(
    buffers: NDArray[np.void], samples: Samples, options: Packed, first: int, result: Array, every: Array
) -> None:
    """All samples of the recordings from `first` on, `LANES` at most."""
    begin(buffers, options)
    lanes = buffers[0]
    width = min(LANES, samples[0].shape[1] - first)
    for row in range(samples[0].shape[0]):
        load(lanes, samples, row, first)
        if options.weight == 0.0:
            _features_equal(lanes, options)
        else:
            _features_weighted(lanes, options)
        step(lanes, options)
        if row < every.shape[0]:
            for i in range(4):
                every[row, i, first : first + width] = lanes.numbers[i * LANES : i * LANES + width]
    for i in range(RESULT_SIZE):
        result[i, first : first + width] = lanes.numbers[i * LANES : i * LANES + width]


@compiled(error_model="numpy")
def block_of_regressors(
    buffers: NDArray[np.void], regressors: Regressors, options: Packed, first: int, result: Array
) -> None:
    """`block` of regressors that are known."""
    begin(buffers, options)
    lanes = buffers[0]
    width = min(LANES, regressors[0].shape[1] - first)
    for row in range(regressors[0].shape[0]):
        load_regressors(lanes, regressors, row, first)
        step(lanes, options)
    for i in range(RESULT_SIZE):
        result[i, first : first + width] = lanes.numbers[i * LANES : i * LANES + width]


@entry_point
def run_serial(samples: Samples, options: NDArray[np.void], result: Array, every: Array) -> None:
    """All samples of n recordings, each from the beginning.

    Args:
        samples: Of all.
        options: Of all, an array of one `Packed`.
        result: Filled, shape (RESULT_SIZE, n); see `COUNTS`.
        every: Theta after each sample, filled, shape (m, 4, n); or left alone, shape (0, 4, n).
    """
    buffers = np.empty(1, _LANES)
    for first in range(0, samples[0].shape[1], LANES):
        block(buffers, samples, options[0], first, result, every)


@entry_point(parallel=True)
def run_parallel(samples: Samples, options: NDArray[np.void], result: Array, every: Array) -> None:
    """The same on all cores."""
    for number in prange((samples[0].shape[1] + LANES - 1) // LANES):
        buffers = np.empty(1, _LANES)
        block(buffers, samples, options[0], number * LANES, result, every)


@entry_point
def regressors_serial(regressors: Regressors, options: NDArray[np.void], result: Array) -> None:
    """As `run_serial`, of regressors that are known."""
    buffers = np.empty(1, _LANES)
    for first in range(0, regressors[0].shape[1], LANES):
        block_of_regressors(buffers, regressors, options[0], first, result)


@entry_point(parallel=True)
def regressors_parallel(regressors: Regressors, options: NDArray[np.void], result: Array) -> None:
    """The same on all cores."""
    for number in prange((regressors[0].shape[1] + LANES - 1) // LANES):
        buffers = np.empty(1, _LANES)
        block_of_regressors(buffers, regressors, options[0], number * LANES, result)
