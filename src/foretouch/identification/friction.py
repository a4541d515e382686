"""Friction: coefficient and viscous part from sliding, the bristles' stiffness from sticking; compiled."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled
from foretouch.identification.estimator import Status
from foretouch.quantities.pose import Vector

SLOWEST = 2e-3  # Least speed of sliding [m/s]: below it the probe may stick
LEAST_NORMAL_FORCE = 0.3  # Least normal force [N]: below it the sensor's noise would be learnt
LEAST_WAY = 1e-3  # Least distance in one direction [m]: before it tool and material still bend instead of sliding
SAME_DIRECTION = 0.7  # Least cosine to the direction in which the motion began; below it another motion begins
SMOOTHING = 0.01  # Time constant of the low-pass of velocity and forces [s]

FORCE_NOISE, SHARE_NOISE = 0.05, 0.05
"""Standard deviation of the tangential force: constant [N], and the fraction that no law of friction explains."""

MEMORY = 10.0  # Time constant of sliding after which samples are forgotten [s]: surfaces get wet, and dry

PRIOR = (0.3, 0.0)
LARGEST_A, LARGEST_D = 0.5**2, 2.0**2  # Variances of mu [-] and c [N s/m] before the first sample

FEWEST, SURE = 50, 0.1
"""Least number of samples, and largest standard deviation of mu, for a known coefficient."""

STUCK = 0.5  # Largest tangential force of a probe that sticks, as a fraction of that with which it slides

LARGEST_K = 1e4**2  # Variance of the bristles' stiffness before the first sample [N^2/m^2]

STUCK_SURE = 0.2  # Largest relative standard deviation of a known stiffness of the bristles

LARGEST_COEFFICIENT = 2.0  # Largest coefficient of a surface [-]

LARGEST_FORCE = 1e3  # Largest force of a sample [N]; others are left out
LARGEST_SPEED = 10.0  # Largest speed of a sample [m/s]; others are left out

LEARNT, UNUSABLE, GATED, WAITING = range(4)
RESULTS = Status.LEARNT, Status.UNUSABLE, Status.GATED, Status.WAITING


class Friction(Record):
    """State of a `FrictionEstimator`."""

    theta: Annotated[NDArray[np.float64], float, 2] = PRIOR  # type: ignore[assignment]  # mu [-] and c [N s/m]
    covariance: Annotated[NDArray[np.float64], float, 3] = (LARGEST_A, 0.0, LARGEST_D)  # type: ignore[assignment]
    filtered: Annotated[NDArray[np.float64], float, 7] = math.nan  # type: ignore[assignment]  # the low-passed sample
    start: Annotated[NDArray[np.float64], float, 3]  # direction in which the motion began
    way: float  # distance in one direction [m]
    updates: int
    bent: Annotated[NDArray[np.float64], float, 3]  # way along the surface since the probe sticks [m]
    began: Annotated[NDArray[np.float64], float, 3] = math.nan  # type: ignore[assignment]  # force there [N], or NaN
    stiffness: float  # of the bristles [N/m]
    spread: float = LARGEST_K  # and its variance


@compiled
def _goes_on(friction: Friction, direction: Vector, step: float) -> bool:
    """Whether the probe has gone far enough in one direction."""
    start = friction.start
    dx, dy, dz = direction
    if friction.way == 0.0 or dx * start[0] + dy * start[1] + dz * start[2] < SAME_DIRECTION:
        start[0], start[1], start[2] = direction
        friction.way = 0.0
    friction.way += step
    return bool(friction.way >= LEAST_WAY)


@compiled(error_model="numpy")
def _learn(friction: Friction, pressed: float, speed: float, against: float, period: float, share: float) -> None:
    """One step of recursive least squares with forgetting, in the form of Joseph."""
    theta, covariance = friction.theta, friction.covariance
    mu, c = theta[0], theta[1]
    forget = math.exp(period / MEMORY)
    a, d = min(covariance[0] * forget, LARGEST_A), min(covariance[2] * forget, LARGEST_D)
    b = min(max(covariance[1] * forget, -math.sqrt(a * d)), math.sqrt(a * d))
    noise = (FORCE_NOISE * FORCE_NOISE + (SHARE_NOISE * against) * (SHARE_NOISE * against)) / share
    error = against - mu * pressed - c * speed
    ha, hd = a * pressed + b * speed, b * pressed + d * speed
    expected = pressed * ha + speed * hd + noise
    if error * error > 9.0 * expected:  # outliers from bumps and catching weigh less
        noise += error * error / 9.0 - expected
        expected = error * error / 9.0
    ga, gd = ha / expected, hd / expected
    theta[0], theta[1] = mu + ga * error, c + gd * error
    p, q, r, s = 1.0 - ga * pressed, -ga * speed, -gd * pressed, 1.0 - gd * speed
    covariance[0] = p * (p * a + q * b) + q * (p * b + q * d) + noise * ga * ga
    covariance[1] = r * (p * a + q * b) + s * (p * b + q * d) + noise * ga * gd
    covariance[2] = r * (r * a + s * b) + s * (r * b + s * d) + noise * gd * gd
    friction.updates += 1


@compiled(error_model="numpy")
def _stick(friction: Friction, period: float, share: float) -> None:
    """One step of recursive least squares of the bristles' stiffness, from how the force grows as the probe sticks."""
    now, bent, began, c = friction.filtered, friction.bent, friction.began, max(friction.theta[1], 0.0)
    rubbed = math.sqrt(now[1] * now[1] + now[2] * now[2] + now[3] * now[3])
    if now[0] < LEAST_NORMAL_FORCE or friction.updates < FEWEST or rubbed >= STUCK * friction.theta[0] * now[0]:
        began[0] = math.nan
        return
    if math.isnan(began[0]):
        for k in range(3):
            bent[k], began[k] = 0.0, now[1 + k] + c * now[4 + k]
        return
    square = along = against = speed = 0.0
    for k in range(3):
        against -= now[1 + k] * now[4 + k]
        speed += now[4 + k] * now[4 + k]
    part = against / (math.sqrt(speed) * friction.theta[0] * now[0]) if speed > 0.0 else 0.0
    for k in range(3):
        bent[k] += (1.0 - part) * now[4 + k] * period
        square += bent[k] * bent[k]
        along -= bent[k] * (now[1 + k] + c * now[4 + k] - began[k])
    if not square > 0.0:
        return
    way, spread = math.sqrt(square), min(friction.spread * math.exp(period / MEMORY), LARGEST_K)
    expected = square * spread + FORCE_NOISE * FORCE_NOISE / share
    gain = spread * way / expected
    friction.stiffness += gain * (along / way - friction.stiffness * way)
    friction.spread = spread * (1.0 - gain * way)


