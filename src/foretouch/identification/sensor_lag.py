"""How late a force sensor is against the encoders, as far as contact itself can tell."""

from __future__ import annotations

import math

__all__ = ["LONGEST_LAG", "SensorLag"]

LONGEST_LAG = 0.05
"""No sensor is later than this [s]."""

MEMORY = 5.0
"""Time in moving contact over which samples are remembered [s]."""

SLOWEST = 2e-3
"""Slower than this [m/s] nothing tells a lag."""

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
        time: In moving contact so far [s].
    """

    __slots__ = ("_means", "_origin", "_products", "_weight", "time")

    def __init__(self) -> None:
        self.time = 0.0
        self._weight = 0.0
        self._origin: tuple[float, float] | None = None  # so that what is squared stays small
        self._means = (0.0, 0.0, 0.0)  # of position, velocity, force
        self._products = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # centred: xx, xv, vv, xF, vF, FF

    def update(self, position: float, velocity: float, force: float, period: float) -> None:
        """Take one sample in contact.

        Args:
            position: [m].
            velocity: [m/s]; slower ones than 2 mm/s are left out.
            force: [N].
            period: Since the sample before [s].
        """
        if abs(velocity) < SLOWEST or not 0.0 < period < 1.0:
            return
        if self._origin is None:
            self._origin = (position, force)
        fading = math.exp(-period / MEMORY)
        self.time += period
        self._weight = self._weight * fading + period
        share = period / self._weight
        kept = 1.0 - share
        # Number by number: a loop over them would cost three times as much, a thousand times a second.
        mean_x, mean_v, mean_f = self._means
        x = position - self._origin[0] - mean_x
        v = velocity - mean_v
        f = force - self._origin[1] - mean_f
        self._means = (mean_x + share * x, mean_v + share * v, mean_f + share * f)
        xx, xv, vv, xf, vf, ff = self._products
        self._products = (
            kept * (xx + share * (x * x)),
            kept * (xv + share * (x * v)),
            kept * (vv + share * (v * v)),
            kept * (xf + share * (x * f)),
            kept * (vf + share * (v * f)),
            kept * (ff + share * (f * f)),
        )

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
        xx, xv, vv = self._products[:3]
        independent = max(self._weight / 0.02, 1.0)
        return math.sqrt(residual * xx / (xx * vv - xv * xv) / independent) / stiffness

    def _slopes(self) -> tuple[float, float, float] | None:
        """K [N/m], B - K delta [N s/m] and the variance of what they leave [N^2]."""
        xx, xv, vv, xf, vf, ff = self._products
        determinant = xx * vv - xv * xv
        if self.time < LEAST_TIME or not determinant > 1e-6 * xx * vv:
            return None
        stiffness, slope = (xf * vv - vf * xv) / determinant, (vf * xx - xf * xv) / determinant
        if not stiffness > 0.0:
            return None
        return stiffness, slope, max(ff - stiffness * xf - slope * vf, 0.0)
