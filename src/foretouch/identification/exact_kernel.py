"""One step of the exact recursive estimator, compiled; the equations are in `exact_recursive`.

The unknowns are F0 [N], D [N], s, alpha of `exact_law`, and the height of the true surface above the given one in
shares of x0. Everything else that is remembered, and all settings, stand in one array each: a short call is quick.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["CHANGED", "FAILED", "HELD", "LEARNT", "MEMORY_SIZE", "REFERENCE", "SETTINGS", "UNKNOWNS", "UNUSABLE"]
__all__ += ["move_surface", "update"]

Array = NDArray[np.float64]

UNKNOWNS = 5

LEARNT, CHANGED, HELD, UNUSABLE, FAILED = range(5)
"""What a step did."""

REFERENCE = 0  # x0 [m], 0 before the first sample
LARGEST_REFERENCE = 1  # the largest so far [m]
LAST_TIME = 2  # of the newest moving sample [s]
ANCHOR_DEPTH, ANCHOR_TIME = 3, 4  # where and when movement was last seen [m], [s]
COUNT = 5  # moving samples, at most the noise memory
MOVING_TIME = 6  # [s]
LOG_DEPTH = 7  # running mean of ln x
POWER = 8  # running mean of F^2 [N^2]
CONSTANT_NOISE = 9  # variance of the force that does not grow with it [N^2]
SHARE_NOISE = 10  # variance of the force in shares of its square
MOMENTS = 11  # five weighted means: 1, F^2, F^4, r^2, r^2 F^2
PRODUCT, SQUARE, LAST_RESIDUAL = 16, 17, 18  # of successive normalised residuals
ALARM = 19  # mean of the last squared normalised innovations
PAUSE = 20  # samples for which no change can be called
EXCESS = 21  # the same mean over a longer time
MEMORY_SIZE = 22

SETTINGS: tuple[str, ...] = (
    "strength_prior",
    "strength_prior",
    "s_prior",
    "alpha_prior",
    "surface_prior",
    "s_lower",
    "s_upper",
    "alpha_lower",
    "alpha_upper",
    "drift",
    "least_noise",
    "first_noise",
    "largest_noise",
    "ignorance_time",
    "noise_memory",
    "correlation_time",
    "first_correlation_time",
    "clip",
    "gate",
    "hold_time",
    "hold_share",
    "surface_noise",
    "reference_time",
)
"""Their order in the array of settings."""

S_LOWER, ALPHA_LOWER = SETTINGS.index("s_lower"), SETTINGS.index("alpha_lower")
DRIFT = SETTINGS.index("drift")
LEAST_NOISE, FIRST_NOISE = SETTINGS.index("least_noise"), SETTINGS.index("first_noise")
LARGEST_NOISE, IGNORANCE_TIME = SETTINGS.index("largest_noise"), SETTINGS.index("ignorance_time")
NOISE_MEMORY = SETTINGS.index("noise_memory")
CORRELATION_TIME, FIRST_CORRELATION_TIME = (
    SETTINGS.index("correlation_time"),
    SETTINGS.index("first_correlation_time"),
)
CLIP, GATE = SETTINGS.index("clip"), SETTINGS.index("gate")
HOLD_TIME, HOLD_SHARE = SETTINGS.index("hold_time"), SETTINGS.index("hold_share")
SURFACE_NOISE, REFERENCE_TIME = SETTINGS.index("surface_noise"), SETTINGS.index("reference_time")

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

LARGEST_DAMPING = 20.0
LARGEST_SURFACE = 0.5
SMALLEST_FORCE = 1e-9
LARGEST_FORCE = 1e12
"""Bounds of D in F0, of the surface in x0, and of F0 [N]."""


def _lower(settings: Array, index: int) -> float:
    if index == 0:
        return SMALLEST_FORCE
    if index == 1:
        return 0.0
    return -LARGEST_SURFACE if index == 4 else float(settings[S_LOWER + 2 * (index - 2)])


def _upper(theta: Array, settings: Array, index: int) -> float:
    if index == 0:
        return LARGEST_FORCE
    if index == 1:
        return LARGEST_DAMPING * float(max(theta[0], SMALLEST_FORCE))
    return LARGEST_SURFACE if index == 4 else float(settings[S_LOWER + 1 + 2 * (index - 2)])


lower_bound: Callable[[Array, int], float] = njit(cache=True)(_lower)
upper_bound: Callable[[Array, Array, int], float] = njit(cache=True)(_upper)


def _project(theta: Array, covariance: Array, settings: Array) -> None:
    """Into the bounds: nearest in the metric of the covariance, one bound after the other, and at last plainly."""
    for attempt in range(3):
        for i in range(UNKNOWNS):
            inside = min(max(theta[i], lower_bound(settings, i)), upper_bound(theta, settings, i))
            if inside != theta[i]:
                excess = inside - theta[i]
                if attempt < 2 and covariance[i, i] > 0.0:
                    for j in range(UNKNOWNS):
                        if j != i:
                            theta[j] += excess * covariance[j, i] / covariance[i, i]
                theta[i] = inside


def _restart(theta: Array, covariance: Array, settings: Array, force: float) -> None:
    """The covariance of the beginning: shares of the force scale for the strengths."""
    covariance[:] = 0.0
    for i in range(UNKNOWNS):
        scale = max(theta[0], force) if i < 2 else 1.0
        covariance[i, i] = (settings[i] * scale) ** 2


project: Callable[[Array, Array, Array], None] = njit(cache=True)(_project)
restart: Callable[[Array, Array, Array, float], None] = njit(cache=True)(_restart)


def _begin(
    theta: Array, covariance: Array, memory: Array, settings: Array, time: float, depth: float, force: float
) -> None:
    """Start from one sample: its force at its depth, exponents as is usual."""
    memory[:] = 0.0
    memory[REFERENCE] = memory[LARGEST_REFERENCE] = memory[ANCHOR_DEPTH] = depth
    memory[LAST_TIME] = memory[ANCHOR_TIME] = time
    memory[LOG_DEPTH] = math.log(depth)
    memory[POWER] = force * force
    memory[SHARE_NOISE] = settings[FIRST_NOISE] ** 2
    memory[EXCESS] = 1.0
    theta[0] = force
    theta[1] = 0.1 * force
    theta[2] = settings[S_LOWER] + 0.4 * (settings[S_LOWER + 1] - settings[S_LOWER])
    theta[3] = 0.5 * (settings[ALPHA_LOWER] + settings[ALPHA_LOWER + 1])
    theta[4] = 0.0
    restart(theta, covariance, settings, force)


def _move_reference(theta: Array, covariance: Array, memory: Array, settings: Array, ratio: float) -> None:
    """Express the same law at another reference depth, exactly; the covariance by the Jacobian.

    A reference deeper than ever widens the doubt about the surface: it is known to a share of the depth.
    """
    log_ratio = math.log(ratio)
    elastic, viscous = ratio ** theta[2], ratio ** (theta[2] - theta[3] + 1.0)
    theta[0] *= elastic
    theta[1] *= viscous
    theta[4] /= ratio
    per_s, per_n = theta[0] * log_ratio, theta[1] * log_ratio
    for k in range(UNKNOWNS):
        covariance[0, k] = elastic * covariance[0, k] + per_s * covariance[2, k]
        covariance[1, k] = viscous * covariance[1, k] + per_n * (covariance[2, k] - covariance[3, k])
        covariance[4, k] /= ratio
    for k in range(UNKNOWNS):
        covariance[k, 0] = elastic * covariance[k, 0] + per_s * covariance[k, 2]
        covariance[k, 1] = viscous * covariance[k, 1] + per_n * (covariance[k, 2] - covariance[k, 3])
        covariance[k, 4] /= ratio
        for j in range(k):
            covariance[j, k] = covariance[k, j]  # rounding differs
    memory[REFERENCE] *= ratio
    before = memory[LARGEST_REFERENCE] / memory[REFERENCE]
    if before < 1.0:
        covariance[4, 4] += settings[4] ** 2 * (1.0 - before * before)
        memory[LARGEST_REFERENCE] = memory[REFERENCE]
    project(theta, covariance, settings)


def _drift(theta: Array, covariance: Array, memory: Array, settings: Array, period: float) -> None:
    """Random walk of the law (not of the surface), and the covariance held to that of the beginning."""
    force = math.sqrt(memory[POWER])
    for i in range(UNKNOWNS):
        scale = max(theta[0], force) if i < 2 else 1.0
        bound = (settings[i] * scale) ** 2
        if i < 4:
            covariance[i, i] += settings[DRIFT] ** 2 * period * bound
        if i < 2:
            bound *= 100.0  # a change may have found a force ten times larger
        if covariance[i, i] > bound:
            shrink = math.sqrt(bound / covariance[i, i])
            for j in range(UNKNOWNS):
                covariance[i, j] *= shrink
                covariance[j, i] *= shrink


def _learn_noise(memory: Array, settings: Array, squared: float, size: float, variance: float) -> None:
    """Variance of the force as a constant plus a share of its square, by least squares on squared residuals."""
    rate = 1.0 / (1.0 + memory[COUNT])
    weight = rate / (variance * variance)
    square = size * size
    for k, value in enumerate((1.0, square, square * square, squared, squared * square)):
        memory[MOMENTS + k] = (1.0 - rate) * memory[MOMENTS + k] + weight * value
    m0, m2, m4, b0, b2 = memory[MOMENTS : MOMENTS + 5]
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


begin: Callable[[Array, Array, Array, Array, float, float, float], None] = njit(cache=True)(_begin)
move_reference: Callable[[Array, Array, Array, Array, float], None] = njit(cache=True)(_move_reference)
drift: Callable[[Array, Array, Array, Array, float], None] = njit(cache=True)(_drift)
learn_noise: Callable[[Array, Array, float, float, float], None] = njit(cache=True)(_learn_noise)


def _move_surface(theta: Array, covariance: Array, memory: Array, settings: Array, change: float) -> None:
    """The given surface has moved deeper by a change [m]: the same law above it, or none if it moved far."""
    if memory[REFERENCE] > 0.0:
        if abs(change) > LARGEST_SURFACE * memory[REFERENCE]:
            memory[REFERENCE] = 0.0
        else:
            theta[4] += change / memory[REFERENCE]
            memory[ANCHOR_DEPTH] -= change
            project(theta, covariance, settings)


def _expect(
    theta: Array, memory: Array, settings: Array, u: float, velocity: float, slope: Array
) -> tuple[float, float]:
    """Force of the law and what one F0 gives of it [-]; the slopes by all unknowns go into `slope`."""
    log_u = math.log(u)
    n = theta[2] - theta[3]
    slope[0] = math.exp(theta[2] * log_u)
    slope[1] = math.exp(n * log_u) * velocity * settings[REFERENCE_TIME] / memory[REFERENCE]
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


def _correct(theta: Array, covariance: Array, projected: Array, innovation: float, noise: float, doubt: float) -> None:
    """Kalman's update with one measurement, the covariance in Joseph's form (I - K H) P (I - K H)' + K R K'."""
    total = noise + doubt
    remaining = noise / total
    for i in range(UNKNOWNS):
        gain = projected[i] / total
        theta[i] += gain * innovation
        for j in range(i + 1):
            other = projected[j] / total
            value = covariance[i, j] - gain * projected[j] - remaining * projected[i] * other + noise * gain * other
            covariance[i, j] = value
            covariance[j, i] = value


expect: Callable[[Array, Array, Array, float, float, Array], tuple[float, float]] = njit(cache=True)(_expect)
project_slope: Callable[[Array, Array, Array], float] = njit(cache=True)(_project_slope)
correct: Callable[[Array, Array, Array, float, float, float], None] = njit(cache=True)(_correct)


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
    """One sample in contact, in place; returns what was done. See `exact_recursive.ExactRecursive`."""
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
    log_ratio = memory[LOG_DEPTH] - math.log(memory[REFERENCE])
    if abs(log_ratio) > REFERENCE_STEP:
        move_reference(theta, covariance, memory, settings, math.exp(log_ratio))
    drift(theta, covariance, memory, settings, since)
    u = depth / memory[REFERENCE] + theta[4]
    if u < SMALLEST_DEPTH:
        return UNUSABLE

    slope, projected = np.empty(UNKNOWNS), np.empty(UNKNOWNS)
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
    correct(theta, covariance, projected, innovation, noise, doubt)
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
    return code if math.isfinite(total) else FAILED


move_surface: Callable[[Array, Array, Array, Array, float], None] = njit(cache=True)(_move_surface)
update: Callable[[Array, Array, Array, Array, float, float, float, float], int] = njit(cache=True)(_update)
