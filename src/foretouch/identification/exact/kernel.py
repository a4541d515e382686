"""One step of the exact recursive estimator, compiled; the equations are in `ExactContinuousSwitching`."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined, squared
from foretouch.core.records import Record
from foretouch.identification.conditioning.air import BLOCK, SURE
from foretouch.identification.exact.belief import (
    FIRST_ERROR,
    LARGEST_SURFACE,
    SMALLEST_FORCE,
    YOUNG,
    Belief,
    Settings,
    begin,
    clear,
    drift,
    move_reference,
    project,
    restart,
)
from foretouch.identification.exact.law import REFERENCE_TIME, UNKNOWNS
from foretouch.models.contact_map.layout import BEYOND

Array = NDArray[np.float64]


LEARNT, CHANGED, HELD, UNUSABLE, FAILED, FREE_AIR = range(6)
"""Result of a step."""

REFERENCE_STEP = math.log(BEYOND)  # Least change of ln x by which x0 follows the mean depth

LARGEST_INNOVATION = (2.0 * SURE) ** 2  # Squared, in its variance: what is larger shows no more


class Filter(Record):
    """State of an estimator."""

    settings: Settings
    belief: Annotated[NDArray[Any], Belief, 1]


@inlined
def learn_noise(belief: Belief, misfit: float, size: float, variance: float) -> None:
    """Learn the variance of the force, a constant plus a multiple of its square, from the square of a residual."""
    rate = 1.0 / (1.0 + belief.count)
    weight = rate / (variance * variance)
    square, kept = size * size, 1.0 - rate
    moments = belief.moments
    m0 = moments[0] = kept * moments[0] + weight
    m2 = moments[1] = kept * moments[1] + weight * square
    m4 = moments[2] = kept * moments[2] + weight * (square * square)
    b0 = moments[3] = kept * moments[3] + weight * misfit
    b2 = moments[4] = kept * moments[4] + weight * (misfit * square)
    if belief.count < 20.0 or not m4 > 0.0:
        return
    determinant = m0 * m4 - m2 * m2
    constant, fraction = 0.0, b2 / m4
    if determinant > 1e-6 * m0 * m4:
        constant = (b0 * m4 - b2 * m2) / determinant
        fraction = (b2 * m0 - b0 * m2) / determinant
        if constant < 0.0:
            constant, fraction = 0.0, b2 / m4
        elif fraction < 0.0:
            constant, fraction = b0 / m0, 0.0
    largest = squared(FIRST_ERROR)
    belief.constant_noise = min(constant, largest * belief.power)
    belief.share_noise = min(fraction, largest)


@inlined
def expect(belief: Belief, u: float, velocity: float) -> tuple[float, float]:
    """Force of the law and that of a unit of F0 [-]; the slopes by all unknowns are written."""
    theta, slope = belief.theta, belief.slope
    log_u = math.log(u)
    n = theta[2] - theta[3]
    slope[0] = math.exp(theta[2] * log_u)
    slope[1] = math.exp(n * log_u) * velocity * REFERENCE_TIME / belief.reference
    elastic, viscous = theta[0] * slope[0], theta[1] * slope[1]
    slope[2] = (elastic + viscous) * log_u
    slope[3] = -viscous * log_u
    slope[4] = (theta[2] * elastic + n * viscous) / u
    return elastic + viscous, slope[0]


@inlined
def project_slope(belief: Belief) -> float:
    """Write P H' and return H P H'."""
    covariance, slope, projected = belief.covariance, belief.slope, belief.projected
    uncertainty = 0.0
    for i in range(UNKNOWNS):
        total = 0.0
        for j in range(UNKNOWNS):
            total += covariance[i, j] * slope[j]
        projected[i] = total
        uncertainty += slope[i] * total
    return uncertainty


@inlined
def correct(belief: Belief, innovation: float, noise: float, uncertainty: float) -> None:
    """Kalman update with one measurement, the covariance in Joseph's form (I - K H) P (I - K H)' + R K K'."""
    theta, covariance, projected, gains = belief.theta, belief.covariance, belief.projected, belief.gain
    total = noise + uncertainty
    remaining = noise / total
    for i in range(UNKNOWNS):
        gains[i] = projected[i] / total
    for i in range(UNKNOWNS):
        gain = gains[i]
        theta[i] += gain * innovation
        for j in range(i + 1):
            other = gains[j]
            value = covariance[i, j] - gain * projected[j] - remaining * projected[i] * other + noise * gain * other
            covariance[i, j] = value
            covariance[j, i] = value


