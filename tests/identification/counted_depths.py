"""The histogram of depths, counted in plain Python: what the compiled estimators are tested against."""

from __future__ import annotations

import math

import numpy as np

from foretouch.identification.linear.recovery import BINS_PER_DECADE, DECADES, DEEPEST


class CountedDepths:
    """A histogram that counts samples one by one."""

    def __init__(self) -> None:
        self.weights = np.zeros(BINS_PER_DECADE * DECADES)

    def add(self, depth: float, velocity: float, forgetting_factor: float = 1.0, weight: float = 1.0) -> None:
        """One sample: depth [m], velocity [m/s], mu and w of the recursion's step."""
        place = (math.log10(max(depth, 1e-9) / DEEPEST) + DECADES) * BINS_PER_DECADE
        index = min(max(int(place), 0), self.weights.size - 1)
        self.weights *= forgetting_factor
        self.weights[index] += weight * min(velocity * velocity, 1e6)
