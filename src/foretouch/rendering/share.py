"""The share of a model that a device can carry: what is passive when it is rendered from samples."""

from __future__ import annotations

import math
from functools import lru_cache

from foretouch.models.motion import VELOCITY_CUTOFF

__all__ = ["rendered_share"]


def rendered_share(
    stiffness: float,
    rendered_damping: float,
    *,
    device_damping: float,
    sample_period: float,
    stiffness_by_encoder: float = math.inf,
) -> float:
    r"""Share rho of the hand's motion in which a device can carry a model.

    .. math:: \rho \left(\frac{K T}{2} + \max(\kappa B, -B)\right) \le b, \quad \rho \le 1, \quad
        \kappa = \frac{c}{2 - c}, \quad c = 1 - e^{-2 \pi f_c T}

    A proxy that takes part in the share rho of the motion is felt with rho K and rho B, so that the condition for
    passive rendering from samples holds. For a velocity that is the plain difference of two positions it is the
    well-known :math:`b > K T / 2 + |B|`. Ours goes through the low-pass of `MotionFilter`; the theorem holds for any
    transfer function H(z) of position to force,

    .. math:: b > \max_\omega \frac{T}{2} \frac{\mathrm{Re}\,(1 - e^{-j \omega T}) H(e^{j \omega T})}
        {1 - \cos \omega T}, \quad H = K + \frac{B}{T} \frac{c\,(1 - z^{-1})}{1 - (1 - c)\, z^{-1}}

    whose damping part is largest at half the sample rate for B > 0, where the low-pass leaves the share kappa of it (a
    quarter at 80 Hz and 1 kHz), and at rest for B < 0.

    One count of the encoder moves the force by the stiffness and, through the velocity, by the damping: of that no more
    is rendered than the encoder allows,

    .. math:: \rho \left(K + \frac{c |B|}{T}\right) \le K_e

    Args:
        stiffness: K, local, at the hand [N/m], not negative.
        rendered_damping: B, local, at the hand [N s/m].
        device_damping: b [N s/m], not negative.
        sample_period: T [s].
        stiffness_by_encoder: K_e [N/m], positive: see `foretouch.devices.DeviceSpecification.largest_stiffness`.

    References:
        Colgate and Schenkel (1997), Passivity of a class of sampled-data systems: application to haptic interfaces,
        Journal of Robotic Systems 14(1).
    """
    gain = _gain(sample_period)
    against = -rendered_damping if rendered_damping < 0.0 else gain / (2.0 - gain) * rendered_damping
    needed = 0.5 * stiffness * sample_period + against
    share = device_damping / needed if needed > device_damping else 1.0
    counted = stiffness + gain / sample_period * abs(rendered_damping)
    if not counted > 0.0:
        return share
    by_encoder = stiffness_by_encoder / counted
    return by_encoder if by_encoder < share else share


@lru_cache(maxsize=16)
def _gain(sample_period: float) -> float:
    """c, of the low-pass of `MotionFilter`."""
    return -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period)
