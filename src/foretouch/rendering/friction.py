"""Friction along a surface, as the hand feels it: a bristle that sticks, bends and slides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

from foretouch.errors.checks import require

Vector: TypeAlias = tuple[float, float, float]

NOTHING: Vector = (0.0, 0.0, 0.0)

VELOCITY_CUTOFF = 30.0
"""Cut-off of the velocity low-pass [Hz]: counts of the encoder are not to be felt."""

VISCOUS_SHARE = 0.5
"""Largest fraction of the device's damping that carries viscous friction; the rest carries the bristle."""


class FrictionRenderer:
    r"""Coulomb friction that sticks, and viscous friction beside it.

    .. math::
        z &\leftarrow P (z + \Delta p), \quad P = I - n n^T, \quad |k z| \le \mu f_n \\
        f &= -k z - c\, v

    z is the bend of the bristle, p the touched point, n the normal, v the low-passed velocity along the surface. The
    part of z beyond the cone is forgotten (it slides, or lets go where f_n falls), and a bend that turns with the
    normal only grows shorter: so the bristle stores :math:`k |z|^2 / 2` and never gives back more.

    **Passive.** The force of a tick, held while the hand moves by :math:`\Delta p`, gives out at most
    :math:`k |\Delta p|^2 / 2` more than the bristle loses and, over a motion, :math:`c |\Delta p|^2 / T` more than
    nothing (the low-pass has no gain above 1). A force that comes a delay d late gives out as much more as a spring's
    does. The device's damping b takes :math:`b |\Delta p|^2 / T` meanwhile. So

    .. math:: c \le b / 2, \quad k \le \min(K, (b - c) / (T / 2 + d))

    and without a delay device and friction together never give out energy, whatever the motion, normal force, mu and
    normal do; with one, where the bristle does not slide. The account of energy covers the rest.

    Args:
        stiffness: Stiffness K that the device carries [N/m], positive.
        device_damping: Damping b of the device along the surface [N s/m], not negative; infinite for no device.
        delay: Delay d, from reading a position until the force acts [s], not negative.

    Attributes:
        bend: Bend z [m].
        stored: Energy in the bristle [J].
        sliding: Whether the bristle was at the cone in the newest tick.

    Raises:
        SettingError: A setting is out of range.

    References:
        Dahl (1968) and Hayward and Armstrong (2000), A new computational model of friction applied to haptic rendering,
        Experimental Robotics VI: the elastic-plastic bristle, which neither drifts nor needs a velocity.
        Colgate and Schenkel (1997), Journal of Robotic Systems 14(1): b > K T / 2 + B.
    """

    __slots__ = ("_damping", "_delay", "_place", "_stiffness", "_velocity", "bend", "sliding", "stored")

    def __init__(self, stiffness: float, device_damping: float = math.inf, delay: float = 0.0) -> None:
        if stiffness != math.inf:
            require("stiffness", stiffness, above=0.0)
        if device_damping != math.inf:
            require("device_damping", device_damping, at_least=0.0)
        self._stiffness = min(stiffness, 1e6)
        require("delay", delay, at_least=0.0)
        self._damping = device_damping
        self._delay = delay
        self.restart()

    def restart(self) -> None:
        """End the contact: the bristle is straight."""
        self._place: Vector | None = None
        self._velocity: Vector = NOTHING
        self.bend: Vector = NOTHING
        self.stored = 0.0
        self.sliding = False

    def update(
        self,
        point: Sequence[float],
        normal: Sequence[float],
        normal_force: float,
        mu: float,
        viscous: float,
        period: float,
    ) -> Vector:
        r"""One tick; never raises, and gives no force for invalid numbers.

        Args:
            point: The touched point: the proxy on the surface [m].
            normal: Outward normal, of length 1.
            normal_force: Normal force f_n [N]; not above zero is no contact.
            mu: Coefficient of friction [-]; below zero counts as zero.
            viscous: Viscous friction c [N s/m]; below zero counts as zero.
            period: Time T since the previous tick [s].

        Returns:
            The force on the hand [N]: along the surface, of length :math:`\mu f_n + c |v|` at most.
        """
        x, y, z = point
        nx, ny, nz = normal
        finite = math.isfinite(x + y + z + nx + ny + nz + mu + viscous) and normal_force < math.inf
        if not (normal_force > 0.0 and finite and period > 0.0):
            self.restart()
            return NOTHING
        before = self._place or (x, y, z)
        self._place = (x, y, z)
        moved = _along((x - before[0], y - before[1], z - before[2]), nx, ny, nz)
        cone = max(mu, 0.0) * normal_force
        c = min(max(viscous, 0.0), VISCOUS_SHARE * self._damping)
        k = min(self._stiffness, (self._damping - c) / (0.5 * period + self._delay))
        bx, by, bz = self._bent(moved, nx, ny, nz, k, cone)
        ux, uy, uz = self._moving(moved, nx, ny, nz, period)
        fx, fy, fz = k * bx, k * by, k * bz
        return -fx - c * ux, -fy - c * uy, -fz - c * uz

    def _bent(self, moved: Vector, nx: float, ny: float, nz: float, k: float, cone: float) -> Vector:
        """Bend the bristle by the motion of the point, and let it slide where it is at the cone."""
        bend = self.bend
        x, y, z = _along((bend[0] + moved[0], bend[1] + moved[1], bend[2] + moved[2]), nx, ny, nz)
        size = math.sqrt(x * x + y * y + z * z)
        self.sliding = k * size > cone
        if self.sliding:
            scale = cone / (k * size)
            x, y, z, size = x * scale, y * scale, z * scale, size * scale
        self.bend = (x, y, z)
        self.stored = 0.5 * k * size * size
        return self.bend

    def _moving(self, moved: Vector, nx: float, ny: float, nz: float, period: float) -> Vector:
        """Velocity along the surface, low-passed [m/s]."""
        gain = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * period)
        vx, vy, vz = self._velocity
        x = vx + gain * (moved[0] / period - vx)
        y = vy + gain * (moved[1] / period - vy)
        z = vz + gain * (moved[2] / period - vz)
        self._velocity = _along((x, y, z), nx, ny, nz)
        return self._velocity


def _along(vector: Vector, nx: float, ny: float, nz: float) -> Vector:
    """Component of a vector along the surface."""
    x, y, z = vector
    out = x * nx + y * ny + z * nz
    return x - out * nx, y - out * ny, z - out * nz
