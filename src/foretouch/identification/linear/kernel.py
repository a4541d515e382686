r"""Equation (20) on the four unknowns of the linearised law, compiled: what is made of a sample, and how it is learnt.

The one place of the arithmetic. One call a sample (`foretouch.identification.linear.sample`), a whole recording
(`foretouch.identification.linear.recording`) and many recordings at once (`foretouch.identification.linear.lanes`)
inline the functions below, which have no choice in how a term is rounded: products and sums as written, never
contracted into fused multiply-adds (Python and other machines would round those differently, and the chain of
dependencies would not be shorter, see `foretouch.bench.peers`), logarithms and exponentials of
`foretouch.identification.linear.recursion`. So all paths, interpreted ones too, give the same numbers **to the last
bit**, and restart and perturb at the same samples.

With :math:`h = \mu^{-1} / (\mu / w + \Phi^T P \Phi)`, the only divide by what depends on P, a step is

.. math::
    q = P \Phi, \quad k = h\, q, \quad P \leftarrow \mu^{-1} P - k q^T, \quad \theta \leftarrow \theta + \mu e\, k

P is symmetric: its lower triangle is kept, ten numbers, row by row.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import inlined
from foretouch.identification.linear.options import (
    GATED,
    LEARNT,
    PERTURBED,
    RESTARTED,
    SMALLEST_DEPTH,
    SMALLEST_FORCE,
    UNUSABLE,
    Packed,
)
from foretouch.identification.linear.recursion import LARGEST_LOG, LARGEST_TRACE, exponential

FADED = 40.0  # exp(-40) of the share of mu that fades is no longer a digit of it


@inlined
def refusal(depth: float, velocity: float, force: float, gate_depth: float, gate_force: float) -> int:
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


Array = NDArray[np.float64]
Four = tuple[float, float, float, float]
Triangle = tuple[float, float, float, float, float, float, float, float, float, float]


@inlined
def enlarge(p: Triangle, perturbation: float, resetting: bool, limit: float) -> Triangle:
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


@inlined
def error_of(target: float, innovation: float, newtons: bool) -> float:
    """What the self-perturbing test sees: the innovation of ln F, or the difference of the forces [N]."""
    if not newtons:
        return innovation
    predicted = target - innovation
    return exponential(target if target < LARGEST_LOG else LARGEST_LOG) - exponential(
        predicted if predicted < LARGEST_LOG else LARGEST_LOG
    )


@inlined
def shortened(p: Triangle, trace: float, mu: float, limit: float) -> Triangle:
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


@inlined
def learn(
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


@inlined
def read(numbers: Array, first: int, apart: int) -> tuple[Four, Triangle, tuple[float, float]]:
    """Theta, P and the sums of residuals, of sixteen numbers that begin at an index and stand `apart`."""
    theta = (numbers[first], numbers[first + apart], numbers[first + 2 * apart], numbers[first + 3 * apart])
    p = (
        numbers[first + 4 * apart],
        numbers[first + 5 * apart],
        numbers[first + 6 * apart],
        numbers[first + 7 * apart],
        numbers[first + 8 * apart],
        numbers[first + 9 * apart],
        numbers[first + 10 * apart],
        numbers[first + 11 * apart],
        numbers[first + 12 * apart],
        numbers[first + 13 * apart],
    )
    return theta, p, (numbers[first + 14 * apart], numbers[first + 15 * apart])


@inlined
def write(numbers: Array, theta: Four, p: Triangle, residuals: tuple[float, float]) -> None:
    """The reverse of `read` at the beginning of the numbers of one recording."""
    numbers[0], numbers[1], numbers[2], numbers[3] = theta
    (
        numbers[4],
        numbers[5],
        numbers[6],
        numbers[7],
        numbers[8],
        numbers[9],
        numbers[10],
        numbers[11],
        numbers[12],
        numbers[13],
    ) = p
    numbers[14], numbers[15] = residuals


@inlined
def rules_of(options: Packed) -> tuple[float, float, bool, bool, bool, float]:
    """The rules of `learn` that options ask for."""
    sensitivity, perturbation, limit = options.sensitivity, options.perturbation, options.trace_limit
    return sensitivity, perturbation, options.newtons, options.before, options.resetting, limit
