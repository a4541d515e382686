"""The exact estimator's unknowns and covariance between samples, compiled: begin, bounds, reference depth, drift."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification.exact.law import (
    ALPHA_LOWER,
    ANCHOR_DEPTH,
    ANCHOR_TIME,
    DRIFT,
    EXCESS,
    FIRST_NOISE,
    LARGEST_REFERENCE,
    LAST_TIME,
    LEARNT_FROM,
    LOG_DEPTH,
    LOG_REFERENCE,
    POWER,
    REFERENCE,
    REFERENCE_TIME_AT,
    S_LOWER,
    SHARE_NOISE,
    UNKNOWNS,
)

Array = NDArray[np.float64]

_compiled = compiled(error_model="numpy")
_inlined = compiled(error_model="numpy", forceinline=True)

FEWEST_UPDATES = 20
"""No force is rendered from fewer samples."""

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


lower_bound: Callable[[Array, int], float] = _inlined(_lower)
upper_bound: Callable[[Array, Array, int], float] = _inlined(_upper)


def _project(theta: Array, covariance: Array, settings: Array) -> None:
    """Into the bounds: nearest in the metric of the covariance, one bound after the other, and at last plainly."""
    for attempt in range(3):
        moved = False
        for i in range(UNKNOWNS):
            inside = min(max(theta[i], lower_bound(settings, i)), upper_bound(theta, settings, i))
            if inside != theta[i]:
                excess = inside - theta[i]
                if attempt < 2 and covariance[i, i] > 0.0:
                    for j in range(UNKNOWNS):
                        if j != i:
                            theta[j] += excess * covariance[j, i] / covariance[i, i]
                theta[i] = inside
                moved = True
        if not moved:
            return


def _restart(theta: Array, covariance: Array, settings: Array, force: float) -> None:
    """The covariance of the beginning: shares of the force scale for the strengths."""
    covariance[:] = 0.0
    for i in range(UNKNOWNS):
        scale = max(theta[0], force) if i < 2 else 1.0
        covariance[i, i] = (settings[i] * scale) ** 2


project: Callable[[Array, Array, Array], None] = _inlined(_project)
restart: Callable[[Array, Array, Array, float], None] = _compiled(_restart)


def _begin(
    theta: Array, covariance: Array, memory: Array, settings: Array, time: float, depth: float, force: float
) -> None:
    """Start from one sample: its force at its depth, exponents as is usual."""
    memory[:] = 0.0
    memory[REFERENCE] = memory[LARGEST_REFERENCE] = memory[ANCHOR_DEPTH] = depth
    memory[LAST_TIME] = memory[ANCHOR_TIME] = time
    memory[LOG_DEPTH] = memory[LOG_REFERENCE] = math.log(depth)
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
    memory[LOG_REFERENCE] = math.log(memory[REFERENCE])
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


begin: Callable[[Array, Array, Array, Array, float, float, float], None] = _compiled(_begin)
move_reference: Callable[[Array, Array, Array, Array, float], None] = _compiled(_move_reference)
drift: Callable[[Array, Array, Array, Array, float], None] = _inlined(_drift)


def _move_surface(theta: Array, covariance: Array, memory: Array, settings: Array, change: float) -> None:
    """The given surface has moved deeper by a change [m]: the same law above it, or none if it moved far."""
    if memory[REFERENCE] > 0.0:
        if abs(change) > LARGEST_SURFACE * memory[REFERENCE]:
            memory[REFERENCE] = 0.0
        else:
            theta[4] += change / memory[REFERENCE]
            memory[ANCHOR_DEPTH] -= change
            project(theta, covariance, settings)


move_surface: Callable[[Array, Array, Array, Array, float], None] = _compiled(_move_surface)


def _law_numbers(theta: Array, memory: Array, settings: Array, numbers: Array) -> bool:
    """k, lambda, n and alpha of law (4) as `ExactLaw.model` has them; False, and nothing written, where they are none.

    Args:
        theta: The unknowns.
        memory: Of the estimator.
        settings: Of the estimator.
        numbers: Of shape (4,), written.
    """
    depth, s, alpha = memory[REFERENCE], theta[2], theta[3]
    if not (memory[LEARNT_FROM] >= FEWEST_UPDATES and depth > 0.0):
        return False
    n = s - alpha
    stiffness, damping = theta[0] * depth**-s, theta[1] * depth ** -(n + 1.0) * settings[REFERENCE_TIME_AT]
    good = 0.0 < stiffness < math.inf and 0.0 <= damping < math.inf and n >= 0.0 and alpha >= 0.0
    if not (good and n + alpha > 0.0):
        return False
    numbers[0], numbers[1], numbers[2], numbers[3] = stiffness, damping, n, alpha
    return True


law_numbers: Callable[[Array, Array, Array, Array], bool] = _compiled(_law_numbers)
