"""Limits on force and its rate, the last stage before the hand; and the share of a model that a device can carry.

Force is withheld where a model gives it, and the hand gets less than half of it for half a second.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled
from foretouch.core.compiling import interpreted
from foretouch.errors.checks import require
from foretouch.models.predictor import VELOCITY_CUTOFF

LARGEST_FORCE = 10.0
"""Default limit of the rendered force [N]."""

NOTICED = 1e-3  # Least change by a limit that is reported [N]

LARGEST_FORCE_RATE = 200.0
"""Default limit of the force rate [N/s]."""


class Limiter(Record):
    """State of a `ForceLimiter`."""

    largest_force: float = LARGEST_FORCE  # [N]
    largest_rate: float = LARGEST_FORCE_RATE  # [N/s]
    least_force: float  # 0, or minus the largest for a device that pulls [N]
    force: float  # the newest limited force [N]
    clipped: bool


@compiled
def limit(limiter: Limiter, wanted: float, period: float, ceiling: float, floor: float) -> float:
    """See `ForceLimiter.update`; the floor [N], 0 or less, is the same as the ceiling for a pull."""
    step = limiter.largest_rate * (period if period > 0.0 else 0.0)
    force = max(min(wanted, limiter.largest_force), limiter.least_force) if math.isfinite(wanted) else 0.0
    force = min(max(force, limiter.force - step), limiter.force + step)
    force = max(min(force, ceiling), floor)
    limiter.force = force
    limiter.clipped = not -NOTICED <= force - wanted <= NOTICED
    return force


_limit = Kernel(limit, "(Limiter, f8, f8, f8, f8)")


class ForceLimiter(Held):
    r"""Clamps a force and its rate.

    .. math:: F_k = \mathrm{clip}\big(\mathrm{clip}(F, F_{min}, F_{max}),\;
        F_{k-1} - \dot F_{max} T,\; F_{k-1} + \dot F_{max} T\big)

    where F_min is 0, or -F_max where forces may pull. A force that is not finite counts as zero.

    Args:
        largest_force: Limit of the force [N], positive.
        largest_rate: Limit of the rate [N/s], positive.
        pulls: Whether forces may be negative.
        limiters: Array of one `Limiter` that this one takes, part of another record; None for one of its own.

    Attributes:
        largest_force: Limit of the force [N].
        force: The newest limited force [N], of at most `largest_force`.
        clipped: Whether a limit changed the newest force, by more than 1 mN.
    """

    __slots__ = ()

    largest_force: float
    force: float
    clipped: bool

    def __init__(
        self,
        largest_force: float = LARGEST_FORCE,
        largest_rate: float = LARGEST_FORCE_RATE,
        *,
        pulls: bool = False,
        limiters: NDArray[np.void] | None = None,
    ) -> None:
        require("largest_force", largest_force, above=0.0)
        require("largest_rate", largest_rate, above=0.0)
        super().__init__(Limiter.new() if limiters is None else limiters)
        least = -largest_force if pulls else 0.0
        self.records[:] = Limiter.new(largest_force=largest_force, largest_rate=largest_rate, least_force=least)

    def update(self, wanted: float, period: float, ceiling: float = math.inf) -> float:
        """Limit one tick's force [N], this time after the last [s]; the ceiling of its size [N] holds at any rate."""
        return _limit.entry(self.records[0], wanted, period, ceiling, -ceiling)


COSINES = 4001  # Number of frequencies of the search for kappa, even in the cosine: its maximum is found to six digits


