"""Bare compiled loops, written as anybody would: what ours is held against where no peer is installed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.press import FORGETTING_FACTOR, INITIAL_COVARIANCE, Problem
from foretouch.core.compiling import compiled

__all__ = ["bare_call", "rank_one_updates", "recursion_over"]

Array = NDArray[np.float64]


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
