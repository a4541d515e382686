"""The penetration trajectories of the paper, position and analytic velocity, in metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import SettingError

__all__ = ["START_DEPTH", "WAVES", "linearisation_press", "two_presses"]

Array = NDArray[np.float64]

START_DEPTH = 0.020
"""Depth about which the trajectory of Fig. 6 swings, and at which it starts: x_0 [m]."""

WAVES = ((0.0025, 2.0), (0.015, 4.0), (-0.005, 6.0), (0.005, 8.0))
"""The sine waves of Fig. 6: amplitude [m] and the time that t is divided by [s]."""


def two_presses(time: ArrayLike, waves: tuple[tuple[float, float], ...] = WAVES) -> tuple[Array, Array]:
    r"""Depth and velocity of Fig. 6, which Figs. 7 and 8 also press along.

    .. math:: x(t) = 20 + 2.5 \sin\frac t2 + 15 \sin\frac t4 - 5 \sin\frac t6 + 5 \sin\frac t8 \;\text{mm}

    Args:
        time: t [s]; the paper's run from 0 to 25.
        waves: Amplitude [m] and divisor of t [s] of each sine wave, for runs with fewer of them.

    Returns:
        Depth [m] and velocity [m/s], each of the shape of `time`.
    """
    t = np.asarray(time, dtype=np.float64)
    depth, velocity = np.full_like(t, START_DEPTH), np.zeros_like(t)
    for amplitude, divisor in waves:
        depth = depth + amplitude * np.sin(t / divisor)
        velocity = velocity + amplitude / divisor * np.cos(t / divisor)
    return depth, velocity


def linearisation_press(time: ArrayLike, *, noise: float = 0.5e-3, seed: int = 0) -> tuple[Array, Array]:
    r"""Depth and velocity of Fig. 5.

    .. math:: x = 40 \sin\frac t4 + 0.5\,\text{rand}() \;\text{mm}

    rand() is even between 0 and 1, drawn anew for each sample. The velocity is that of the sine alone: of the noise
    there is none.

    Args:
        time: t [s], shape (samples,); the depth is positive until 4 pi s.
        noise: Greatest of the noise [m], not negative.
        seed: Of the noise.

    Returns:
        Depth [m] and velocity [m/s], each of the shape of `time`.

    Raises:
        SettingError: A negative noise.
    """
    if not noise >= 0.0:
        raise SettingError("noise", noise, "must not be negative, in m")
    t = np.asarray(time, dtype=np.float64)
    random = np.random.default_rng(seed)
    return 0.040 * np.sin(t / 4.0) + noise * random.random(t.shape), 0.010 * np.cos(t / 4.0)
