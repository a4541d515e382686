"""Where a tool touches, from the wrench of the contact alone: at its spherical tip, and where, or elsewhere.

It stands beside the arms because they alone have a wrench: the other robots' sensors show a force.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.core import kernel, squared
from foretouch.errors import SettingError
from foretouch.errors.checks import require

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

TELLING = 6.0  # Standard deviations of the force from which a contact is one, as in a session

SURE = 5.0
"""Standard deviations by which a line of action must miss the tip. The distance is the length of two normal errors: on
a point tip these alone are as long in one of 270,000 samples, exp(-25 / 2)."""


class Touching(IntEnum):
    """What a wrench says of the tip."""

    NOTHING = 0  # The force is too small to tell
    TIP = 1  # A contact at the tip explains the wrench
    ELSEWHERE = 2  # No contact at the tip explains this wrench: something else of the tool touches, the shaft perhaps


class TipContact(NamedTuple):
    """Where a wrench comes from.

    Attributes:
        touching: What it says of the tip.
        point: Point of contact from the centre of the tip [m]; where no contact at the tip explains the wrench, that of
            the line of action that is closest to the centre.
        distance: Of the line of action from the centre of the tip [m].
        deviation: Standard deviation of the distance, and of the point across the force [m].
    """

    touching: Touching
    point: Vector
    distance: float
    deviation: float


@kernel("Tuple((i8, f8, f8, f8, f8, f8))(f8[::1], f8[::1], f8, f8, f8)")
def locate(
    wrench: Array, centre: Array, radius: float, force_noise: float, torque_noise: float
) -> tuple[int, float, float, float, float, float]:
    """See `TipSensing.locate`: what it says, the point [m], the distance and its deviation [m]."""
    x, y, z = wrench[0], wrench[1], wrench[2]
    a, b, c = centre[0], centre[1], centre[2]
    square = x * x + y * y + z * z
    force = math.sqrt(square)
    if not force > TELLING * force_noise:  # a force that is no number, too
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0
    u = wrench[3] - (b * z - c * y)  # the torque about the centre of the tip
    v = wrench[4] - (c * x - a * z)
    w = wrench[5] - (a * y - b * x)
    p, q, r = (y * w - z * v) / square, (z * u - x * w) / square, (x * v - y * u) / square
    distance = math.sqrt(p * p + q * q + r * r)
    if not distance < math.inf:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0
    # An error of the force turns the line of action about the sensor.
    lever = math.sqrt(squared(a + p) + squared(b + q) + squared(c + r))
    deviation = math.sqrt(torque_noise * torque_noise + squared(lever * force_noise)) / force
    if distance > radius + SURE * deviation:
        return 2, p, q, r, distance, deviation
    if distance > radius:  # beside the sphere by less than the noise explains: it grazes
        s, shrink = 0.0, radius / distance
    else:
        s, shrink = -math.sqrt(radius * radius - distance * distance) / force, 1.0
    return 1, shrink * p + s * x, shrink * q + s * y, shrink * r + s * z, distance, deviation


class TipSensing:
    r"""Intrinsic tactile sensing with a spherical tip: the point of contact from force and torque.

    A contact without torque of its own at p, from the centre of the sphere, shows :math:`t = p \times f`. All p that do
    so are the line of action

    .. math:: p = \frac{f \times t}{|f|^2} + s f, \qquad d = \frac{|f \times t|}{|f|^2}, \qquad
        s = -\frac{\sqrt{R^2 - d^2}}{|f|}

    which is at the distance d from the centre. Of its two intersections with the sphere of radius R the one is taken in
    which the force on the tip points into it: a surface pushes. A line that passes the sphere at more than five
    standard deviations

    .. math:: \sigma_d = \frac{1}{|f|} \sqrt{\sigma_t^2 + |c + p|^2 \sigma_f^2}

    c being the centre from the sensor's origin, belongs to no contact at the tip. A force below six of its own standard
    deviations says nothing. With R = 0 the tip is a point.

    Several contacts at once show as the line of their sum, and torsion about the line of action is left out.

    Args:
        radius: R of the tip [m], at least 0.
        centre: c, from the origin about which the torques are, in the same frame [m].
        force_noise: Standard deviation of a force along each axis [N], above 0, with what calibration left.
        torque_noise: Standard deviation of a torque [N m], at least 0, likewise.

    Raises:
        SettingError: A number out of its range.

    References:
        Bicchi, Salisbury and Brock (1993), Contact sensing from force measurements, International Journal of Robotics
        Research 12(3): a soft finger on an ellipsoid; here without friction torque, on a sphere. The test for a contact
        elsewhere is not theirs.
    """

    def __init__(self, radius: float, centre: Vector, force_noise: float, torque_noise: float) -> None:
        require("radius", radius, at_least=0.0)
        require("force_noise", force_noise, above=0.0)
        require("torque_noise", torque_noise, at_least=0.0)
        self._centre = np.array(centre, np.float64)
        if self._centre.shape != (3,) or not np.isfinite(self._centre).all():
            raise SettingError("centre", centre, "must be three finite numbers")
        self._figures, self._locate = (float(radius), float(force_noise), float(torque_noise)), locate.entry

    def locate(self, wrench: Array) -> TipContact:
        """Where a contact is. Never raises on bad data: a wrench that is not finite says nothing.

        Args:
            wrench: Of the contact on the tool, without its load: force [N] and torque [N m] about the origin of
                `centre`; contiguous, shape (6,).
        """
        touching, x, y, z, distance, deviation = self._locate(wrench, self._centre, *self._figures)
        return TipContact(_TOUCHING[touching], (x, y, z), distance, deviation)


_TOUCHING = tuple(Touching)
