"""One step of the exact recursive estimator, compiled; its equations: `foretouch.identification.ExactRecursive`."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.exact.belief import SMALLEST_FORCE, begin, drift, move_reference, project, restart
from foretouch.identification.exact.law import (
    ALARM,
    ANCHOR_DEPTH,
    ANCHOR_TIME,
    CLIP,
    CONSTANT_NOISE,
    CORRELATION_TIME,
    COUNT,
    COVARIANCE,
    EXCESS,
    FIRST_CORRELATION_TIME,
    FIRST_NOISE,
    GAIN,
    GATE,
    HOLD_SHARE,
    HOLD_TIME,
    IGNORANCE_TIME,
    LARGEST_NOISE,
    LAST_RESIDUAL,
    LAST_TIME,
    LEARNT_FROM,
    LEAST_NOISE,
    LOG_DEPTH,
    LOG_REFERENCE,
    MOMENTS,
    MOVING_TIME,
    NOISE_MEMORY,
    NOTES,
    PAUSE,
    POWER,
    PRODUCT,
    PROJECTED,
    REFERENCE,
    REFERENCE_TIME_AT,
    SHARE_NOISE,
    SLOPE,
    SQUARE,
    SURFACE_NOISE,
    THETA,
    UNKNOWNS,
)

Array = NDArray[np.float64]

_compiled = compiled(error_model="numpy")
_inlined = compiled(error_model="numpy", forceinline=True)

LEARNT, CHANGED, HELD, UNUSABLE, FAILED, FREE_AIR = range(6)
"""What a step did."""

ALARM_SAMPLES = 10.0
ALARM_CLIP = 36.0
"""With the gate at 16, six samples in a row at this clip are a change, and no single one is."""

ALARM_PAUSE = 50.0
ALARM_DEPTH = 0.3
"""Nearer to the surface than this share of x0, a wrong surface looks like a change."""

SMALLEST_DEPTH = 0.02
"""Nearer than this share of x0 nothing is learnt."""

REFERENCE_STEP = 0.4
"""x0 follows the mean depth in steps of at least this much in ln x."""

FADE_TIME = 0.1
FADE_FROM = 2.5
"""Squared normalised innovations whose mean over 0.1 s is above this say that the covariance is too small."""

LARGEST_GAP = 1.0
"""The random walk of a pause is that of at most this time [s]."""


def _learn_noise(memory: Array, settings: Array, squared: float, size: float, variance: float) -> None:
    """Variance of the force as a constant plus a share of its square, by least squares on squared residuals."""
    rate = 1.0 / (1.0 + memory[COUNT])
    weight = rate / (variance * variance)
    square, kept = size * size, 1.0 - rate
    m0 = kept * memory[MOMENTS] + weight
    m2 = kept * memory[MOMENTS + 1] + weight * square
    m4 = kept * memory[MOMENTS + 2] + weight * (square * square)
    b0 = kept * memory[MOMENTS + 3] + weight * squared
    b2 = kept * memory[MOMENTS + 4] + weight * (squared * square)
    memory[MOMENTS], memory[MOMENTS + 1], memory[MOMENTS + 2] = m0, m2, m4
    memory[MOMENTS + 3], memory[MOMENTS + 4] = b0, b2
    if memory[COUNT] < 20.0 or not m4 > 0.0:
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
    largest = settings[LARGEST_NOISE] ** 2
    memory[CONSTANT_NOISE] = min(constant, largest * memory[POWER])
    memory[SHARE_NOISE] = min(share, largest)


learn_noise: Callable[[Array, Array, float, float, float], None] = _inlined(_learn_noise)


def _expect(
    theta: Array, memory: Array, settings: Array, u: float, velocity: float, slope: Array
) -> tuple[float, float]:
    """Force of the law and what one F0 gives of it [-]; the slopes by all unknowns go into `slope`."""
    log_u = math.log(u)
    n = theta[2] - theta[3]
    slope[0] = math.exp(theta[2] * log_u)
    slope[1] = math.exp(n * log_u) * velocity * settings[REFERENCE_TIME_AT] / memory[REFERENCE]
    elastic, viscous = theta[0] * slope[0], theta[1] * slope[1]
    slope[2] = (elastic + viscous) * log_u
    slope[3] = -viscous * log_u
    slope[4] = (theta[2] * elastic + n * viscous) / u
    return elastic + viscous, slope[0]


def _project_slope(covariance: Array, slope: Array, projected: Array) -> float:
    """P H' into `projected`; returns H P H'."""
    doubt = 0.0
    for i in range(UNKNOWNS):
        total = 0.0
        for j in range(UNKNOWNS):
            total += covariance[i, j] * slope[j]
        projected[i] = total
        doubt += slope[i] * total
    return doubt


def _correct(
    theta: Array, covariance: Array, projected: Array, gains: Array, innovation: float, noise: float, doubt: float
) -> None:
    """Kalman's update with one measurement, the covariance in Joseph's form (I - K H) P (I - K H)' + K R K'."""
    total = noise + doubt
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


expect: Callable[[Array, Array, Array, float, float, Array], tuple[float, float]] = _inlined(_expect)
project_slope: Callable[[Array, Array, Array], float] = _inlined(_project_slope)
correct: Callable[[Array, Array, Array, Array, float, float, float], None] = _inlined(_correct)


def _update(
    theta: Array,
    covariance: Array,
    memory: Array,
    settings: Array,
    time: float,
    depth: float,
    velocity: float,
    force: float,
) -> int:
    """One sample in contact, in place; returns what was done. See `foretouch.identification.ExactRecursive`."""
    if not (1e-9 < depth < 1e6 and abs(velocity) < 1e6 and abs(force) < 1e9 and math.isfinite(time)):
        return UNUSABLE
    if memory[REFERENCE] == 0.0:
        if not force > SMALLEST_FORCE:
            return UNUSABLE
        begin(theta, covariance, memory, settings, time, depth, force)

    # Held in place, there is nothing to be told apart.
    if abs(depth - memory[ANCHOR_DEPTH]) > settings[HOLD_SHARE] * memory[REFERENCE] or time < memory[ANCHOR_TIME]:
        memory[ANCHOR_DEPTH], memory[ANCHOR_TIME] = depth, time
    elif time - memory[ANCHOR_TIME] >= settings[HOLD_TIME]:
        return HELD
    since = min(max(time - memory[LAST_TIME], 0.0), LARGEST_GAP)
    period = min(since, 0.1)
    memory[LAST_TIME] = time

    rate = 1.0 / (1.0 + memory[COUNT])
    memory[LOG_DEPTH] += rate * (math.log(depth) - memory[LOG_DEPTH])
    log_ratio = memory[LOG_DEPTH] - memory[LOG_REFERENCE]
    if abs(log_ratio) > REFERENCE_STEP:
        move_reference(theta, covariance, memory, settings, math.exp(log_ratio))
    drift(theta, covariance, memory, settings, since)
    u = depth / memory[REFERENCE] + theta[4]
    if u < SMALLEST_DEPTH:
        return UNUSABLE

    slope, projected = memory[SLOPE : SLOPE + UNKNOWNS], memory[PROJECTED : PROJECTED + UNKNOWNS]
    expected, per_strength = expect(theta, memory, settings, u, velocity, slope)
    innovation = force - expected
    doubt = project_slope(covariance, slope, projected)

    # What a sample is worth: the noise as learnt, what is not yet known of it, and a surface that is never exact.
    memory[POWER] += rate * (force * force - memory[POWER])
    size = max(math.sqrt(abs(expected * force)), 0.1 * math.sqrt(memory[POWER]), SMALLEST_FORCE)
    ignorance = math.exp(-memory[MOVING_TIME] / settings[IGNORANCE_TIME])
    share = max(memory[SHARE_NOISE], settings[LEAST_NOISE] ** 2)
    share += ignorance * (settings[FIRST_NOISE] ** 2 - share)
    variance = memory[CONSTANT_NOISE] + share * size * size + (settings[SURFACE_NOISE] * slope[4]) ** 2
    normalised = innovation * innovation / (variance + doubt)

    # A sudden change: several large innovations in a row. What the law was is forgotten, but not the noise.
    code = LEARNT
    memory[PAUSE] = max(0.0, memory[PAUSE] - 1.0)
    if u > ALARM_DEPTH:
        memory[ALARM] += (min(normalised, ALARM_CLIP) - memory[ALARM]) / ALARM_SAMPLES
    if memory[ALARM] > settings[GATE] and memory[PAUSE] == 0.0:
        code = CHANGED
        memory[ALARM], memory[PAUSE], memory[EXCESS] = 0.0, ALARM_PAUSE, 1.0
        scale = max(theta[0], math.sqrt(memory[POWER]))
        restart(theta, covariance, settings, max(scale, min(abs(innovation) / per_strength, 10.0 * scale)))
        memory[POWER] = max(memory[POWER], force * force)
        doubt = project_slope(covariance, slope, projected)
        normalised = innovation * innovation / (variance + doubt)

    # Residuals that resemble each other count as fewer, and a single wild one for little.
    likeness = min(max(memory[PRODUCT] / memory[SQUARE], 0.0), 0.999) if memory[SQUARE] > 0.0 else 0.0
    inverse_period = 1.0 / max(period, 1e-6)
    correlation = min((1.0 + likeness) / (1.0 - likeness), max(1.0, settings[CORRELATION_TIME] * inverse_period))
    correlation += ignorance * (max(1.0, settings[FIRST_CORRELATION_TIME] * inverse_period) - correlation)
    noise = variance * correlation
    if normalised > settings[CLIP] ** 2:
        noise += (math.sqrt(normalised) / settings[CLIP] - 1.0) * (noise + doubt)
    correct(theta, covariance, projected, memory[GAIN : GAIN + UNKNOWNS], innovation, noise, doubt)
    project(theta, covariance, settings)

    # Only residuals that the unknowns cannot explain tell the noise.
    memory[COUNT] = min(memory[COUNT] + 1.0, settings[NOISE_MEMORY])
    memory[MOVING_TIME] += period
    unexplained = variance / (variance + doubt)
    squared = min(innovation * innovation, 25.0 * (variance + doubt)) * unexplained
    learn_noise(memory, settings, squared, size, variance)
    residual = min(max(innovation / math.sqrt(variance + doubt), -5.0), 5.0) * unexplained
    rate = 1.0 / (1.0 + memory[COUNT])
    memory[PRODUCT] += rate * (residual * memory[LAST_RESIDUAL] - memory[PRODUCT])
    memory[SQUARE] += rate * (residual * residual - memory[SQUARE])
    memory[LAST_RESIDUAL] = residual

    # Innovations larger than the covariance allows for long: it is too small.
    fading = min(1.0, period / FADE_TIME)
    memory[EXCESS] += fading * (min(normalised, 25.0) - memory[EXCESS])
    if memory[EXCESS] > FADE_FROM:
        covariance *= 1.0 + fading * (memory[EXCESS] - 1.0)
    total = 0.0
    for i in range(UNKNOWNS):
        total += theta[i] + covariance[i, i]
        if covariance[i, i] < 0.0:
            return FAILED
    if not math.isfinite(total):
        return FAILED
    memory[LEARNT_FROM] += 1.0
    return code


update: Callable[[Array, Array, Array, Array, float, float, float, float], int] = _inlined(_update)


def _take(state: Array, settings: Array, time: float, depth: float, velocity: float, force: float) -> int:
    """`update` on one array that holds all that is remembered; what has failed is forgotten."""
    covariance = state[COVARIANCE:NOTES].reshape((UNKNOWNS, UNKNOWNS))
    code = update(state[THETA:COVARIANCE], covariance, state[NOTES:], settings, time, depth, velocity, force)
    if code == FAILED:
        state[:] = 0.0
    return code


take: Callable[[Array, Array, float, float, float, float], int] = _compiled(_take)


def _run(
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


run: Callable[..., None] = _compiled(_run)
