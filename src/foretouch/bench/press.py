"""The press that benchmarks identify, and plain ways to identify it where no peer is installed.

The press goes in and out at constant speed, so that the paper's mu is one number. Beside it stand bare compiled loops,
written as anybody would, and many recordings at once in NumPy, every operation over all streams.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.core.compiling import compiled
from foretouch.identification import ContactSample, FPRLSOptions
from foretouch.identification.linear.estimators import forgetting_by_distance

Array = NDArray[np.float64]

PERIOD, SPEED, SHALLOWEST, DEEPEST = 1e-3, 0.02, 2e-3, 10e-3
"""Between samples [s], of the probe [m/s], and its depths [m]."""

STIFFNESS, DAMPING, EXPONENT = 2000.0, 100.0, 1.4
"""Of the Hunt-Crossley law that is pressed: k [N/m^n], lambda [N s/m^(n+1)], n."""

INITIAL_COVARIANCE = 1e6
"""P_0 = this times I, the paper's, for ours and for the peers."""

OPTIONS = FPRLSOptions(initial_covariance=INITIAL_COVARIANCE, perturbation=0.0)
"""Without the self-perturbing test, which no peer has."""

FORGETTING_FACTOR = forgetting_by_distance(OPTIONS.forgetting_rate, SPEED * PERIOD)
"""The paper's mu at this speed."""


class Press(NamedTuple):
    """Conditioned columns of a press, each of shape (n,).

    Attributes:
        time: [s].
        depth: [m].
        velocity: [m/s].
        force: [N].
    """

    time: Array
    depth: Array
    velocity: Array
    force: Array


class Problem(NamedTuple):
    """The same press as a linear problem: what the peers are given ready-made.

    Attributes:
        regressors: (1, ln x, v, v / x), shape (n, 4).
        targets: ln F, shape (n,).
    """

    regressors: Array
    targets: Array

    @classmethod
    def of(cls, pressed: Press) -> Problem:
        """The linearised law (18) on a press."""
        depth, velocity = pressed.depth, pressed.velocity
        return cls(
            np.column_stack([np.ones_like(depth), np.log(depth), velocity, velocity / depth]), np.log(pressed.force)
        )


def press(size: int, deepest: float = DEEPEST, noise: float = 0.01) -> Press:
    """A press of a Hunt-Crossley material, in and out between 2 mm and the deepest, at 20 mm/s and 1 kHz.

    Args:
        size: Samples.
        deepest: [m], more than 2 mm.
        noise: Standard deviation of ln F.
    """
    time: Array = PERIOD * np.arange(size, dtype=np.float64)
    phase = np.mod(SPEED * time / (deepest - SHALLOWEST), 2.0)
    depth = SHALLOWEST + (deepest - SHALLOWEST) * np.where(phase < 1.0, phase, 2.0 - phase)
    velocity: Array = np.where(phase < 1.0, SPEED, -SPEED)
    errors = noise * np.random.default_rng(0).standard_normal(size)
    force: Array = np.exp(errors) * depth**EXPONENT * (STIFFNESS + DAMPING * velocity)
    return Press(time, depth, velocity, force)


def samples(pressed: Press) -> list[ContactSample]:
    """What `update` takes, one a sample."""
    columns = [column.tolist() for column in pressed]
    return [ContactSample(time, depth, speed, force, True) for time, depth, speed, force in zip(*columns, strict=True)]


def _recursion(regressors: Array, targets: Array, forgetting_factor: float, initial_covariance: float) -> Array:
    """Equation (20) with a constant mu, loop by loop over whole matrices."""
    samples, size = regressors.shape
    theta = np.zeros(size)
    covariance = initial_covariance * np.eye(size)
    projected = np.empty(size)
    for k in range(samples):
        innovation, denominator = targets[k], forgetting_factor
        for i in range(size):
            innovation -= regressors[k, i] * theta[i]
            total = 0.0
            for j in range(size):
                total += covariance[i, j] * regressors[k, j]
            projected[i] = total
            denominator += regressors[k, i] * total
        for i in range(size):
            gain = projected[i] / denominator
            theta[i] += gain * innovation
            for j in range(size):
                covariance[i, j] = (covariance[i, j] - gain * projected[j]) / forgetting_factor
    return theta


_compiled = compiled(_recursion)


def recursion_over(problem: Problem) -> Array:
    """Theta after a whole problem, shape (4,), from theta_0 = 0, with the constants of `foretouch.bench.press`.

    Args:
        problem: Regressors and targets.
    """
    return _compiled(problem.regressors, problem.targets, FORGETTING_FACTOR, INITIAL_COVARIANCE)


def _add(state: Array, one: float, other: float, third: float, fourth: float) -> int:
    state[0] += one * other + third * fourth
    return 1


bare_call = compiled(_add)
"""A compiled call with an array and four numbers that does next to nothing: what any call from Python costs."""


def _enlarge(matrix: Array, vector: Array, rounds: int) -> None:
    for _ in range(rounds):
        for i in range(vector.size):
            for j in range(vector.size):
                matrix[i, j] += vector[i] * vector[j]


_compiled_enlarge = compiled(_enlarge)


def rank_one_updates(rounds: int) -> Array:
    """Sums of outer products of 256 numbers: half a megabyte that is read and written, as a covariance's is.

    What shares a cache with other programs becomes slower with them, where small loops do not: it is held against this.

    Args:
        rounds: How many are added.

    Returns:
        The sum, shape (256, 256).
    """
    matrix = np.zeros((256, 256))
    _compiled_enlarge(matrix, np.linspace(0.0, 1.0, 256), rounds)
    return matrix


def recursion_over_many(regressors: Array, targets: Array, forgetting_factor: Array) -> Array:
    """Equation (20) without its perturbation, from theta_0 = 0 and P_0 = p I.

    Args:
        regressors: Phi of m samples of n streams, shape (m, 4, n): streams innermost, as it is fastest.
        targets: ln F, shape (m, n).
        forgetting_factor: mu, shape (m, n).

    Returns:
        Theta after the last sample, shape (n, 4).
    """
    _, size, streams = regressors.shape
    theta = np.zeros((size, streams))
    covariance = np.zeros((size, size, streams))
    covariance[range(size), range(size)] = INITIAL_COVARIANCE
    for regressor, target, mu in zip(regressors, targets, forgetting_factor, strict=True):
        projected = (covariance * regressor).sum(axis=1)
        gain = projected / (mu + (regressor * projected).sum(axis=0))
        theta += gain * (target - (regressor * theta).sum(axis=0))
        covariance -= gain[:, None] * projected
        covariance /= mu
    return theta.T