@compiled(error_model="numpy")
def learn_friction(friction: Friction, pressed: float, rubbed: Vector, sliding: Vector, period: float) -> int:
    """See `FrictionEstimator.update`; the result is an index into `RESULTS`."""
    values = (pressed, rubbed[0], rubbed[1], rubbed[2], sliding[0], sliding[1], sliding[2])
    if not 0.0 < period < 1.0:
        return UNUSABLE
    for k in range(7):
        if not abs(values[k]) <= (LARGEST_FORCE if k < 4 else LARGEST_SPEED):
            return UNUSABLE
    weight, now = -math.expm1(-period / SMOOTHING), friction.filtered
    first = math.isnan(now[0])
    for k in range(7):
        before = values[k] if first else now[k]
        now[k] = before + weight * (values[k] - before)
    _stick(friction, period, weight)
    vx, vy, vz = now[4], now[5], now[6]
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    if speed < SLOWEST or now[0] < LEAST_NORMAL_FORCE:
        friction.way = 0.0
        return GATED
    if not _goes_on(friction, (vx / speed, vy / speed, vz / speed), speed * period):
        return WAITING
    against = -(now[1] * vx + now[2] * vy + now[3] * vz) / speed
    _learn(friction, now[0], speed, against, period, weight)
    return LEARNT


