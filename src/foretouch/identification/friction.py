"""Friction: coefficient and viscous part from sliding, the bristles' stiffness from where it turns; compiled."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled
from foretouch.identification.estimator import Status
from foretouch.models.friction_kernel import at_rest
from foretouch.quantities.pose import Vector

SLOWEST = 0.01
"""Least speed of sliding [m/s]: below it the probe may stick, and the encoders' noise turns the direction, so that
friction seems to be less."""

LEAST_NORMAL_FORCE = 0.3  # Least normal force [N]: below it the sensor's noise would be learnt
LEAST_WAY = 1e-3  # Least distance in one direction [m]: before it tool and material still bend instead of sliding
SAME_DIRECTION = 0.7  # Least cosine to the direction in which the motion began; below it another motion begins
SMOOTHING = 5e-3  # Time constant of the low-pass of velocity and forces [s]: the speed of one tick is mostly noise

FORCE_NOISE, SHARE_NOISE = 0.05, 0.05
"""Standard deviation of the tangential force: constant [N], and the fraction that no law of friction explains."""

MEMORY = 10.0  # Time constant of sliding after which samples are forgotten [s]: surfaces get wet, and dry

PRIOR = (0.3, 0.0)
LARGEST_A, LARGEST_D = 0.5**2, 2.0**2  # Variances of mu [-] and c [N s/m] before the first sample

FEWEST, SURE = 50, 0.1
"""Least number of samples, and largest standard deviation of mu, for a known coefficient."""

SOFTEST, STIFFEST, BRISTLES = 300.0, 3e4, 10
"""Range of the bristles' stiffness [N/m], and number of those that are tried in it. A stiffer one bends by less than
the encoders show, and a softer one is the material."""

STEP = math.log(STIFFEST / SOFTEST) / (BRISTLES - 1)
TRIED = tuple(SOFTEST * math.exp(STEP * number) for number in range(BRISTLES))

RATIO, EXCESSES = 0.3, 5
"""Step and number of the excesses of static friction that are tried, as fractions of Coulomb's."""

DRIFT = 0.1
"""Time in which a bristle forgets by how much its force is wrong [s]: what turns takes less, and of what it did before
the contact was felt, and of how the surface gives way, it knows nothing."""

LAW_ERROR, STIFFNESS_SURE = 0.15, 0.25
"""Relative standard deviation of the stiffness for the law, which yields all at once where others do by and by; and the
largest of a known one, with that of the noise."""

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
    bends: Annotated[NDArray[np.float64], float, (BRISTLES + EXCESSES, 3)]  # of the bristles that are tried [m]
    misfits: Annotated[NDArray[np.float64], float, BRISTLES + EXCESSES]  # sums of their squared errors, in variances


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
def _bend(friction: Friction, first: bool, period: float, share: float) -> None:
    """Bend all bristles along, and count by how much the force of each is wrong."""
    now, mu, c = friction.filtered, friction.theta[0], max(friction.theta[1], 0.0)
    cone, slow = max(mu * now[0], 0.0), at_rest(math.sqrt(now[4] * now[4] + now[5] * now[5] + now[6] * now[6]))
    first = first or friction.updates < FEWEST or now[0] < LEAST_NORMAL_FORCE
    variance = (FORCE_NOISE * FORCE_NOISE + (SHARE_NOISE * cone) * (SHARE_NOISE * cone)) / share
    kept, drift = math.exp(-period / MEMORY), -math.expm1(-period / DRIFT)
    best = TRIED[np.argmin(friction.misfits[:BRISTLES])]
    for j in range(BRISTLES + EXCESSES):
        stiffness, most = (TRIED[j], cone) if j < BRISTLES else (best, cone * (1.0 + slow * RATIO * (j - BRISTLES)))
        bend, square = friction.bends[j], 0.0
        for k in range(3):
            bend[k] += now[4 + k] * period
            square += bend[k] * bend[k]
        size, misfit = stiffness * math.sqrt(square), 0.0
        within = most / size if size > most else 1.0
        for k in range(3):
            held = stiffness * bend[k] * within
            wrong = now[1 + k] + c * now[4 + k] + held
            misfit += wrong * wrong
            bend[k] = (held - (1.0 if first else drift) * wrong) / stiffness
        if not first:
            friction.misfits[j] = friction.misfits[j] * kept + misfit / variance


