"""One step of the exact recursive estimator, compiled; the equations are in `ExactContinuousSwitching`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined
from foretouch.identification.exact import law as at
from foretouch.identification.exact.belief import SMALLEST_FORCE, begin, drift, move_reference, project, restart
from foretouch.identification.exact.law import UNKNOWNS

Array = NDArray[np.float64]


LEARNT, CHANGED, HELD, UNUSABLE, FAILED, FREE_AIR = range(6)
"""Result of a step."""

ALARM_SAMPLES = 10.0
ALARM_CLIP = 36.0
"""Largest squared innovation in the alarm: with the gate at 16, six samples in a row at it are a change, one is not."""

ALARM_PAUSE = 50.0
ALARM_DEPTH = 0.3
"""Least depth for alarms, as a fraction of x0: nearer to the surface a wrong surface looks like a change."""

SMALLEST_DEPTH = 0.02
"""Least depth that is learnt, as a fraction of x0."""

REFERENCE_STEP = 0.4
"""Least change of ln x by which x0 follows the mean depth."""

FADE_TIME = 0.1
FADE_FROM = 2.5
"""Mean of squared normalised innovations over 0.1 s above which the covariance is too small."""

LARGEST_GAP = 1.0
"""Longest time for which a pause adds to the random walk [s]."""


@inlined
def learn_noise(memory: Array, settings: Array, squared: float, size: float, variance: float) -> None:
    """Learn the variance of the force, a constant plus a multiple of its square, from squared residuals."""
    rate = 1.0 / (1.0 + memory[at.COUNT])
    weight = rate / (variance * variance)
    square, kept = size * size, 1.0 - rate
    m0 = kept * memory[at.MOMENTS] + weight
    m2 = kept * memory[at.MOMENTS + 1] + weight * square
    m4 = kept * memory[at.MOMENTS + 2] + weight * (square * square)
    b0 = kept * memory[at.MOMENTS + 3] + weight * squared
    b2 = kept * memory[at.MOMENTS + 4] + weight * (squared * square)
    memory[at.MOMENTS], memory[at.MOMENTS + 1], memory[at.MOMENTS + 2] = m0, m2, m4
    memory[at.MOMENTS + 3], memory[at.MOMENTS + 4] = b0, b2
    if memory[at.COUNT] < 20.0 or not m4 > 0.0:
        return
    determinant = m0 * m4 - m2 * m2
    constant, share = 0.0, b2 / m4
    if determinant > 1e-6 * m0 * m4:
        constant = (b0 * m4 - b2 * m2) / determinant
        share = (b2 * m0 - b0 * m2) / determinant
        if constant < 0.0:
            constant, share = 0.0, b2 / m4
        elif share < 0.0:
            constant, share = b0 / m0, 0.0
    largest = settings[at.LARGEST_NOISE] ** 2
    memory[at.CONSTANT_NOISE] = min(constant, largest * memory[at.POWER])
    memory[at.SHARE_NOISE] = min(share, largest)


@inlined
def expect(
    theta: Array, memory: Array, settings: Array, u: float, velocity: float, slope: Array
) -> tuple[float, float]:
    """Force of the law and that of a unit of F0 [-]; the slopes by all unknowns are written into `slope`."""
    log_u = math.log(u)
    n = theta[2] - theta[3]
    slope[0] = math.exp(theta[2] * log_u)
    slope[1] = math.exp(n * log_u) * velocity * settings[at.REFERENCE_TIME_AT] / memory[at.REFERENCE]
    elastic, viscous = theta[0] * slope[0], theta[1] * slope[1]
    slope[2] = (elastic + viscous) * log_u
    slope[3] = -viscous * log_u
    slope[4] = (theta[2] * elastic + n * viscous) / u
    return elastic + viscous, slope[0]


@inlined
def project_slope(covariance: Array, slope: Array, projected: Array) -> float:
    """Write P H' into `projected`; return H P H'."""
    uncertainty = 0.0
    for i in range(UNKNOWNS):
        total = 0.0
        for j in range(UNKNOWNS):
            total += covariance[i, j] * slope[j]
        projected[i] = total
        uncertainty += slope[i] * total
    return uncertainty


@inlined
def correct(
    theta: Array, covariance: Array, projected: Array, gains: Array, innovation: float, noise: float, uncertainty: float
) -> None:
    """Kalman update with one measurement, the covariance in Joseph's form (I - K H) P (I - K H)' + R K K'."""
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