_update = Kernel(learn_friction, "i8(Friction, f8, UniTuple(f8, 3), UniTuple(f8, 3), f8)")


class FrictionEstimator(Held):
    r"""Recursive least squares of Coulomb and viscous friction on the force against the sliding, and of the bristles.

    .. math:: -f_t \cdot \frac{v}{|v|} = \mu f_n + c |v|, \qquad
        -(f_t + c v)\big|_{p_0}^{p} = \sigma \int_{p_0}^{p} \left(1 + \frac{f_t \cdot v}{\mu f_n |v|}\right) dp

    The second is of a probe that sticks: from where the force along the surface has fallen below half of
    :math:`\mu f_n`, as where the hand turns, and until it is above that again. It is Dahl's law: bristles bend the less
    the nearer they are to sliding.

    The first is of samples that slide: faster than 2 mm/s, pressed with more than 0.3 N, and 1 mm on the way. Velocity
    and forces are low-passed alike, so that they stay together. Samples are weighted by a noise of 0.05 N and 5 %, and
    by the share of the low-pass's time that they are new; forgetting is by the time slid or stuck, and never beyond
    the prior. Where speed and normal force do not vary, mu and c cannot be told apart: the deviations say so.

    Args:
        frictions: Array of one `Friction` that this one takes, part of another record; None for one of its own.

    Attributes:
        updates: Samples learnt from.
    """

    __slots__ = ()

    updates: int

    def __init__(self, frictions: NDArray[np.void] | None = None) -> None:
        super().__init__(Friction.new() if frictions is None else frictions)
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self.records[:] = Friction.new()

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
        (fx, fy, fz), (vx, vy, vz) = tangential_force, sliding
        return RESULTS[_update.entry(self.records[0], normal_force, (fx, fy, fz), (vx, vy, vz), period)]

    @property
    def _bounded(self) -> tuple[float, float]:
        """The best mu and c within their bounds: where c would be negative it is 0, and mu what fits best with that."""
        (mu, c), (_, b, d) = self.records["theta"][0].tolist(), self.records["covariance"][0].tolist()
        if c < 0.0:
            mu, c = mu - b / d * c, 0.0
        return min(max(mu, 0.0), LARGEST_COEFFICIENT), c

    @property
    def coefficient(self) -> float:
        """The coefficient mu [-], 0 to 2."""
        return self._bounded[0]

    @property
    def viscous(self) -> float:
        """The viscous part c [N s/m], not negative."""
        return self._bounded[1]

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of mu [-] and c [N s/m]."""
        a, _, d = self.records["covariance"][0].tolist()
        return math.sqrt(max(a, 0.0)), math.sqrt(max(d, 0.0))

    @property
    def stiffness(self) -> float:
        """Stiffness sigma of the bristles along the surface [N/m], not negative."""
        return max(float(self.records["stiffness"][0]), 0.0)

    @property
    def stiffness_deviation(self) -> float:
        """Its standard deviation [N/m]."""
        return math.sqrt(float(self.records["spread"][0]))

    @property
    def sticks(self) -> bool:
        """Whether the stiffness of the bristles is certain enough to render: to 20 %."""
        return self.stiffness_deviation < STUCK_SURE * self.stiffness

    @property
    def numbers(self) -> tuple[float, ...]:
        """What is told of it: mu, c and their deviations; nothing before mu is certain enough.

        The bristles' stiffness is not: in a session the force comes later than the motion, and they seem too soft.
        """
        return (self.coefficient, self.viscous, *self.deviations) if self.known else ()

    @property
    def known(self) -> bool:
        """Whether mu is certain enough to render: to 0.1, from 50 samples or more."""
        return self.updates >= FEWEST and self.deviations[0] < SURE
