"""Dry friction with memory: a bristle that bends, sticks and slides."""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.errors.checks import require
from foretouch.quantities.pose import Vector, add, norm, scaled, subtract

NOTHING: Vector = (0.0, 0.0, 0.0)

SLOW = 5e-3  # Speed at which most of the excess of static friction is gone, where no other is given or learnt [m/s]

BRISTLE_TIME = 1e-3
"""Time constant of the bristle's own damping [s]: without any, what sticks would swing for ever."""


@dataclass(frozen=True, slots=True)
class BristleFriction:
    r"""The LuGre law of friction on a probe that slides over a surface; with :math:`\mu_s = \mu` that of Dahl.

    .. math::
        \dot z &= v - \frac{\sigma |v|}{g} z, \quad
        g = f_n \left(\mu + (\mu_s - \mu)\, e^{-(|v| / v_s)^2}\right) \\
        f_t &= -\sigma (z + \tau \dot z) - c\, v

    z is the bend of the bristles along the surface, :math:`\tau` = 1 ms. A probe that has just begun to move is pulled
    back as by a spring of stiffness :math:`\sigma`, and slides once it has bent the bristles by about
    :math:`\mu f_n / \sigma`; where :math:`\mu_s` is the larger, it may stick and slip.

    Attributes:
        coefficient: Coefficient of Coulomb friction mu [-], not negative.
        viscous: Viscous friction c [N s/m], not negative.
        stiffness: Stiffness sigma of the bristles along the surface [N/m], positive.
        static: Static friction as a multiple of Coulomb's, mu_s / mu, at least 1.
        slow: Speed v_s at which most of that excess is gone [m/s], positive.

    Raises:
        SettingError: A number is out of range.

    References:
        Canudas de Wit, Olsson, Astrom and Lischinsky (1995), A new model for control of systems with friction, IEEE
        Transactions on Automatic Control 40(3), (2), (3) and (5), with g in newtons.
    """

    coefficient: float = 0.3
    viscous: float = 0.5
    stiffness: float = 3000.0
    static: float = 1.0
    slow: float = SLOW

    def __post_init__(self) -> None:
        require("coefficient", self.coefficient, at_least=0.0)
        require("viscous", self.viscous, at_least=0.0)
        require("stiffness", self.stiffness, above=0.0)
        require("static", self.static, at_least=1.0)
        require("slow", self.slow, above=0.0)

    def advance(self, bend: Vector, velocity: Vector, normal_force: float, period: float) -> tuple[Vector, Vector]:
        """Bend of the bristles after a period [m], and the force along the surface at its end [N].

        The bend is exact for a velocity and a normal force that stay as they are, so that it is stable however long the
        period is.

        Args:
            bend: Of the bristles before [m].
            velocity: Of the probe along the surface [m/s].
            normal_force: f_n [N]; not above zero is no contact.
            period: [s], positive.
        """
        if not normal_force > 0.0:
            return NOTHING, NOTHING
        speed = norm(velocity)
        ratio = self.coefficient * (1.0 + (self.static - 1.0) * math.exp(-((speed / self.slow) ** 2)))
        carried = ratio * normal_force
        if speed > 0.0 and carried > 0.0:
            left = math.exp(-self.stiffness * speed * period / carried)
            sliding = scaled(velocity, carried / (self.stiffness * speed))
            after = add(sliding, scaled(subtract(bend, sliding), left))
        else:
            after = bend
        size, most = norm(after), carried / self.stiffness
        if size > most:  # the normal force has fallen: it lets go
            after = scaled(after, most / size)
        pulled = add(after, scaled(subtract(after, bend), BRISTLE_TIME / max(period, BRISTLE_TIME)))
        return after, subtract(scaled(pulled, -self.stiffness), scaled(velocity, self.viscous))


FRICTIONS = {
    "dry": BristleFriction(),
    "rubber": BristleFriction(coefficient=0.6, viscous=2.0, stiffness=1500.0, static=1.6),
    "wet": BristleFriction(coefficient=0.05, viscous=2.0, stiffness=10_000.0),
}
"""Kinds of friction that a simulated scene may have; on the second a slow probe sticks and slips."""
