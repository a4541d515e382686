"""How late a force sensor is against the encoders, as far as contact itself can tell."""

from __future__ import annotations

import math

import numpy as np

from foretouch.identification.sensor_lag_kernel import PRODUCTS, SIZE, TIME, WEIGHT, clear, take_lagged

__all__ = ["LONGEST_LAG", "SensorLag"]

LONGEST_LAG = 0.05
"""No sensor is later than this [s]."""

LEAST_TIME = 0.2
"""Nothing is said from less moving contact [s]."""


class SensorLag:
    r"""The least lag that a passive material allows, from samples in moving contact.

    To first order a force that is felt :math:`\delta` late is

    .. math:: F = F_0 + K x + (B - K \delta) \dot x

    so that lag and damping cannot be told apart: only :math:`\tau = B / K - \delta` is seen. A material does not push
    itself along, B >= 0, hence :math:`\delta \ge -\tau`. On a spring that is the lag itself; where the material damps
    more than the sensor lags, the estimate is 0. F_0, K and the slope over velocity come from least squares that fade
    over 5 s of moving contact.

    Attributes:
        memory: All that is remembered, by `sensor_lag_kernel`.
    """

    __slots__ = ("memory",)

    def __init__(self) -> None:
        self.memory = np.empty(SIZE)
        self.reset()
        take_lagged(self.memory, 0.0, 0.0, 0.0, 0.0)  # compiled here, before any loop

    def reset(self) -> None:
        """Forget all samples."""
        clear(self.memory)

    def update(self, position: float, velocity: float, force: float, period: float) -> None:
        """Take one sample in contact.

        Args:
            position: [m].
            velocity: [m/s]; slower ones than 2 mm/s are left out.
            force: [N].
            period: Since the sample before [s].
        """
        take_lagged(self.memory, position, velocity, force, period)

    @property
    def time(self) -> float:
        """In moving contact so far [s]."""
        return float(self.memory[TIME])

    @property
    def lag(self) -> float | None:
        """Least lag [s], 0 to 0.05; None while too little is known."""
        found = self._slopes()
        if found is None:
            return None
        stiffness, slope, _ = found
        return min(max(-slope / stiffness, 0.0), LONGEST_LAG)

    @property
    def standard_error(self) -> float | None:
        """Of the lag [s], as if residuals were alike for 20 ms; None while too little is known."""
        found = self._slopes()
        if found is None:
            return None
        stiffness, _, residual = found
        xx, xv, vv = self.memory[PRODUCTS : PRODUCTS + 3].tolist()
        independent = max(float(self.memory[WEIGHT]) / 0.02, 1.0)
        return math.sqrt(residual * xx / (xx * vv - xv * xv) / independent) / stiffness

    def _slopes(self) -> tuple[float, float, float] | None:
        """K [N/m], B - K delta [N s/m] and the variance of what they leave [N^2]."""
        xx, xv, vv, xf, vf, ff = self.memory[PRODUCTS:].tolist()
        determinant = xx * vv - xv * xv
        if self.time < LEAST_TIME or not determinant > 1e-6 * xx * vv:
            return None
        stiffness, slope = (xf * vv - vf * xv) / determinant, (vf * xx - xf * xv) / determinant
        if not stiffness > 0.0:
            return None
        return stiffness, slope, max(ff - stiffness * xf - slope * vf, 0.0)
