"""Recordings with all that can be wrong with one, for the paths that a linear estimator takes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import ROBUST, FPRLSOptions, RobustOptions

Array = NDArray[np.float64]
Recorded = tuple[Array, Array, Array, NDArray[np.bool_]]

ODD = (np.nan, np.inf, -np.inf, -1e300, 0.0, 1e-5, 1e300)

OPTIONS: dict[str, FPRLSOptions] = {
    "as printed": FPRLSOptions(),
    "before": FPRLSOptions(perturbation_moment="before"),
    "reset": FPRLSOptions(perturbation_form="reset"),
    "newton": FPRLSOptions(perturbation_error="newton"),
    "millimetres": FPRLSOptions(depth_unit="mm"),
    "breaking": FPRLSOptions(initial_covariance=1e99, perturbation=1e99),
    "forgetting": FPRLSOptions(forgetting_rate=1e7),
    "no test": FPRLSOptions(perturbation=0.0, forgetting_rate=0.0),
    "a start": FPRLSOptions(initial_parameters=(7.0, 1.0, 0.1, 0.001), sensitivity=30.0),
    "gates": FPRLSOptions(robust=RobustOptions(gate_force=0.5, gate_depth=1e-3)),
    "bound": FPRLSOptions(robust=RobustOptions(largest_rate=5.0)),
    "weights": FPRLSOptions(robust=RobustOptions(weight_force=2.0)),
    "trace": FPRLSOptions(robust=RobustOptions(covariance_limit=1e3)),
    "robust": FPRLSOptions(robust=ROBUST),
    "all": FPRLSOptions(
        robust=ROBUST, perturbation_moment="before", perturbation_form="reset", perturbation_error="newton"
    ),
}
"""Each option away from its default at least once."""


def recorded(count: int, seed: int) -> Recorded:
    """In and out of a material that becomes ten times as stiff half way, with numbers that are none strewn in."""
    random = np.random.default_rng(seed)
    time = 0.01 * np.arange(count)
    depth = 0.008 * np.sin(1.7 * time + seed)
    velocity = np.gradient(depth, time) + random.normal(0.0, 0.01, count)
    inside = np.maximum(depth, 1e-4)
    log_force = np.log(np.where(np.arange(count) < count // 2, 3e3, 3e4)) + 1.4 * np.log(inside)
    log_force += 0.5 * velocity + 1e-3 * velocity / inside
    force = np.where(depth > 0.0, np.exp(log_force), 0.0) + random.normal(0.0, 0.05, count)
    in_contact = (force > 0.05) & (random.random(count) > 0.02)
    for column in (depth, velocity, force):
        odd = random.random(count) < 0.02
        column[odd] = random.choice(ODD, np.count_nonzero(odd))
    return depth, velocity, force, in_contact


def columns(recordings: list[Recorded]) -> Recorded:
    """Recordings side by side, shape (m, n) each."""
    depth, velocity, force, in_contact = (np.stack(one, axis=1) for one in zip(*recordings, strict=True))
    return depth, velocity, force, in_contact
