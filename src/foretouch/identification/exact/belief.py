"""The exact estimator's unknowns and covariance between samples, compiled: begin, bounds, reference depth, drift."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined
from foretouch.identification.exact import law as at
from foretouch.identification.exact.law import UNKNOWNS

Array = NDArray[np.float64]


FEWEST_UPDATES = 20
"""No force is rendered from fewer samples."""

LARGEST_DAMPING = 20.0
LARGEST_SURFACE = 0.5
SMALLEST_FORCE = 1e-9
LARGEST_FORCE = 1e12
"""Bounds of D in F0, of the surface in x0, and of F0 [N]."""


@inlined
def lower_bound(settings: Array, index: int) -> float:
    """Smallest value of an unknown."""
    if index == 0:
        return SMALLEST_FORCE
    if index == 1:
        return 0.0
    return -LARGEST_SURFACE if index == 4 else float(settings[at.S_LOWER + 2 * (index - 2)])


@inlined
def upper_bound(theta: Array, settings: Array, index: int) -> float:
    """Largest value of an unknown."""
    if index == 0:
        return LARGEST_FORCE
    if index == 1:
        return LARGEST_DAMPING * float(max(theta[0], SMALLEST_FORCE))
    return LARGEST_SURFACE if index == 4 else float(settings[at.S_LOWER + 1 + 2 * (index - 2)])


@inlined
def project(theta: Array, covariance: Array, settings: Array) -> None:
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


@compiled(error_model="numpy")
def restart(theta: Array, covariance: Array, settings: Array, force: float) -> None:
    """The covariance of the beginning: shares of the force scale for the strengths."""
    covariance[:] = 0.0
    for i in range(UNKNOWNS):
        scale = max(theta[0], force) if i < 2 else 1.0
        covariance[i, i] = (settings[i] * scale) ** 2


@compiled(error_model="numpy")
def begin(
    theta: Array, covariance: Array, memory: Array, settings: Array, time: float, depth: float, force: float
) -> None:
    """Start from one sample: its force at its depth, exponents as is usual."""
    memory[:] = 0.0
    memory[at.REFERENCE] = memory[at.LARGEST_REFERENCE] = memory[at.ANCHOR_DEPTH] = depth
    memory[at.LAST_TIME] = memory[at.ANCHOR_TIME] = time
    memory[at.LOG_DEPTH] = memory[at.LOG_REFERENCE] = math.log(depth)
    memory[at.POWER] = force * force
    memory[at.SHARE_NOISE] = settings[at.FIRST_NOISE] ** 2
    memory[at.EXCESS] = 1.0
    theta[0] = force
    theta[1] = 0.1 * force
    theta[2] = settings[at.S_LOWER] + 0.4 * (settings[at.S_LOWER + 1] - settings[at.S_LOWER])
    theta[3] = 0.5 * (settings[at.ALPHA_LOWER] + settings[at.ALPHA_LOWER + 1])
    theta[4] = 0.0
    restart(theta, covariance, settings, force)


@compiled(error_model="numpy")
def move_reference(theta: Array, covariance: Array, memory: Array, settings: Array, ratio: float) -> None:
    """Express the same law at another reference depth, exactly; the covariance by the Jacobian.

    A reference deeper than ever widens the uncertainty about the surface: it is known to a share of the depth.
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
    memory[at.REFERENCE] *= ratio
    memory[at.LOG_REFERENCE] = math.log(memory[at.REFERENCE])
    before = memory[at.LARGEST_REFERENCE] / memory[at.REFERENCE]
    if before < 1.0:
        covariance[4, 4] += settings[4] ** 2 * (1.0 - before * before)
        memory[at.LARGEST_REFERENCE] = memory[at.REFERENCE]
    project(theta, covariance, settings)


@inlined
def drift(theta: Array, covariance: Array, memory: Array, settings: Array, period: float) -> None:
    """Random walk of the law (not of the surface), and the covariance held to that of the beginning."""
    force = math.sqrt(memory[at.POWER])
    for i in range(UNKNOWNS):
        scale = max(theta[0], force) if i < 2 else 1.0
        bound = (settings[i] * scale) ** 2
        if i < 4:
            covariance[i, i] += settings[at.DRIFT] ** 2 * period * bound
        if i < 2:
            bound *= 100.0  # a change may have found a force ten times larger
        if covariance[i, i] > bound:
            shrink = math.sqrt(bound / covariance[i, i])
            for j in range(UNKNOWNS):
                covariance[i, j] *= shrink
                covariance[j, i] *= shrink


@compiled(error_model="numpy")
def move_surface(theta: Array, covariance: Array, memory: Array, settings: Array, change: float) -> None:
    """The given surface has moved deeper by a change [m]: the same law above it, or none if it moved far."""
    if memory[at.REFERENCE] > 0.0:
        if abs(change) > LARGEST_SURFACE * memory[at.REFERENCE]:
            memory[at.REFERENCE] = 0.0
        else:
            theta[4] += change / memory[at.REFERENCE]
            memory[at.ANCHOR_DEPTH] -= change
            project(theta, covariance, settings)


@compiled(error_model="numpy")
def law_numbers(theta: Array, memory: Array, settings: Array, numbers: Array) -> bool:
    """k, lambda, n and alpha of law (4) as `ExactLaw.model` has them; False, and nothing written, where they are none.

    Args:
        theta: The unknowns.
        memory: Of the estimator.
        settings: Of the estimator.
        numbers: Of shape (4,), written.
    """
    depth, s, alpha = memory[at.REFERENCE], theta[2], theta[3]
    if not (memory[at.LEARNT_FROM] >= FEWEST_UPDATES and depth > 0.0):
        return False
    n = s - alpha
    stiffness, damping = theta[0] * depth**-s, theta[1] * depth ** -(n + 1.0) * settings[at.REFERENCE_TIME_AT]
    good = 0.0 < stiffness < math.inf and 0.0 <= damping < math.inf and n >= 0.0 and alpha >= 0.0
    if not (good and n + alpha > 0.0):
        return False
    numbers[0], numbers[1], numbers[2], numbers[3] = stiffness, damping, n, alpha
    return True
