r"""Equation (20) on the four unknowns of the linearised law, compiled: one sample of one recording.

The one place of the arithmetic. One call a sample (`update`), a whole recording (`fprls_recording`) and many
recordings at once (`fprls_batch`) inline the functions below, which have no choice in how a term is rounded: products
and sums as written, never contracted into fused multiply-adds (Python and other machines would round those
differently, and the chain of dependencies would not be shorter, see `fprls_bound`), logarithms and exponentials of
`elementary`. So all paths, interpreted ones too, give the same numbers **to the last bit**, and restart and perturb at
the same samples.

With :math:`h = \mu^{-1} / (\mu / w + \Phi^T P \Phi)`, the only divide by what depends on P, a step is

.. math::
    q = P \Phi, \quad k = h\, q, \quad P \leftarrow \mu^{-1} P - k q^T, \quad \theta \leftarrow \theta + \mu e\, k

P is symmetric: its lower triangle is kept, ten numbers, row by row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foretouch.identification.elementary import exponential, logarithm
from foretouch.identification.recovery import BINS_PER_DECADE, DECADES, LARGEST_GAIN
from foretouch.identification.recursion import LARGEST_LOG, LARGEST_TRACE
from foretouch.identification.robust import SMALLEST_DEPTH, SMALLEST_FORCE

__all__ = [
    "BINS",
    "CORE_SIZE",
    "FREE_AIR",
    "GATED",
    "LEARNT",
    "OPTIONS_SIZE",
    "PERTURBED",
    "RESTARTED",
    "STATE_SIZE",
    "UNUSABLE",
    "Triangle",
    "full_covariance",
    "restart",
    "update",
]

Array = NDArray[np.float64]
Four = tuple[float, float, float, float]
Triangle = tuple[float, float, float, float, float, float, float, float, float, float]

LEARNT, FREE_AIR, UNUSABLE, GATED, RESTARTED, PERTURBED = range(6)
"""What was done with a sample; the last one learnt from it too."""

# The state of one recording: theta is 0 to 3, the triangle of P 4 to 13.
RESIDUALS = 14  # sum of the squared residuals, and of their weights
LAST_DEPTH = 16  # of the newest sample that was not refused [m], NaN after free air
CORE_SIZE = 17
GAIN = 17  # what a new sample weighs in the histogram of depths; grows instead of shrinking all bins
BIN = 18
BINS = BINS_PER_DECADE * DECADES
STATE_SIZE = BIN + BINS

# The options of one recording, in the units of the regressors.
LOG_SCALE = 0  # ln of the depth that regressors are measured by
VELOCITY_FACTOR, RATE_FACTOR = 1, 2  # what v and v / x are multiplied by
LARGEST_RATE = 3  # [1/s], inf for none
FLOOR, SHARE, RATE = 4, 5, 6  # mu = floor + share exp(-rate dx)
GATE_FORCE, GATE_DEPTH = 7, 8
WEIGHT = 9  # 1 / weight_force [1/N], 0 for equal weights
SENSITIVITY, PERTURBATION = 10, 11
NEWTONS, BEFORE, RESETTING = 12, 13, 14  # 1 or 0
TRACE_LIMIT = 15
FIRST_THETA, FIRST_COVARIANCE = 16, 20
OPTIONS_SIZE = 21

FADED = 40.0
"""exp(-40) of the share of mu that fades is no longer a digit of it."""

BINS_PER_LOG = BINS_PER_DECADE / np.log(10.0)


def full_covariance(triangle: Array) -> Array:
    """P of its lower triangle, shape (10, ...), row by row: shape (4, 4, ...)."""
    rows, columns = np.tril_indices(4)
    covariance = np.empty((4, 4, *triangle.shape[1:]))
    covariance[rows, columns] = covariance[columns, rows] = triangle
    return covariance


_inlined: Callable[[Any], Any] = njit(cache=True, error_model="numpy", forceinline=True)


def _refusal(depth: float, velocity: float, force: float, gate_depth: float, gate_force: float) -> int:
    """LEARNT, UNUSABLE or GATED, of a sample in contact."""
    usable = (
        (depth >= SMALLEST_DEPTH)
        & (depth < np.inf)
        & (force >= SMALLEST_FORCE)
        & (force < np.inf)
        & (velocity - velocity == 0.0)
    )
    shut = (force < gate_force) | (depth < gate_depth)
    return UNUSABLE if not usable else GATED if shut else LEARNT


def _weight_of(force: float, factor: float) -> float:
    """(F / weight_force)^2 within 1e-12 and 1e12; 1 where the factor is 0."""
    share = force * factor
    square = share * share
    square = square if square > 1e-12 else 1e-12
    square = square if square < 1e12 else 1e12
    return square if factor > 0.0 else 1.0


def _bounded_rate(depth: float, velocity: float, largest: float) -> float:
    """Velocity over depth within its bound [1/s]."""
    rate = velocity / depth
    rate = rate if rate > -largest else -largest
    return rate if rate < largest else largest


def _forgetting(moved: float, floor: float, share: float, rate: float) -> float:
    """The forgetting factor mu after this path [m]."""
    faded = rate * moved
    return floor + share * exponential(-(faded if faded < FADED else FADED))


refusal: Any = _inlined(_refusal)
weight_of: Any = _inlined(_weight_of)
bounded_rate: Any = _inlined(_bounded_rate)
forgetting: Any = _inlined(_forgetting)


def _enlarge(p: Triangle, perturbation: float, resetting: bool, limit: float) -> Triangle:
    """P plus delta I, or delta I alone, as far as the limit of the trace allows."""
    p00, p10, p11, p20, p21, p22, p30, p31, p32, p33 = p
    keep = 0.0 if resetting else 1.0
    p00, p11, p22, p33 = keep * p00, keep * p11, keep * p22, keep * p33
    room = limit - ((p00 + p11) + (p22 + p33))
    room = 0.25 * (room if room > 0.0 else 0.0)
    more = room if room < perturbation else perturbation
    return (
        p00 + more,
        keep * p10,
        p11 + more,
        keep * p20,
        keep * p21,
        p22 + more,
        keep * p30,
        keep * p31,
        keep * p32,
        p33 + more,
    )


enlarge: Any = _inlined(_enlarge)


def _error_of(target: float, innovation: float, newtons: bool) -> float:
    """What the self-perturbing test sees: the innovation of ln F, or the difference of the forces [N]."""
    if not newtons:
        return innovation
    predicted = target - innovation
    return exponential(target if target < LARGEST_LOG else LARGEST_LOG) - exponential(
        predicted if predicted < LARGEST_LOG else LARGEST_LOG
    )


error_of: Any = _inlined(_error_of)


def _shortened(p: Triangle, trace: float, mu: float, limit: float) -> Triangle:
    """P of which no more was forgotten than the limit of its trace allows: at most all that mu did is taken back."""
    factor = limit / trace
    factor = factor if factor > mu else mu
    p00, p10, p11, p20, p21, p22, p30, p31, p32, p33 = p
    return (
        p00 * factor,
        p10 * factor,
        p11 * factor,
        p20 * factor,
        p21 * factor,
        p22 * factor,
        p30 * factor,
        p31 * factor,
        p32 * factor,
        p33 * factor,
    )


shortened: Any = _inlined(_shortened)


def _learn(
    theta: Four,
    p: Triangle,
    residuals: tuple[float, float],
    regressor: tuple[float, float, float],
    target: float,
    memory: tuple[float, float, float],
    rules: tuple[float, float, bool, bool, bool, float],
) -> tuple[int, Four, Triangle, tuple[float, float]]:
    """One step of (20); the regressor is that without its leading 1, the memory mu, 1 / mu and mu / w.

    Returns:
        LEARNT, PERTURBED, or RESTARTED where the numbers are no longer usable; then theta, P and residuals.
    """
    t0, t1, t2, t3 = theta
    a, b, c = regressor
    mu, inverse_mu, noise = memory
    sensitivity, perturbation, newtons, before, resetting, limit = rules
    innovation = target - ((t0 + a * t1) + (b * t2 + c * t3))
    error = error_of(target, innovation, newtons)
    tripped = (perturbation > 0.0) & (sensitivity * error * error >= 1.0)
    if tripped & before:
        p = enlarge(p, perturbation, resetting, limit)
    p00, p10, p11, p20, p21, p22, p30, p31, p32, p33 = p
    # Sums in pairs, not in a row: the chain from one covariance to the next is what a step waits for.
    q0 = (p00 + a * p10) + (b * p20 + c * p30)
    q1 = (p10 + a * p11) + (b * p21 + c * p31)
    q2 = (p20 + a * p21) + (b * p22 + c * p32)
    q3 = (p30 + a * p31) + (b * p32 + c * p33)
    spread = ((noise + q0) + a * q1) + (b * q2 + c * q3)
    h = inverse_mu / spread
    k0, k1, k2, k3 = q0 * h, q1 * h, q2 * h, q3 * h
    p = (
        p00 * inverse_mu - k0 * q0,
        p10 * inverse_mu - k1 * q0,
        p11 * inverse_mu - k1 * q1,
        p20 * inverse_mu - k2 * q0,
        p21 * inverse_mu - k2 * q1,
        p22 * inverse_mu - k2 * q2,
        p30 * inverse_mu - k3 * q0,
        p31 * inverse_mu - k3 * q1,
        p32 * inverse_mu - k3 * q2,
        p33 * inverse_mu - k3 * q3,
    )
    trace = (p[0] + p[2]) + (p[5] + p[9])
    if trace > limit:
        p = shortened(p, trace, mu, limit)
    if tripped & (not before):
        p = enlarge(p, perturbation, resetting, limit)
    step = mu * innovation
    t0, t1, t2, t3 = t0 + k0 * step, t1 + k1 * step, t2 + k2 * step, t3 + k3 * step
    squares = mu * residuals[0] + (step * step) * h
    count = mu * residuals[1] + 1.0
    # Differences of what is not finite are NaN, and NaN equals nothing.
    finite = ((t0 + t1) + (t2 + t3)) * 0.0 == 0.0
    sound = (spread > 0.0) & (spread < np.inf) & (trace < LARGEST_TRACE) & finite
    done = RESTARTED if not sound else PERTURBED if tripped else LEARNT
    return done, (t0, t1, t2, t3), p, (squares, count)


learn: Any = _inlined(_learn)


def _rules_of(options: Array) -> tuple[float, float, bool, bool, bool, float]:
    return (
        options[SENSITIVITY],
        options[PERTURBATION],
        options[NEWTONS] > 0.0,
        options[BEFORE] > 0.0,
        options[RESETTING] > 0.0,
        options[TRACE_LIMIT],
    )


rules_of: Any = _inlined(_rules_of)


def _restart(state: Array, options: Array) -> None:
    """Back to theta_0 and P_0, all samples forgotten."""
    state[:] = 0.0
    for i in range(4):
        state[i] = options[FIRST_THETA + i]
    for i in (4, 6, 9, 13):
        state[i] = options[FIRST_COVARIANCE]
    state[LAST_DEPTH] = np.nan
    state[GAIN] = 1.0


restart: Callable[[Array, Array], None] = njit(cache=True, error_model="numpy")(_restart)


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
forget_depths: Any = njit(cache=True)(_forget_depths)


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


update: Callable[[Array, Array, float, float, float, bool], int] = njit(cache=True, error_model="numpy")(_update)
