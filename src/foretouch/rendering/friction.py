"""Friction along a surface, as the hand feels it: a bristle that sticks, bends and slides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled
from foretouch.errors.checks import require
from foretouch.models.friction_kernel import at_rest
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces.geometry import add, dot, norm, scaled, subtract, vector, write

NOTHING: Vector = (0.0, 0.0, 0.0)
Numbers3 = Annotated[NDArray[Any], float, 3]

VELOCITY_CUTOFF = 30.0  # Cut-off of the velocity low-pass [Hz]: counts of the encoder are not to be felt

VISCOUS_SHARE = 0.5
"""Largest fraction of the device's damping that carries viscous friction; the rest carries the bristle."""


class Friction(Record):
    """State of a `FrictionRenderer`."""

    stiffness: float  # K [N/m]
    damping: float  # b [N s/m]
    delay: float  # d [s]
    coefficient: float  # mu [-]
    viscous: float  # c [N s/m]
    excess: float  # epsilon [-]
    bristle: float = math.inf  # sigma [N/m]
    carried: float = math.inf  # k of the newest tick [N/m]
    touching: bool  # whether the touched point is known
    point: Numbers3  # p [m]
    velocity: Numbers3  # v [m/s]
    bend: Numbers3  # z [m]
    stored: float  # [J]
    sliding: bool


@compiled
def _along(vector: Vector, normal: Vector) -> Vector:
    """Component of a vector along the surface."""
    return subtract(vector, scaled(normal, dot(vector, normal)))


@compiled
def let_go(friction: Friction) -> None:
    """See `FrictionRenderer.restart`."""
    friction.touching = friction.sliding = False
    write(friction.velocity, NOTHING)
    write(friction.bend, NOTHING)
    friction.stored = 0.0


@compiled(error_model="numpy")
def rub(friction: Friction, point: Vector, normal: Vector, pressed: float, period: float) -> Vector:
    """See `FrictionRenderer.update`."""
    mu, viscous = friction.coefficient, friction.viscous
    finite = math.isfinite(sum(point) + sum(normal) + mu + viscous + friction.excess) and pressed < math.inf
    if not (pressed > 0.0 and finite and period > 0.0):
        let_go(friction)
        return NOTHING
    v, before = vector(friction.velocity), vector(friction.point) if friction.touching else point
    write(friction.point, point)
    friction.touching = True
    moved = _along(subtract(point, before), normal)
    cone = (max(mu, 0.0) + max(friction.excess, 0.0) * at_rest(norm(v))) * pressed
    c = min(max(viscous, 0.0), VISCOUS_SHARE * friction.damping)
    k = min(friction.stiffness, (friction.damping - c) / (0.5 * period + friction.delay))
    if friction.bristle > 0.0:
        k = min(k, friction.bristle)
    # A stiffer bristle keeps its force, and a softer one its bend: so a change never adds energy.
    kept = min(friction.carried / k, 1.0) if k > 0.0 else 1.0
    friction.carried = k
    bend = _along(add(scaled(vector(friction.bend), kept), moved), normal)
    size = norm(bend)
    friction.sliding = k * size > cone
    if friction.sliding:  # at the cone
        scale = cone / (k * size)
        bend, size = scaled(bend, scale), size * scale
    write(friction.bend, bend)
    friction.stored = 0.5 * k * size * size
    gain = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * period)
    faster = (moved[0] / period - v[0], moved[1] / period - v[1], moved[2] / period - v[2])
    velocity = _along(add(v, scaled(faster, gain)), normal)
    write(friction.velocity, velocity)
    return subtract(scaled(bend, -k), scaled(velocity, c))


_rub = Kernel(rub, "(Friction, UniTuple(f8, 3), UniTuple(f8, 3), f8, f8)")


