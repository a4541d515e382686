"""Friction from sliding: coefficient and viscous part, and their standard deviations."""

from __future__ import annotations

import math
from collections.abc import Sequence

from foretouch.identification.estimator import Status

SLOWEST = 2e-3  # Least speed of sliding [m/s]: below it the probe may stick
LEAST_NORMAL_FORCE = 0.3  # Least normal force [N]: below it the sensor's noise would be learnt
LEAST_WAY = 1e-3  # Least distance in one direction [m]: before it tool and material still bend instead of sliding
SAME_DIRECTION = 0.7  # Least cosine to the direction in which the motion began; below it another motion begins
SMOOTHING = 0.01  # Time constant of the low-pass of velocity and forces [s]

FORCE_NOISE, SHARE_NOISE = 0.05, 0.05
"""Standard deviation of the tangential force: constant [N], and the fraction that no law of friction explains."""

MEMORY = 10.0  # Time constant of sliding after which samples are forgotten [s]: surfaces get wet, and dry

PRIOR = (0.3, 0.0)
PRIOR_DEVIATIONS = (0.5, 2.0)  # Standard deviations of mu [-] and c [N s/m] before the first sample

FEWEST, SURE = 50, 0.1
"""Least number of samples, and largest standard deviation of mu, for a known coefficient."""

LARGEST_COEFFICIENT = 2.0  # Largest coefficient of a surface [-]

LARGEST_FORCE = 1e3
"""Largest force of a sample [N]; others are left out."""

LARGEST_SPEED = 10.0  # Largest speed of a sample [m/s]; others are left out


class FrictionEstimator:
    r"""Recursive least squares of Coulomb and viscous friction on the force against the sliding.

    .. math:: -f_t \cdot \frac{v}{|v|} = \mu f_n + c |v|

    Only from samples that slide: faster than 2 mm/s, pressed with more than 0.3 N, and 1 mm on the way. Velocity and
    forces are low-passed alike, so that they stay together. Samples are weighted by a noise of 0.05 N and 5 %, and by
    the share of the low-pass's time that they are new; forgetting is by the time slid, and never beyond the prior.
    Where speed and normal force do not vary, mu and c cannot be told apart: the deviations say so.

    Attributes:
        coefficient: mu [-], 0 to 2.
        viscous: c [N s/m], not negative.
        deviations: Standard deviation of each.
        known: Whether mu is known to 0.1, from 50 samples or more.
        updates: Samples learnt from.
    """

    __slots__ = ("_covariance", "_filtered", "_start", "_theta", "_way", "updates")

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._theta = PRIOR
        self._covariance = (PRIOR_DEVIATIONS[0] ** 2, 0.0, PRIOR_DEVIATIONS[1] ** 2)
        self._filtered: list[float] | None = None
        self._start = (0.0, 0.0, 0.0)
        self._way = 0.0
        self.updates = 0

    def update(
        self, normal_force: float, tangential_force: Sequence[float], sliding: Sequence[float], period: float
    ) -> Status:
        """Learn from one sample in contact; never raises.

        Args:
            normal_force: Normal force f_n of the probe [N].
            tangential_force: Force f_t on the probe along the surface [N], three numbers.
            sliding: Velocity v of the probe along the surface [m/s], three numbers.
            period: Time since the previous sample [s].
        """
        values = [normal_force, *tangential_force, *sliding]
        if not (0.0 < period < 1.0 and math.isfinite(sum(values))):
            return Status.UNUSABLE
        if max(map(abs, values[:4])) > LARGEST_FORCE or max(map(abs, values[4:])) > LARGEST_SPEED:
            return Status.UNUSABLE
        weight = -math.expm1(-period / SMOOTHING)
        before = self._filtered or values
        self._filtered = now = [old + weight * (new - old) for old, new in zip(before, values, strict=True)]
        pressed, fx, fy, fz, vx, vy, vz = now
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        if speed < SLOWEST or pressed < LEAST_NORMAL_FORCE:
            self._way = 0.0
            return Status.GATED
        if not self._goes_on(vx / speed, vy / speed, vz / speed, speed * period):
            return Status.WAITING
        against = -(fx * vx + fy * vy + fz * vz) / speed
        self._learn(pressed, speed, against, period, weight)
        return Status.LEARNT

    def _goes_on(self, dx: float, dy: float, dz: float, step: float) -> bool:
        """Whether the probe has gone far enough in one direction."""
        start = self._start
        if self._way == 0.0 or dx * start[0] + dy * start[1] + dz * start[2] < SAME_DIRECTION:
            self._start, self._way = (dx, dy, dz), 0.0
        self._way += step
        return self._way >= LEAST_WAY

    def _learn(self, pressed: float, speed: float, against: float, period: float, share: float) -> None:
        """One step of recursive least squares with forgetting, in the form of Joseph."""
        mu, c = self._theta
        forget = math.exp(period / MEMORY)
        a = min(self._covariance[0] * forget, PRIOR_DEVIATIONS[0] ** 2)
        d = min(self._covariance[2] * forget, PRIOR_DEVIATIONS[1] ** 2)
        b = min(max(self._covariance[1] * forget, -math.sqrt(a * d)), math.sqrt(a * d))
        noise = (FORCE_NOISE**2 + (SHARE_NOISE * against) ** 2) / share
        error = against - mu * pressed - c * speed
        ha, hd = a * pressed + b * speed, b * pressed + d * speed
        expected = pressed * ha + speed * hd + noise
        if error * error > 9.0 * expected:  # outliers from bumps and catching weigh less
            noise += error * error / 9.0 - expected
            expected = error * error / 9.0
        ga, gd = ha / expected, hd / expected
        self._theta = (mu + ga * error, c + gd * error)
        p, q, r, s = 1.0 - ga * pressed, -ga * speed, -gd * pressed, 1.0 - gd * speed
        self._covariance = (
            p * (p * a + q * b) + q * (p * b + q * d) + noise * ga * ga,
            r * (p * a + q * b) + s * (p * b + q * d) + noise * ga * gd,
            r * (r * a + s * b) + s * (r * b + s * d) + noise * gd * gd,
        )
        self.updates += 1

    @property
    def _bounded(self) -> tuple[float, float]:
        """The best mu and c within their bounds: where c would be negative it is 0, and mu what fits best with that."""
        mu, c = self._theta
        if c < 0.0:
            mu, c = mu - self._covariance[1] / self._covariance[2] * c, 0.0
        return min(max(mu, 0.0), LARGEST_COEFFICIENT), c

    @property
    def coefficient(self) -> float:
        """The coefficient mu [-]."""
        return self._bounded[0]

    @property
    def viscous(self) -> float:
        """The viscous part c [N s/m]."""
        return self._bounded[1]

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of mu [-] and c [N s/m]."""
        return math.sqrt(max(self._covariance[0], 0.0)), math.sqrt(max(self._covariance[2], 0.0))

    @property
    def known(self) -> bool:
        """Whether mu is certain enough to render."""
        return self.updates >= FEWEST and self.deviations[0] < SURE
