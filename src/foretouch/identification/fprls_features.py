"""What the compiled linear estimators make of a sample before they learn from it: refusal, rate, weight, forgetting."""

from __future__ import annotations

from typing import Any

import numpy as np

from foretouch.core.compiling import compiled
from foretouch.identification.elementary import exponential
from foretouch.identification.fprls_layout import (
    GATED,
    LEARNT,
    UNUSABLE,
)
from foretouch.identification.robust import SMALLEST_DEPTH, SMALLEST_FORCE

__all__ = ["bounded_rate", "forgetting", "refusal", "weight_of"]

FADED = 40.0
"""exp(-40) of the share of mu that fades is no longer a digit of it."""


_inlined = compiled(error_model="numpy", forceinline=True)


def _refusal(depth: float, velocity: float, force: float, gate_depth: float, gate_force: float) -> int:
    """LEARNT, UNUSABLE or GATED, of a sample in contact."""
    usable = (
        (depth >= SMALLEST_DEPTH)
        & (depth < np.inf)
        & (force >= SMALLEST_FORCE)
        & (force < np.inf)
        & (velocity - velocity == 0.0)
    )
    shut = (force < gate_force) | (depth < gate_depth)
    return UNUSABLE if not usable else GATED if shut else LEARNT


def _weight_of(force: float, factor: float) -> float:
    """(F / weight_force)^2 within 1e-12 and 1e12; 1 where the factor is 0."""
    share = force * factor
    square = share * share
    square = square if square > 1e-12 else 1e-12
    square = square if square < 1e12 else 1e12
    return square if factor > 0.0 else 1.0


def _bounded_rate(depth: float, velocity: float, largest: float) -> float:
    """Velocity over depth within its bound [1/s]."""
    rate = velocity / depth
    rate = rate if rate > -largest else -largest
    return rate if rate < largest else largest


def _forgetting(moved: float, floor: float, share: float, rate: float) -> float:
    """The forgetting factor mu after this path [m]."""
    faded = rate * moved
    return floor + share * exponential(-(faded if faded < FADED else FADED))


refusal: Any = _inlined(_refusal)
weight_of: Any = _inlined(_weight_of)
bounded_rate: Any = _inlined(_bounded_rate)
forgetting: Any = _inlined(_forgetting)
