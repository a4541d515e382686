r"""Equation (20) on the four unknowns of the linearised law (18), compiled: one call a sample, or one a recording.

Both inline the functions below, which have no choice in how a term is rounded: products and sums as written, never
contracted into fused multiply-adds (Python and other machines would round those differently, and the chain of
dependencies would not be shorter, see `foretouch.bench.peers`), logarithms and exponentials of
`foretouch.identification.linear.recursion`. So both, interpreted too, give the same numbers **to the last bit**, and
restart and perturb at the same samples.

With :math:`h = \mu^{-1} / (\mu / w + \Phi^T P \Phi)`, the only divide by what depends on P, a step is

.. math::
    q = P \Phi, \quad k = h\, q, \quad P \leftarrow \mu^{-1} P - k q^T, \quad \theta \leftarrow \theta + \mu e\, k

P is symmetric: its lower triangle is kept, ten numbers, row by row.
"""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined, kernel
from foretouch.core.records import Record
from foretouch.identification.linear.options import (
    BINS,
    FREE_AIR,
    GATED,
    LEARNT,
    PERTURBED,
    RESTARTED,
    SMALLEST_DEPTH,
    SMALLEST_FORCE,
    UNUSABLE,
    Packed,
    Recording,
    State,
)
from foretouch.identification.linear.recovery import BINS_PER_DECADE
from foretouch.identification.linear.recursion import LARGEST_LOG, LARGEST_TRACE, exponential, logarithm

Array = NDArray[np.float64]

Samples: TypeAlias = tuple[Array, Array, Array, NDArray[np.bool_]]
"""Depth [m], velocity [m/s], force [N] and contact of a recording, shape (m,) each."""

FADED = 40.0  # exp(-40) of the share of mu that fades is no longer a digit of it
BINS_PER_LOG = BINS_PER_DECADE / np.log(10.0)
LARGEST_GAIN = 1e100  # Beyond this gain of the histogram its bins shrink after all: no overflow
BLOCK = 256  # Samples whose features are computed at once: they stay in the first cache
DIAGONAL = (4, 6, 9, 13)  # Places of the diagonal of P in the numbers of a state, of which 4 to 13 are P


@inlined
def weight_of(force: float, factor: float) -> float:
    """(F / weight_force)^2 within 1e-12 and 1e12; 1 where the factor is 0."""
    weight = force * factor
    square = weight * weight
    square = square if square > 1e-12 else 1e-12
    square = square if square < 1e12 else 1e12
    return square if factor > 0.0 else 1.0


@inlined
def bounded_rate(depth: float, velocity: float, largest: float) -> float:
    """Velocity over depth within its bound [1/s]."""
    rate = velocity / depth
    rate = rate if rate > -largest else -largest
    return rate if rate < largest else largest


@inlined
def forgetting(moved: float, floor: float, share: float, rate: float) -> float:
    """The forgetting factor mu after this path [m]."""
    faded = rate * moved
    return floor + share * exponential(-(faded if faded < FADED else FADED))


@inlined
def error_of(target: float, innovation: float, newtons: bool) -> float:
    """What the self-perturbing test sees: the innovation of ln F, or the difference of the forces [N]."""
    if not newtons:
        return innovation
    predicted = target - innovation
    return exponential(target if target < LARGEST_LOG else LARGEST_LOG) - exponential(
        predicted if predicted < LARGEST_LOG else LARGEST_LOG
    )


@compiled(error_model="numpy")
def enlarge(numbers: Array, options: Packed) -> None:
    """P plus delta I, or delta I alone, as far as the limit of the trace allows."""
    keep = 0.0 if options.resetting else 1.0
    for i in range(4, 14):
        numbers[i] *= keep
    room = options.trace_limit - ((numbers[4] + numbers[6]) + (numbers[9] + numbers[13]))
    room = 0.25 * (room if room > 0.0 else 0.0)
    for i in DIAGONAL:
        numbers[i] += room if room < options.perturbation else options.perturbation


