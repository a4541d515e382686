r"""The same recursive least squares by others: padasip, filterpy and river.

All begin at theta_0 = 0 and P_0 = p I and forget by the same constant mu, as the paper's (20) without its
perturbation. What each calls these differs:

- padasip `FilterRLS`: `mu`, and `eps` = 1 / p.
- filterpy `KalmanFilter`: a state that stays, F = I and Q = 0, with fading memory alpha^2 = 1 / mu and R = mu. Its
  prediction comes first and divides P by mu, so that P begins at mu p I.
- river `BayesianLinearRegression`: `smoothing` = mu weights a sample by (1 - mu) beta, so beta = 1 / (1 - mu); its
  prior with smoothing is I / `alpha` as a precision, so alpha = p. It inverts a matrix in each step. Without smoothing,
  mu = 1, it does not: then beta = 1, and its prior is I / alpha as a covariance, so alpha = 1 / p. It learns alone,
  `learn_one`: nobody asks it for the prediction before.

Each is given a sample a call, which is what its interface has.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.bench.press import FORGETTING_FACTOR, INITIAL_COVARIANCE, Problem
from foretouch.errors import install_command

__all__ = ["PEERS", "RIVER_WITHOUT_FORGETTING", "Peer", "peer"]

Array = NDArray[np.float64]

Peer = Callable[[], Array]
"""Runs the whole problem from the beginning and returns the last theta, shape (4,)."""

RIVER_WITHOUT_FORGETTING = "river, mu = 1"
"""River as it is fastest."""


def _padasip(problem: Problem) -> Peer:
    padasip = _import("padasip")

    def run() -> Array:
        filtered = padasip.filters.FilterRLS(4, mu=FORGETTING_FACTOR, eps=1.0 / INITIAL_COVARIANCE, w="zeros")
        for regressor, target in zip(problem.regressors, targets, strict=True):
            filtered.adapt(target, regressor)
        return np.array(filtered.w)

    targets = problem.targets.tolist()
    return run


def _filterpy(problem: Problem) -> Peer:
    kalman = _import("filterpy.kalman")

    def run() -> Array:
        filtered = kalman.KalmanFilter(dim_x=4, dim_z=1)
        filtered.x, filtered.P = np.zeros((4, 1)), np.eye(4) * INITIAL_COVARIANCE * FORGETTING_FACTOR
        filtered.F, filtered.Q, filtered.R = np.eye(4), np.zeros((4, 4)), np.array([[FORGETTING_FACTOR]])
        filtered.alpha = FORGETTING_FACTOR**-0.5
        for row, target in zip(rows, targets, strict=True):
            filtered.predict()
            filtered.update(target, H=row)
        return np.array(filtered.x).ravel()

    rows, targets = list(problem.regressors[:, None, :]), problem.targets.tolist()
    return run


def _river(problem: Problem, forgetting_factor: float = FORGETTING_FACTOR) -> Peer:
    linear_model = _import("river.linear_model")
    if forgetting_factor < 1.0:
        beta, alpha, smoothing = 1.0 / (1.0 - forgetting_factor), INITIAL_COVARIANCE, forgetting_factor
    else:
        beta, alpha, smoothing = 1.0, 1.0 / INITIAL_COVARIANCE, None

    def run() -> Array:
        learner = linear_model.BayesianLinearRegression(alpha=alpha, beta=beta, smoothing=smoothing)
        for row, target in zip(rows, targets, strict=True):
            learner.learn_one(row, target)
        # theta_i is the prediction of the unit vector i.
        return np.array([learner.predict_one({name: float(name == one) for name in names}) for one in names])

    names = range(problem.regressors.shape[1])
    rows = [dict(zip(names, row, strict=True)) for row in problem.regressors.tolist()]
    targets = problem.targets.tolist()
    return run


def _river_without_forgetting(problem: Problem) -> Peer:
    return _river(problem, 1.0)


PEERS: dict[str, Callable[[Problem], Peer]] = {
    "padasip": _padasip,
    "filterpy": _filterpy,
    "river": _river,
    RIVER_WITHOUT_FORGETTING: _river_without_forgetting,
}
"""By name."""


def peer(name: str, problem: Problem, say: Callable[[str], None]) -> Peer | None:
    """A peer on a problem; None, said in one line, where its package is not installed.

    Args:
        name: Of `PEERS`.
        problem: What it is given.
        say: Told why it is left out.
    """
    try:
        return PEERS[name](problem)
    except ImportError as error:
        package = name.partition(",")[0]
        say(f"{package} is left out ({error}): {install_command('bench')}")
        return None


def _import(name: str) -> Any:
    with warnings.catch_warnings():  # of their own house
        warnings.simplefilter("ignore")
        return importlib.import_module(name)