@compiled
def let_go(friction: Friction) -> None:
    """The contact has ended: what is felt next is of another one."""
    friction.filtered[0] = math.nan
    friction.way = 0.0


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
    _bend(friction, first, period, weight)
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
        -f_t = \sigma z + c\, v, \quad z \leftarrow z + v\, \Delta t, \quad
        \sigma |z| \le \left(\mu + \epsilon\, e^{-(|v| / v_s)^2}\right) f_n

    The first is of samples that slide: faster than 10 mm/s, pressed with more than 0.3 N, and 1 mm on the way. Velocity
    and forces are low-passed alike, so that they stay together. Samples are weighted by a noise of 0.05 N and 5 %, and
    by the share of the low-pass's time that they are new; forgetting is by the time slid, and never beyond the prior.
    Where speed and normal force do not vary, mu and c cannot be told apart: the deviations say so.

    The second is the bristle that `foretouch.rendering.FrictionRenderer` renders. Ten, of 300 to 30,000 N/m, bend with
    the probe, each drawn to the measured force within 0.1 s; the stiffness is where the parabola through the least of
    their sums of squared errors and its neighbours has its vertex, over the logarithm. What tells of it is where the
    hand turns. Where the surface's own law yields by and by, as Dahl's does, it is stiffer by up to a fifth. Five
    more of that stiffness have an excess :math:`\epsilon` of 0 to 1.2 mu, for :math:`v_s` = 5 mm/s: likewise, and for
    such a law up to two fifths too small.

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

    def _vertex(self, begin: int, end: int) -> tuple[float, float, bool]:
        """Vertex of the parabola through the least of some misfits, in steps; its deviation; whether it is within.

        The deviation is infinite where there is no vertex.
        """
        misfits = self.records["misfits"][0, begin:end]
        least = int(np.argmin(misfits))
        middle = min(max(least, 1), len(misfits) - 2)
        before, there, after = misfits[middle - 1 : middle + 2].tolist()
        bent = before - 2.0 * there + after
        if not bent > 0.0:
            return float(least), math.inf, False
        return middle + 0.5 * (before - after) / bent, math.sqrt(2.0 / bent), middle == least

    @property
    def stiffness(self) -> float:
        """Stiffness sigma of the bristles along the surface [N/m], about 300 to 30,000."""
        return SOFTEST * math.exp(STEP * min(max(self._vertex(0, BRISTLES)[0], 0.0), BRISTLES - 1.0))

    @property
    def stiffness_deviation(self) -> float:
        """Its standard deviation [N/m]; infinite where it is not within that range, or nothing tells of it."""
        _, deviation, within = self._vertex(0, BRISTLES)
        return self.stiffness * math.hypot(STEP * deviation, LAW_ERROR) if within else math.inf

    @property
    def sticks(self) -> bool:
        """Whether the stiffness of the bristles is certain enough to render: to 25 %."""
        return self.stiffness_deviation < STIFFNESS_SURE * self.stiffness

    @property
    def excess(self) -> float:
        """How much larger the coefficient is of a probe that hardly moves [-], not negative."""
        most = EXCESSES - 1.0
        return RATIO * min(max(self._vertex(BRISTLES, BRISTLES + EXCESSES)[0], 0.0), most) * self.coefficient

    @property
    def excess_deviation(self) -> float:
        """Its standard deviation [-]; infinite where nothing tells of it."""
        return RATIO * self._vertex(BRISTLES, BRISTLES + EXCESSES)[1] * self.coefficient

    @property
    def numbers(self) -> tuple[float, ...]:
        """What is told of it, as in `foretouch.messages.ModelUpdate`: 0 for what is not certain enough to render.

        Nothing before mu is.
        """
        if not self.known:
            return ()
        bristles = (self.stiffness, self.stiffness_deviation) if self.sticks else (0.0, 0.0)
        rest = (self.excess, self.excess_deviation) if self.excess_deviation < SURE else (0.0, 0.0)
        return (self.coefficient, self.viscous, *self.deviations, *bristles, *rest)

    @property
    def known(self) -> bool:
        """Whether mu is certain enough to render: to 0.1, from 50 samples or more."""
        return self.updates >= FEWEST and self.deviations[0] < SURE