@inlined
def learn(
    numbers: Array,
    options: Packed,
    regressor: tuple[float, float, float],
    target: float,
    memory: tuple[float, float, float],
) -> int:
    """One step of (20), in place; the regressor is that without its leading 1, the memory mu, 1 / mu and mu / w.

    Returns:
        LEARNT, PERTURBED, or RESTARTED where the numbers are no longer usable.
    """
    a, b, c = regressor
    mu, inverse_mu, noise = memory
    innovation = target - ((numbers[0] + a * numbers[1]) + (b * numbers[2] + c * numbers[3]))
    error = error_of(target, innovation, options.newtons)
    tripped = (options.perturbation > 0.0) & (options.sensitivity * error * error >= 1.0)
    if tripped & options.before:
        enlarge(numbers, options)
    p00, p10, p11 = numbers[4], numbers[5], numbers[6]
    p20, p21, p22 = numbers[7], numbers[8], numbers[9]
    p30, p31, p32, p33 = numbers[10], numbers[11], numbers[12], numbers[13]
    # Sums in pairs, not in a row: the chain from one covariance to the next is what a step waits for.
    q0 = (p00 + a * p10) + (b * p20 + c * p30)
    q1 = (p10 + a * p11) + (b * p21 + c * p31)
    q2 = (p20 + a * p21) + (b * p22 + c * p32)
    q3 = (p30 + a * p31) + (b * p32 + c * p33)
    spread = ((noise + q0) + a * q1) + (b * q2 + c * q3)
    h = inverse_mu / spread
    k0, k1, k2, k3 = q0 * h, q1 * h, q2 * h, q3 * h
    numbers[4] = p00 * inverse_mu - k0 * q0
    numbers[5] = p10 * inverse_mu - k1 * q0
    numbers[6] = p11 * inverse_mu - k1 * q1
    numbers[7] = p20 * inverse_mu - k2 * q0
    numbers[8] = p21 * inverse_mu - k2 * q1
    numbers[9] = p22 * inverse_mu - k2 * q2
    numbers[10] = p30 * inverse_mu - k3 * q0
    numbers[11] = p31 * inverse_mu - k3 * q1
    numbers[12] = p32 * inverse_mu - k3 * q2
    numbers[13] = p33 * inverse_mu - k3 * q3
    trace = (numbers[4] + numbers[6]) + (numbers[9] + numbers[13])
    if trace > options.trace_limit:  # no more is forgotten than it allows: at most all that mu did is taken back
        factor = options.trace_limit / trace
        for i in range(4, 14):
            numbers[i] *= factor if factor > mu else mu
    if tripped & (not options.before):
        enlarge(numbers, options)
    step = mu * innovation
    numbers[0] += k0 * step
    numbers[1] += k1 * step
    numbers[2] += k2 * step
    numbers[3] += k3 * step
    numbers[14] = mu * numbers[14] + (step * step) * h
    numbers[15] = mu * numbers[15] + 1.0
    # Differences of what is not finite are NaN, and NaN equals nothing.
    finite = ((numbers[0] + numbers[1]) + (numbers[2] + numbers[3])) * 0.0 == 0.0
    sound = (spread > 0.0) & (spread < np.inf) & (trace < LARGEST_TRACE) & finite
    return RESTARTED if not sound else PERTURBED if tripped else LEARNT


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
    for i in DIAGONAL:
        state.numbers[i] = options.first_covariance
    state.last_depth, state.updates = np.nan, 0
    forget_depths(state)


@inlined
def count_depth(state: State, log_depth: float, velocity: float, inverse_mu: float, weight: float) -> None:
    """One sample more in the histogram of depths; see `recovery.recover`."""
    index = int(log_depth * BINS_PER_LOG + BINS)
    index = min(max(index, 0), BINS - 1)
    square = velocity * velocity
    state.gain *= inverse_mu
    state.bins[index] += state.gain * weight * (square if square < 1e6 else 1e6)
    if state.gain > LARGEST_GAIN:
        for k in range(BINS):
            state.bins[k] /= state.gain
        state.gain = 1.0


@inlined
def judge(state: State, options: Packed, sample: tuple[float, float, float, bool]) -> tuple[int, float]:
    """What is to be done with a sample of depth, velocity, force and contact, and how far it has moved [m]."""
    depth, velocity, force, in_contact = sample
    in_range = (depth >= SMALLEST_DEPTH) & (depth < np.inf) & (force >= SMALLEST_FORCE) & (force < np.inf)
    usable = in_range & (velocity - velocity == 0.0)
    shut = (force < options.gate_force) | (depth < options.gate_depth)
    code = FREE_AIR if not in_contact else UNUSABLE if not usable else GATED if shut else LEARNT
    last = state.last_depth
    moved = abs(depth - last)
    state.last_depth = depth if code == LEARNT else np.nan if code == FREE_AIR else last
    return code, moved if moved >= 0.0 else 0.0


@inlined
def features(
    options: Packed, depth: float, velocity: float, force: float, moved: float
) -> tuple[float, float, float, float, float, float]:
    """Ln x, v / x, ln F, weight, mu and 1 / mu; anything of a sample that is refused."""
    mu = forgetting(moved, options.floor, options.share, options.rate)
    rate = bounded_rate(depth, velocity, options.largest_rate)
    return logarithm(depth), rate, logarithm(force), weight_of(force, options.weight), mu, 1.0 / mu