def rendered_share(
    stiffness: float,
    rendered_damping: float,
    *,
    device_damping: float,
    sample_period: float,
    delay: float = 0.0,
    stiffness_by_encoder: float = math.inf,
) -> float:
    r"""Share rho of the hand's motion in which a device can carry a model.

    .. math:: \rho \left(K \left(\frac{T}{2} + d\right) + \max(\kappa B, -B)\right) \le b, \quad \rho \le 1

    A proxy that takes part in the share rho of the motion is felt with rho K and rho B, so that the condition for
    passive rendering from samples holds. For a velocity that is the plain difference of two positions, and a force that
    acts at once, it is the well-known :math:`b > K T / 2 + |B|` (Colgate and Schenkel); with a delay d from reading a
    position until the force acts, :math:`b > K (T / 2 + d)` (Diolaiti et al.). Here the velocity passes the low-pass of
    `MotionFilter`; the theorem holds for any transfer function H(z) of position to force, here for a hand that moves
    evenly in a tick:

    .. math:: b > \max_\omega \frac{T}{2} \frac{\mathrm{Re}\,(1 - z^{-1}) (1 - \delta + \delta z^{-1}) H(z)}
        {1 - \cos \omega T}, \quad H = K + \frac{B}{T} \frac{c\,(1 - z^{-1})}{1 - (1 - c)\, z^{-1}}

    with :math:`z = e^{j \omega T}`, :math:`\delta = d / T` and :math:`c = 1 - e^{-2 \pi f_c T}`. Its spring part is
    largest at rest, and so is its damping part for B < 0; for B > 0 that is the fraction kappa of B, without a delay c
    / (2 - c) at half the sample rate (a quarter at 80 Hz and 1 kHz).

    One count of the encoder moves the force by the stiffness and, through the velocity, by the damping: the encoder
    limits both,

    .. math:: \rho \left(K + \frac{c |B|}{T}\right) \le K_e

    Args:
        stiffness: K, local, at the hand [N/m], not negative.
        rendered_damping: B, local, at the hand [N s/m].
        device_damping: b [N s/m], not negative.
        sample_period: T [s].
        delay: d, 0 to T [s].
        stiffness_by_encoder: K_e [N/m], positive: see `foretouch.devices.DeviceSpecification.largest_stiffness`.

    References:
        Colgate and Schenkel (1997), Passivity of a class of sampled-data systems: application to haptic interfaces,
        Journal of Robotic Systems 14(1). Diolaiti, Niemeyer, Barbagli and Salisbury (2006), Stability of haptic
        rendering: discretization, quantization, time delay, and Coulomb effects, IEEE Transactions on Robotics 22(2).
    """
    constants = device_damping, sample_period, delay, stiffness_by_encoder, *low_pass(sample_period, delay)
    return interpreted(carried)(stiffness, rendered_damping, constants)


Carrier = tuple[float, float, float, float, float, float]
"""b [N s/m], T [s], d [s], K_e [N/m], c and kappa of `rendered_share`."""


@compiled
def carried(stiffness: float, rendered_damping: float, device: Carrier) -> float:
    """See `rendered_share`."""
    device_damping, period, delay, by_encoder, gain, left = device
    against = -rendered_damping if rendered_damping < 0.0 else left * rendered_damping
    needed = stiffness * (0.5 * period + delay) + against
    fraction = device_damping / needed if needed > device_damping else 1.0
    counted = stiffness + gain / period * abs(rendered_damping)
    if not counted > 0.0:
        return fraction
    return min(by_encoder / counted, fraction)


@lru_cache(maxsize=16)
def low_pass(sample_period: float, delay: float) -> tuple[float, float]:
    """c, of the low-pass of `MotionFilter`, and kappa, the fraction of damping behind it that has to be carried."""
    gain, delta = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period), delay / sample_period
    kept = 1.0 - gain
    cosine = np.linspace(-1.0, 1.0, COSINES)
    square = 2.0 * cosine * cosine - 1.0
    active = (1.0 - delta) * (kept - cosine) + delta * (kept * cosine - square)
    return gain, float(np.max(gain * active / (1.0 - 2.0 * kept * cosine + kept * kept)))


LEAST_FORCE = 0.5  # Least force of a model whose lack is noticed [N]
LEAST_SHARE = 0.5  # Ratio of rendered to due force below which the force counts as withheld
REDUCED_BELOW = 0.9  # Ratio of rendered to due force below which a console reports a reduced force

LEAST_TICKS = 500
"""Number of ticks in a row with a model's force after which it is withheld: half a second. Times between presses,
without force, neither count nor restart the count."""

FORGOTTEN_NS = 2_000_000_000
"""Longest time between presses that keeps the count [ns]: after more the operator may be another one."""

OWED = "the hand was given more energy than it put in, and owes it"
UNPAID = "nobody had paid yet for what the model would give back"
"""Reason for withheld force: the account of energy is below zero, or the work put in by the hand is too little."""


def due_force(predicted: float, force_scale: float) -> float:
    """Force of a model that is due to the hand [N]: scaled, and within the limit."""
    force = force_scale * predicted
    return force if force < LARGEST_FORCE else LARGEST_FORCE


class Withheld:
    """Detects withheld force, from tick to tick.

    Args:
        least_ratio: Ratio of rendered to due force below which it counts as withheld, 0 to 1.

    Attributes:
        owed: Whether the account of energy was below zero in the newest tick that counted.
    """

    __slots__ = ("_least_ratio", "_newest_ns", "_ticks", "owed")

    def __init__(self, least_ratio: float = LEAST_SHARE) -> None:
        self._least_ratio = least_ratio
        self._ticks = self._newest_ns = 0
        self.owed = False

    def update(self, predicted: float, rendered: float, energy: float, now_ns: int) -> bool:
        """One tick [ns] of a coupled hand: due and rendered force [N] and energy [J]; whether force is withheld."""
        if predicted >= LEAST_FORCE:
            self._ticks = self._ticks + 1 if rendered < self._least_ratio * predicted else 0
            self._newest_ns, self.owed = now_ns, energy < 0.0
        elif now_ns - self._newest_ns > FORGOTTEN_NS:
            self._ticks = 0
        return self._ticks >= LEAST_TICKS
