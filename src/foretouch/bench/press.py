"""The press that benchmarks identify: in and out at constant speed, so that the paper's mu is one number."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import ContactSample, FPRLSOptions
from foretouch.identification.fprls import forgetting_by_distance

__all__ = ["FORGETTING_FACTOR", "INITIAL_COVARIANCE", "OPTIONS", "Press", "Problem", "press", "samples"]

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