@compiled(error_model="numpy")
def take(filters: NDArray[np.void], time: float, depth: float, velocity: float, force: float) -> int:
    """Process one sample in contact, in place; return the result. See `ExactContinuousSwitching`.

    What has failed is reset.
    """
    settings, beliefs, belief = filters[0].settings, filters[0].belief, filters[0].belief[0]
    if not (1e-9 < depth < 1e6 and abs(velocity) < 1e6 and abs(force) < 1e9 and math.isfinite(time)):
        return UNUSABLE
    if belief.reference == 0.0:
        if not force > SMALLEST_FORCE:
            return UNUSABLE
        begin(beliefs, settings, time, depth, force)

    # While the probe is held, nothing is distinguishable.
    away = abs(depth - belief.anchor_depth)
    if away > settings.surface_noise * belief.reference or time < belief.anchor_time:
        belief.anchor_depth, belief.anchor_time = depth, time
    elif time - belief.anchor_time >= YOUNG:
        return HELD
    since = max(time - belief.last_time, 0.0)
    period = min(since, YOUNG)
    belief.last_time = time

    rate = 1.0 / (1.0 + belief.count)
    belief.log_depth += rate * (math.log(depth) - belief.log_depth)
    log_ratio = belief.log_depth - belief.log_reference
    if abs(log_ratio) > REFERENCE_STEP:
        move_reference(belief, settings, math.exp(log_ratio))
    drift(belief, settings, since)
    u = depth / belief.reference + belief.theta[4]
    if u < settings.surface_noise:  # the surface is not known better
        return UNUSABLE

    expected, per_strength = expect(belief, u, velocity)
    innovation = force - expected
    uncertainty = project_slope(belief)

    # Variance of a sample: the noise as learnt, its initial uncertainty, and a surface that is never exact.
    belief.power += rate * (force * force - belief.power)
    size = max(math.sqrt(abs(expected * force)), 0.1 * math.sqrt(belief.power), SMALLEST_FORCE)
    ignorance = math.exp(-belief.moving_time / settings.ignorance_time)
    weight = belief.share_noise + ignorance * (squared(FIRST_ERROR) - belief.share_noise)
    variance = belief.constant_noise + weight * size * size + squared(settings.surface_noise * belief.slope[4])
    normalised = innovation * innovation / (variance + uncertainty)

    # A sudden change: several large innovations in a row, never one alone. The law is forgotten, but not the noise.
    code = LEARNT
    belief.excess += min(0.2, period / BLOCK) * (min(normalised, LARGEST_INNOVATION) - belief.excess)
    if belief.excess > squared(SURE):
        code = CHANGED
        belief.excess = 1.0
        scale = max(belief.theta[0], math.sqrt(belief.power))
        restart(belief, settings, max(scale, min(abs(innovation) / per_strength, 10.0 * scale)))
        belief.power = max(belief.power, force * force)
        uncertainty = project_slope(belief)
        normalised = innovation * innovation / (variance + uncertainty)

    # Correlated residuals count as fewer, and a single outlier for little.
    likeness = min(max(belief.product / belief.square, 0.0), 0.999) if belief.square > 0.0 else 0.0
    noise = variance * min((1.0 + likeness) / (1.0 - likeness), max(1.0, BLOCK / max(period, 1e-6)))
    if normalised > squared(SURE):
        noise += (math.sqrt(normalised) / SURE - 1.0) * (noise + uncertainty)
    correct(belief, innovation, noise, uncertainty)
    project(belief, settings)

    # Only residuals that the unknowns cannot explain show the noise.
    belief.count += 1.0
    belief.moving_time += period
    unexplained = variance / (variance + uncertainty)
    misfit = min(innovation * innovation, LARGEST_INNOVATION * (variance + uncertainty)) * unexplained
    learn_noise(belief, misfit, size, variance)
    residual = min(max(innovation / math.sqrt(variance + uncertainty), -5.0), 5.0) * unexplained
    rate = 1.0 / (1.0 + belief.count)
    belief.product += rate * (residual * belief.last_residual - belief.product)
    belief.square += rate * (residual * residual - belief.square)
    belief.last_residual = residual

    # What has become no number, or no covariance, is forgotten.
    total = least = 0.0
    for i in range(UNKNOWNS):
        total += belief.theta[i] + belief.covariance[i, i]
        least = min(least, belief.covariance[i, i])
    if least < 0.0 or not math.isfinite(total):
        clear(beliefs)
        return FAILED
    return code


@compiled(error_model="numpy")
def move_surface(filters: NDArray[np.void], change: float) -> None:
    """The given surface has moved deeper by a change [m]: the same law above it, or none if it moved far."""
    belief = filters[0].belief[0]
    if belief.reference > 0.0:
        if abs(change) > LARGEST_SURFACE * belief.reference:
            belief.reference = 0.0
        else:
            belief.theta[4] += change / belief.reference
            belief.anchor_depth -= change
            project(belief, filters[0].settings)


@compiled(error_model="numpy")
def run(
    filters: NDArray[np.void],
    time: Array,
    depth: Array,
    velocity: Array,
    force: Array,
    in_contact: NDArray[np.bool_],
    codes: NDArray[np.int8],
) -> None:
    """`take` for one sample after the other; the codes are written, FREE_AIR where there is no contact."""
    for i in range(time.size):
        codes[i] = FREE_AIR
        if in_contact[i]:
            codes[i] = take(filters, time[i], depth[i], velocity[i], force[i])
