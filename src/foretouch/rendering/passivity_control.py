"""A time-domain passivity controller: damping, as much as the observed energy asks for."""

from __future__ import annotations

import math

from foretouch.models.checks import require
from foretouch.rendering.energy import EnergyAccount

__all__ = ["PassivityController"]


class PassivityController:
    r"""Observer and controller at one port, in series with a force (Hannaford and Ryu 2002).

    The observer sums the work of the force that was really held; the controller adds a damper that takes what the
    coming tick would lack:

    .. math::
        E_k &= \textstyle\sum_{j<k} f_j (x_{j+1} - x_j) \\
        \alpha_k &= \mathrm{clip}\left(-\frac{E_k + F_k v_k T}{v_k^2 T},\; 0,\; \alpha_{max}\right) \\
        f_k &= F_k + \alpha_k v_k

    F is the force that is wanted, f the one that the limits leave of the controlled one and that the hand gets, v the
    velocity of the hand.

    Between contacts a surplus is forgotten, so that old dissipation pays for nothing new; a debt stays until it is
    paid. What is sampled stays sampled: a force that is held while the hand turns back is known one tick later.

    Args:
        largest_damping: alpha_max [N s/m], not negative.
        resolution: One count of the encoder [m], not negative.

    Attributes:
        damping: alpha of the newest tick [N s/m].

    Raises:
        SettingError: A number out of range.

    References:
        Hannaford and Ryu (2002), Time-domain passivity control of haptic interfaces, IEEE Transactions on Robotics and
        Automation 18(1). Ryu, Kwon and Hannaford (2004), Stable teleoperation with time-domain passivity control, IEEE
        Transactions on Robotics and Automation 20(2).
    """

    def __init__(self, largest_damping: float, resolution: float = 0.0) -> None:
        require("largest_damping", largest_damping, at_least=0.0)
        self._account = EnergyAccount(resolution)
        self._largest_damping = largest_damping
        self.damping = 0.0

    @property
    def energy(self) -> float:
        """E, observed up to now [J]; negative where the hand was given more than it gave."""
        return self._account.energy

    def observe(self, position: float) -> None:
        """Book the work of the held force up to where the hand is now [m]."""
        self._account.observe(position)

    def control(self, wanted: float, velocity: float, period: float) -> tuple[float, float]:
        """The force [N] that keeps the account from falling below zero in this tick, as far as damping can.

        Args:
            wanted: F [N].
            velocity: v, of the hand [m/s], positive deeper.
            period: T, for which the force will be held [s].
        """
        self.damping = 0.0
        debt = self.energy < 0.0
        ceiling = self._account.force + self.recovery * period if debt else math.inf
        missing = -(self.energy + min(wanted, ceiling) * velocity * period)
        square = velocity * velocity * period
        if not (missing > 0.0 and square > 0.0):
            return wanted, ceiling
        damping = missing / square
        if velocity < 0.0:
            self.damping = damping
            return wanted, max(min(wanted, ceiling) + self.damping * velocity, 0.0)
        self.damping = min(damping, self._largest_damping)
        push = self.damping * velocity
        return wanted + push, ceiling + push

    recovery = 200.0

    def hold(self, force: float) -> None:
        """From now on this force acts [N]; one of zero outside contact ends it."""
        self._account.hold(force)

    def leave(self) -> None:
        """Contact is lost: forget a surplus, keep a debt."""
        if self.energy > 0.0:
            self._account.close()