@inlined
def take(state: State, options: Packed, velocity: float, known: tuple[float, float, float, float, float, float]) -> int:
    """Learn from a sample of these `features`; LEARNT, RESTARTED or PERTURBED."""
    log_depth, rate, log_force, weight, mu, inverse_mu = known
    regressor = log_depth - options.log_scale, velocity * options.velocity_factor, rate * options.rate_factor
    done = learn(state.numbers, options, regressor, log_force, (mu, inverse_mu, mu / weight))
    if done == RESTARTED:
        restart(state, options)
        state.restarts += 1
        return RESTARTED
    state.updates += 1
    if done == PERTURBED:
        state.perturbations += 1
        forget_depths(state)
    count_depth(state, log_depth, velocity, inverse_mu, weight)
    return done


@kernel("(Recording[::1], f8, f8, f8, b1)", Recording, error_model="numpy")
def update(recordings: NDArray[np.void], depth: float, velocity: float, force: float, in_contact: bool) -> int:
    """One sample, in place; what was done, LEARNT to PERTURBED."""
    state, options = recordings[0].state, recordings[0].options
    code, moved = judge(state, options, (depth, velocity, force, in_contact))
    if code != LEARNT:
        return code
    return take(state, options, velocity, features(options, depth, velocity, force, moved))


@kernel("(Recording[::1],)", Recording, error_model="numpy")
def begin(recordings: NDArray[np.void]) -> None:
    """Recordings without a sample, at theta_0 and P_0."""
    for index in range(recordings.size):
        state = recordings[index].state
        restart(state, recordings[index].options)
        state.restarts = state.perturbations = 0


class Block(Record):
    """Samples of a block and their `features`, side by side: loops over them become vector instructions."""

    depth: Annotated[NDArray[Any], float, BLOCK]
    velocity: Annotated[NDArray[Any], float, BLOCK]
    force: Annotated[NDArray[Any], float, BLOCK]
    moved: Annotated[NDArray[Any], float, BLOCK]
    log_depth: Annotated[NDArray[Any], float, BLOCK]
    rate: Annotated[NDArray[Any], float, BLOCK]
    log_force: Annotated[NDArray[Any], float, BLOCK]
    weight: Annotated[NDArray[Any], float, BLOCK]
    mu: Annotated[NDArray[Any], float, BLOCK]
    inverse_mu: Annotated[NDArray[Any], float, BLOCK]


_BLOCK = Block.layout


@compiled(error_model="numpy")
def load(
    state: State, options: Packed, blocks: NDArray[np.void], samples: Samples, start: int, status: NDArray[np.int8]
) -> None:
    """`judge` the samples of a block, and compute their features."""
    depth, velocity, force, in_contact = samples
    block, size = blocks[0], min(BLOCK, depth.size - start)
    for i in range(size):
        sample = depth[start + i], velocity[start + i], force[start + i], in_contact[start + i]
        block.depth[i], block.velocity[i], block.force[i], _ = sample
        status[start + i], block.moved[i] = judge(state, options, sample)
    for i in range(size):
        known = features(options, block.depth[i], block.velocity[i], block.force[i], block.moved[i])
        block.log_depth[i], block.rate[i], block.log_force[i], block.weight[i], block.mu[i], block.inverse_mu[i] = known


@kernel(
    "(Recording[::1], Tuple((f8[::1], f8[::1], f8[::1], b1[::1])), i1[::1], f8[:, ::1])",
    Recording,
    allocates=True,
    error_model="numpy",
    nogil=True,
)
def run(recordings: NDArray[np.void], samples: Samples, status: NDArray[np.int8], every: Array) -> None:
    """`update` with all samples of a recording; theta after each goes into the rows that `every` has."""
    state, options = recordings[0].state, recordings[0].options
    blocks = np.empty(1, _BLOCK)
    block = blocks[0]
    for start in range(0, status.size, BLOCK):
        load(state, options, blocks, samples, start, status)
        fresh, last_depth = False, state.last_depth
        for i in range(min(BLOCK, status.size - start)):
            if status[start + i] == LEARNT:
                velocity, mu, inverse_mu = block.velocity[i], block.mu[i], block.inverse_mu[i]
                if fresh:  # after a restart there is no depth that the sample could have moved from
                    mu = forgetting(0.0, options.floor, options.share, options.rate)
                    inverse_mu = 1.0 / mu
                known = block.log_depth[i], block.rate[i], block.log_force[i], block.weight[i], mu, inverse_mu
                status[start + i] = take(state, options, velocity, known)
                fresh = status[start + i] == RESTARTED
            if start + i < every.shape[0]:
                every[start + i] = state.numbers[:4]
        # A restart forgets the depth before it, and none of those after it.
        state.last_depth = np.nan if fresh else last_depth
