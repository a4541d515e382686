"""Limits on force and its rate, the last stage before the hand; and the share of a model that a device can carry."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from foretouch.errors.checks import require
from foretouch.models.predictor import VELOCITY_CUTOFF

LARGEST_FORCE = 10.0
"""Default limit of the rendered force [N]."""

NOTICED = 1e-3
"""Least change by a limit that is reported [N]."""

LARGEST_FORCE_RATE = 200.0
"""Default limit of the force rate [N/s]."""


class ForceLimiter:
    r"""Clamps a force and its rate.

    .. math:: F_k = \mathrm{clip}\big(\mathrm{clip}(F, 0, F_{max}),\;
        F_{k-1} - \dot F_{max} T,\; F_{k-1} + \dot F_{max} T\big)

    A force that is not finite counts as zero: the rendered force then falls to zero as fast as the rate allows.

    Args:
        largest_force: Limit of the force [N], positive.
        largest_rate: Limit of the rate [N/s], positive.

    Attributes:
        largest_force: Limit of the force [N].
        force: The newest limited force [N], from 0 to `largest_force`.
        clipped: Whether a limit changed the newest force, by more than 1 mN.
    """

    __slots__ = ("_largest_rate", "clipped", "force", "largest_force")

    def __init__(self, largest_force: float = LARGEST_FORCE, largest_rate: float = LARGEST_FORCE_RATE) -> None:
        require("largest_force", largest_force, above=0.0)
        require("largest_rate", largest_rate, above=0.0)
        self.largest_force = largest_force
        self._largest_rate = largest_rate
        self.force = 0.0
        self.clipped = False

    def update(self, wanted: float, period: float, ceiling: float = math.inf) -> float:
        """Limit one tick's force [N], this time after the last [s]; the ceiling [N] holds whatever the rate."""
        step = self._largest_rate * (period if period > 0.0 else 0.0)
        lowest, highest = self.force - step, self.force + step
        force = wanted if 0.0 <= wanted < math.inf else 0.0
        # Without `min` and `max`, which take longer than the rest.
        force = self.largest_force if force > self.largest_force else force
        force = lowest if force < lowest else force
        force = highest if force > highest else force
        force = ceiling if force > ceiling else force
        self.force = force
        self.clipped = not -NOTICED <= force - wanted <= NOTICED
        return force


COSINES = 4001
"""Number of frequencies of the search for kappa, even in the cosine: its maximum is found to six digits."""


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
    gain, left = _low_pass(sample_period, delay)
    against = -rendered_damping if rendered_damping < 0.0 else left * rendered_damping
    needed = stiffness * (0.5 * sample_period + delay) + against
    fraction = device_damping / needed if needed > device_damping else 1.0
    counted = stiffness + gain / sample_period * abs(rendered_damping)
    if not counted > 0.0:
        return fraction
    by_encoder = stiffness_by_encoder / counted
    return by_encoder if by_encoder < fraction else fraction


@lru_cache(maxsize=16)
def _low_pass(sample_period: float, delay: float) -> tuple[float, float]:
    """c, of the low-pass of `MotionFilter`, and kappa, the fraction of damping behind it that has to be carried."""
    gain, delta = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period), delay / sample_period
    kept = 1.0 - gain
    cosine = np.linspace(-1.0, 1.0, COSINES)
    square = 2.0 * cosine * cosine - 1.0
    active = (1.0 - delta) * (kept - cosine) + delta * (kept * cosine - square)
    return gain, float(np.max(gain * active / (1.0 - 2.0 * kept * cosine + kept * kept)))