@inlined
def update(
    theta: Array,
    covariance: Array,
    memory: Array,
    settings: Array,
    time: float,
    depth: float,
    velocity: float,
    force: float,
) -> int:
    """Process one sample in contact, in place; return the result. See `ExactContinuousSwitching`."""
    if not (1e-9 < depth < 1e6 and abs(velocity) < 1e6 and abs(force) < 1e9 and math.isfinite(time)):
        return UNUSABLE
    if memory[at.REFERENCE] == 0.0:
        if not force > SMALLEST_FORCE:
            return UNUSABLE
        begin(theta, covariance, memory, settings, time, depth, force)

    # While the probe is held, nothing is distinguishable.
    away = abs(depth - memory[at.ANCHOR_DEPTH])
    if away > settings[at.HOLD_SHARE] * memory[at.REFERENCE] or time < memory[at.ANCHOR_TIME]:
        memory[at.ANCHOR_DEPTH], memory[at.ANCHOR_TIME] = depth, time
    elif time - memory[at.ANCHOR_TIME] >= settings[at.HOLD_TIME]:
        return HELD
    since = min(max(time - memory[at.LAST_TIME], 0.0), LARGEST_GAP)
    period = min(since, 0.1)
    memory[at.LAST_TIME] = time

    rate = 1.0 / (1.0 + memory[at.COUNT])
    memory[at.LOG_DEPTH] += rate * (math.log(depth) - memory[at.LOG_DEPTH])
    log_ratio = memory[at.LOG_DEPTH] - memory[at.LOG_REFERENCE]
    if abs(log_ratio) > REFERENCE_STEP:
        move_reference(theta, covariance, memory, settings, math.exp(log_ratio))
    drift(theta, covariance, memory, settings, since)
    u = depth / memory[at.REFERENCE] + theta[4]
    if u < SMALLEST_DEPTH:
        return UNUSABLE

    slope, projected = memory[at.SLOPE : at.SLOPE + UNKNOWNS], memory[at.PROJECTED : at.PROJECTED + UNKNOWNS]
    expected, per_strength = expect(theta, memory, settings, u, velocity, slope)
    innovation = force - expected
    uncertainty = project_slope(covariance, slope, projected)

    # Variance of a sample: the noise as learnt, its initial uncertainty, and a surface that is never exact.
    memory[at.POWER] += rate * (force * force - memory[at.POWER])
    size = max(math.sqrt(abs(expected * force)), 0.1 * math.sqrt(memory[at.POWER]), SMALLEST_FORCE)
    ignorance = math.exp(-memory[at.MOVING_TIME] / settings[at.IGNORANCE_TIME])
    share = max(memory[at.SHARE_NOISE], settings[at.LEAST_NOISE] ** 2)
    share += ignorance * (settings[at.FIRST_NOISE] ** 2 - share)
    variance = memory[at.CONSTANT_NOISE] + share * size * size + (settings[at.SURFACE_NOISE] * slope[4]) ** 2
    normalised = innovation * innovation / (variance + uncertainty)

    # A sudden change: several large innovations in a row. The law is forgotten, but not the noise.
    code = LEARNT
    memory[at.PAUSE] = max(0.0, memory[at.PAUSE] - 1.0)
    if u > ALARM_DEPTH:
        memory[at.ALARM] += (min(normalised, ALARM_CLIP) - memory[at.ALARM]) / ALARM_SAMPLES
    if memory[at.ALARM] > settings[at.GATE] and memory[at.PAUSE] == 0.0:
        code = CHANGED
        memory[at.ALARM], memory[at.PAUSE], memory[at.EXCESS] = 0.0, ALARM_PAUSE, 1.0
        scale = max(theta[0], math.sqrt(memory[at.POWER]))
        restart(theta, covariance, settings, max(scale, min(abs(innovation) / per_strength, 10.0 * scale)))
        memory[at.POWER] = max(memory[at.POWER], force * force)
        uncertainty = project_slope(covariance, slope, projected)
        normalised = innovation * innovation / (variance + uncertainty)

    # Correlated residuals count as fewer, and a single outlier for little.
    likeness = min(max(memory[at.PRODUCT] / memory[at.SQUARE], 0.0), 0.999) if memory[at.SQUARE] > 0.0 else 0.0
    inverse_period = 1.0 / max(period, 1e-6)
    correlation = min((1.0 + likeness) / (1.0 - likeness), max(1.0, settings[at.CORRELATION_TIME] * inverse_period))
    correlation += ignorance * (max(1.0, settings[at.FIRST_CORRELATION_TIME] * inverse_period) - correlation)
    noise = variance * correlation
    if normalised > settings[at.CLIP] ** 2:
        noise += (math.sqrt(normalised) / settings[at.CLIP] - 1.0) * (noise + uncertainty)
    correct(theta, covariance, projected, memory[at.GAIN : at.GAIN + UNKNOWNS], innovation, noise, uncertainty)
    project(theta, covariance, settings)

    # Only residuals that the unknowns cannot explain show the noise.
    memory[at.COUNT] = min(memory[at.COUNT] + 1.0, settings[at.NOISE_MEMORY])
    memory[at.MOVING_TIME] += period
    unexplained = variance / (variance + uncertainty)
    squared = min(innovation * innovation, 25.0 * (variance + uncertainty)) * unexplained
    learn_noise(memory, settings, squared, size, variance)
    residual = min(max(innovation / math.sqrt(variance + uncertainty), -5.0), 5.0) * unexplained
    rate = 1.0 / (1.0 + memory[at.COUNT])
    memory[at.PRODUCT] += rate * (residual * memory[at.LAST_RESIDUAL] - memory[at.PRODUCT])
    memory[at.SQUARE] += rate * (residual * residual - memory[at.SQUARE])
    memory[at.LAST_RESIDUAL] = residual

    # Innovations larger than the covariance allows for a long time: it is too small.
    fading = min(1.0, period / FADE_TIME)
    memory[at.EXCESS] += fading * (min(normalised, 25.0) - memory[at.EXCESS])
    if memory[at.EXCESS] > FADE_FROM:
        covariance *= 1.0 + fading * (memory[at.EXCESS] - 1.0)
    total = 0.0
    for i in range(UNKNOWNS):
        total += theta[i] + covariance[i, i]
        if covariance[i, i] < 0.0:
            return FAILED
    if not math.isfinite(total):
        return FAILED
    memory[at.LEARNT_FROM] += 1.0
    return code


@compiled(error_model="numpy")
def take(state: Array, settings: Array, time: float, depth: float, velocity: float, force: float) -> int:
    """`update` on one array that holds the whole state; a state that has failed is reset."""
    covariance = state[at.COVARIANCE : at.NOTES].reshape((UNKNOWNS, UNKNOWNS))
    theta, memory = state[at.THETA : at.COVARIANCE], state[at.NOTES :]
    code = update(theta, covariance, memory, settings, time, depth, velocity, force)
    if code == FAILED:
        state[:] = 0.0
    return code


@compiled(error_model="numpy")
def run(
    state: Array,
    settings: Array,
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
            codes[i] = take(state, settings, time[i], depth[i], velocity[i], force[i])