class FrictionRenderer(Held):
    r"""Coulomb friction that sticks, and viscous friction beside it.

    .. math::
        z &\leftarrow P (z + \Delta p), \quad P = I - n n^T, \quad
        |k z| \le \left(\mu + \epsilon\, e^{-(|v| / v_s)^2}\right) f_n \\
        f &= -k z - c\, v

    z is the bend of the bristle, p the touched point, n the normal, v the low-passed velocity along the surface. The
    part of z beyond the cone is forgotten (it slides, or lets go where f_n falls), and a bend that turns with the
    normal only grows shorter: so the bristle stores :math:`k |z|^2 / 2` and never gives back more.

    **Passive.** The force of a tick, held while the hand moves by :math:`\Delta p`, gives out at most
    :math:`k |\Delta p|^2 / 2` more than the bristle loses and, over a motion, :math:`c |\Delta p|^2 / T` more than
    nothing (the low-pass has no gain above 1). A force that comes a delay d late gives out as much more as a spring's
    does. The device's damping b takes :math:`b |\Delta p|^2 / T` meanwhile. So

    .. math:: c \le b / 2, \quad k \le \min(K, \sigma, (b - c) / (T / 2 + d))

    so that it yields to the hand as it does to the robot, with the surface's own :math:`\sigma`. Without a delay device
    and friction together never give out energy, whatever the motion, normal force, mu, normal and :math:`\sigma` do;
    with one, where the bristle does not slide. The account of energy covers the rest. A cone that is wider at
    rest (epsilon, with :math:`v_s` = 5 mm/s) is one that changes: what sticks, then slips, loses what the bristle held.

    Args:
        stiffness: Stiffness K that the device carries [N/m], not negative.
        device_damping: Damping b of the device along the surface [N s/m], not negative; infinite for no device.
        delay: Delay d, from reading a position until the force acts [s], not negative.

    Attributes:
        stored: Energy in the bristle [J].
        sliding: Whether the bristle was at the cone in the newest tick.

    Raises:
        SettingError: A setting is out of range.

    References:
        Dahl (1968) and Hayward and Armstrong (2000), A new computational model of friction applied to haptic rendering,
        Experimental Robotics VI: the elastic-plastic bristle, which neither drifts nor needs a velocity.
        Colgate and Schenkel (1997), Journal of Robotic Systems 14(1): b > K T / 2 + B.
    """

    __slots__ = ()

    stored: float
    sliding: bool

    def __init__(self, stiffness: float, device_damping: float = math.inf, delay: float = 0.0) -> None:
        if stiffness != math.inf:
            require("stiffness", stiffness, at_least=0.0)
        if device_damping != math.inf:
            require("device_damping", device_damping, at_least=0.0)
        require("delay", delay, at_least=0.0)
        super().__init__(Friction.new(stiffness=min(stiffness, 1e6), damping=device_damping, delay=delay))

    @property
    def bend(self) -> Vector:
        """Bend z [m]."""
        ((x, y, z),) = self.records["bend"].tolist()
        return x, y, z

    def restart(self) -> None:
        """End the contact: the bristle is straight."""
        let_go(self.records[0])

    def update(
        self,
        point: Sequence[float],
        normal: Sequence[float],
        normal_force: float,
        mu: float,
        viscous: float,
        period: float,
        stiffness: float = math.inf,
        excess: float = 0.0,
    ) -> Vector:
        r"""One tick; never raises, and gives no force for invalid numbers.

        Args:
            point: The touched point: the proxy on the surface [m].
            normal: Outward normal, of length 1.
            normal_force: Normal force f_n [N]; not above zero is no contact.
            mu: Coefficient of friction [-]; below zero counts as zero.
            viscous: Viscous friction c [N s/m]; below zero counts as zero.
            period: Time T since the previous tick [s].
            stiffness: Stiffness sigma of the surface's own bristles [N/m]; not above zero or infinite where unknown.

            excess: How much larger mu is at rest, epsilon [-]; below zero counts as zero.

        Returns:
            The force on the hand [N]: along the surface, of length :math:`(\mu + \epsilon) f_n + c |v|` at most.
        """
        x, y, z = point
        nx, ny, nz = normal
        records = self.records
        records["coefficient"], records["viscous"], records["excess"] = mu, viscous, excess
        records["bristle"] = stiffness
        return _rub.entry(self.records[0], (x, y, z), (nx, ny, nz), normal_force, period)
