"""Synthetic presses for the tests of identification."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from foretouch.models import ContactModel, HuntCrossley, MotionFilter
from foretouch.quantities import Recording

SOFT = HuntCrossley(3000.0, 300.0, 1.4)


@cache
def press(
    law: ContactModel = SOFT,
    *,
    duration: float = 6.0,
    rate: float = 1000.0,
    surface: float = 0.01,
    offset: float = 0.3,
    noise: float = 0.0,
    deepest: float = 0.01,
    seed: int = 0,
) -> Recording:
    """One second in free air, then presses of two frequencies, out of contact in between; made once."""
    time = np.arange(0.0, duration, 1.0 / rate)
    t = np.maximum(time - 1.0, 0.0)
    depth = deepest * (np.sin(2 * np.pi * 0.8 * t) * (0.7 + 0.3 * np.sin(2 * np.pi * 0.31 * t)) - 0.05)
    velocity = np.gradient(depth, time)
    force = np.array(
        [law.advance((), x, v, 1 / rate)[1] for x, v in zip(depth.tolist(), velocity.tolist(), strict=True)]
    )
    return Recording(time, surface + depth, force + offset + np.random.default_rng(seed).normal(0.0, noise, time.size))


def true_force(recording: Recording, law: ContactModel = SOFT, surface: float = 0.01) -> NDArray[np.float64]:
    """What the law gives for the recorded motion, with the velocity that an observer has."""
    velocity = MotionFilter().run(recording.time, recording.position)
    depth = recording.position - surface
    return np.array([law.advance((), x, v, 1e-3)[1] for x, v in zip(depth, velocity, strict=True)])
