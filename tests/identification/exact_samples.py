"""Samples of the exact law (4) for the tests of the estimators that identify it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import ContactSample, Estimator

Array = NDArray[np.float64]
Law = tuple[float, float, float, float]

HUNT_CROSSLEY: Law = (3000.0, 1500.0, 1.4, 0.0)
BETWEEN: Law = (4500.0, 1000.0, 0.7, 0.5)
KELVIN_VOIGT: Law = (6000.0, 500.0, 0.0, 1.0)


def motion(duration: float = 6.0, rate: float = 1000.0) -> tuple[Array, Array, Array]:
    """Time, depth from 0.6 to 15 mm, velocity to 0.1 m/s."""
    time = np.arange(0.0, duration, 1.0 / rate)
    phases = 2 * np.pi * 1.3 * time, 2 * np.pi * 2.9 * time + 1.0
    depth = 0.0078 + 0.0047 * np.sin(phases[0]) + 0.0025 * np.sin(phases[1])
    velocity = 2 * np.pi * (1.3 * 0.0047 * np.cos(phases[0]) + 2.9 * 0.0025 * np.cos(phases[1]))
    return time, depth, velocity


def force_of(law: Law | Sequence[Array], depth: Array, velocity: Array) -> Array:
    """Equation (4) held at zero where it pulls, each number a float or one value a sample."""
    k, damping, n, alpha = law
    return np.maximum(k * depth ** (n + alpha) + damping * depth**n * velocity, 0.0)


def samples(
    law: Law | Callable[[Array], Sequence[Array]] = BETWEEN,
    *,
    noise: float = 0.0,
    seed: int = 0,
    duration: float = 6.0,
    rate: float = 1000.0,
    surface_error: float = 0.0,
) -> list[ContactSample]:
    """Samples, in contact where there is force.

    A law may change over time; `surface_error` [m] is how much too deep the surface is.
    """
    time, depth, velocity = motion(duration, rate)
    force = force_of(law(time) if callable(law) else law, depth, velocity)
    contact = (force > 0.0).tolist()
    force = force + np.random.default_rng(seed).normal(0.0, noise, time.size)
    rows = zip(time.tolist(), (depth - surface_error).tolist(), velocity.tolist(), force.tolist(), contact, strict=True)
    return [ContactSample(*row) for row in rows]


def feed(estimator: Estimator, data: Iterable[ContactSample]) -> None:
    for sample in data:
        estimator.update(sample)
