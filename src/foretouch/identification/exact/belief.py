"""The exact estimator's unknowns and covariance between samples, compiled: begin, bounds, reference depth, drift."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled, inlined, squared
from foretouch.core.records import Record
from foretouch.identification.conditioning.air import SURE
from foretouch.identification.exact.law import REFERENCE_TIME, UNKNOWNS

Array = NDArray[np.float64]
Field = NDArray[Any]


FIRST_ERROR = 0.2
"""Relative error of what is not learnt yet: of a force, of maps half of it after a change, for they go on, and of a
depth by its surface. Also the largest error of an exponent that counts as known."""

USUAL_EXPONENT = 1.25  # s at the beginning: between a spring and Hertz's 3/2

YOUNG = 0.1
"""Time in contact [s] that is too short to tell anything. Until then errors are assumed, no snapshot is scored, and an
error may be chance. A probe that has stayed in one place for longer is held."""

LEARNING_TIME = 1.0  # Time constant in contact with which errors fade: those of late predictions, and first ones [s]

DRIFT = 0.03
"""Random walk of the law in one second, in the standard deviations of the beginning. A map's covariance goes back to
that of the beginning as fast: what was learnt long ago can be learnt again."""

SURFACE_NOISE = 0.02
"""Standard deviation of each depth, relative to the reference depth. Nothing is learnt from samples that are nearer to
the surface, and a probe that moved less stays in one place."""

FEWEST_UPDATES = 8  # Least number of samples from which a force is rendered

LARGEST_SURFACE = SURE * FIRST_ERROR
LARGEST_DAMPING = 20.0
SMALLEST_FORCE = 1e-9
LARGEST_FORCE = 1e12
"""Bounds of the surface in x0, of D in F0, and of F0 [N]."""


class Settings(Record):
    """What `ExactOptions` and the law say."""

    priors: Annotated[Field, float, UNKNOWNS]  # standard deviations of the unknowns at the beginning; strengths in F0
    s_bounds: Annotated[Field, float, 2]
    alpha_bounds: Annotated[Field, float, 2]
    drift: float
    ignorance_time: float
    surface_noise: float


class Belief(Record):
    """What was learnt; all 0 before the first sample. Only 64-bit numbers, so that it is one flat array, too."""

    theta: Annotated[Field, float, UNKNOWNS]  # F0 [N], D [N], s, alpha, zeta
    covariance: Annotated[Field, float, (UNKNOWNS, UNKNOWNS)]  # of these
    reference: float  # x0 [m], 0 before the first sample
    largest_reference: float  # the largest so far [m]
    last_time: float  # of the newest moving sample [s]
    anchor_depth: float  # where movement was last seen [m]
    anchor_time: float  # and when [s]
    count: float  # moving samples
    moving_time: float  # [s]
    log_depth: float  # running mean of ln x
    power: float  # running mean of F^2 [N^2]
    constant_noise: float  # variance of the force that does not grow with it [N^2]
    share_noise: float  # variance of the force as a multiple of its square
    moments: Annotated[Field, float, 5]  # weighted means: 1, F^2, F^4, r^2, r^2 F^2
    product: float  # mean product of successive normalised residuals
    square: float  # and their mean square
    last_residual: float
    excess: float  # mean of the squared normalised innovations of the last `BLOCK`
    log_reference: float  # ln x0
    slope: Annotated[Field, float, UNKNOWNS]  # scratch of one step: H
    projected: Annotated[Field, float, UNKNOWNS]  # P H'
    gain: Annotated[Field, float, UNKNOWNS]  # K


@inlined
def clear(beliefs: NDArray[np.void]) -> None:
    """Forget all samples."""
    beliefs.view(np.float64)[:] = 0.0


@inlined
def bounds(theta: Array, settings: Settings, index: int) -> tuple[float, float]:
    """Smallest and largest value of an unknown."""
    if index == 0:
        return SMALLEST_FORCE, LARGEST_FORCE
    if index == 1:
        return 0.0, LARGEST_DAMPING * max(theta[0], SMALLEST_FORCE)
    if index == 4:
        return -LARGEST_SURFACE, LARGEST_SURFACE
    both = settings.s_bounds if index == 2 else settings.alpha_bounds
    return both[0], both[1]


@inlined
def project(belief: Belief, settings: Settings) -> None:
    """Into the bounds: nearest in the metric of the covariance, one bound after the other, and at last plainly."""
    theta, covariance = belief.theta, belief.covariance
    for attempt in range(3):
        moved = False
        for i in range(UNKNOWNS):
            least, largest = bounds(theta, settings, i)
            inside = min(max(theta[i], least), largest)
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
def restart(belief: Belief, settings: Settings, force: float) -> None:
    """The covariance of the beginning: multiples of the force scale for the strengths."""
    belief.covariance[:] = 0.0
    for i in range(UNKNOWNS):
        scale = max(belief.theta[0], force) if i < 2 else 1.0
        belief.covariance[i, i] = squared(settings.priors[i] * scale)


@compiled(error_model="numpy")
def begin(beliefs: NDArray[np.void], settings: Settings, time: float, depth: float, force: float) -> None:
    """Start from one sample: its force at its depth, exponents as is usual."""
    clear(beliefs)
    belief = beliefs[0]
    belief.reference = belief.largest_reference = belief.anchor_depth = depth
    belief.last_time = belief.anchor_time = time
    belief.log_depth = belief.log_reference = math.log(depth)
    belief.power = force * force
    belief.share_noise = squared(FIRST_ERROR)
    belief.excess = 1.0
    s_bounds, alpha_bounds = settings.s_bounds, settings.alpha_bounds
    belief.theta[0] = force
    belief.theta[2] = min(USUAL_EXPONENT, s_bounds[1])
    belief.theta[3] = 0.5 * (alpha_bounds[0] + alpha_bounds[1])
    restart(belief, settings, force)


@compiled(error_model="numpy")
def move_reference(belief: Belief, settings: Settings, ratio: float) -> None:
    """Express the same law at another reference depth, exactly; the covariance by the Jacobian.

    A reference deeper than ever widens the uncertainty about the surface: it is known to a fraction of the depth.
    """
    theta, covariance = belief.theta, belief.covariance
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
    belief.reference *= ratio
    belief.log_reference = math.log(belief.reference)
    before = belief.largest_reference / belief.reference
    if before < 1.0:
        covariance[4, 4] += squared(settings.priors[4]) * (1.0 - before * before)
        belief.largest_reference = belief.reference
    project(belief, settings)


@inlined
def drift(belief: Belief, settings: Settings, period: float) -> None:
    """Random walk of the law (not of the surface), and the covariance held to that of the beginning."""
    theta, covariance = belief.theta, belief.covariance
    force = math.sqrt(belief.power)
    for i in range(UNKNOWNS):
        scale = max(theta[0], force) if i < 2 else 1.0
        bound = squared(settings.priors[i] * scale)
        if i < 4:
            covariance[i, i] += squared(settings.drift) * period * bound
        if covariance[i, i] > bound:
            shrink = math.sqrt(bound / covariance[i, i])
            for j in range(UNKNOWNS):
                covariance[i, j] *= shrink
                covariance[j, i] *= shrink


@compiled(error_model="numpy")
def law_numbers(belief: Belief, numbers: Array) -> bool:
    """k, lambda, n and alpha of law (4) as `ExactLaw.model` has them; False, without writing, where they are none."""
    theta = belief.theta
    depth, s, alpha = belief.reference, theta[2], theta[3]
    if not (belief.count >= FEWEST_UPDATES and depth > 0.0):
        return False
    n = s - alpha
    stiffness, damping = theta[0] * depth**-s, theta[1] * depth ** -(n + 1.0) * REFERENCE_TIME
    good = 0.0 < stiffness < math.inf and 0.0 <= damping < math.inf and n >= 0.0 and alpha >= 0.0
    if not (good and n + alpha > 0.0):
        return False
    numbers[0], numbers[1], numbers[2], numbers[3] = stiffness, damping, n, alpha
    return True
