"""A time-domain passivity observer and controller: damping as the observed energy requires it."""

from __future__ import annotations

from foretouch.errors.checks import require
from foretouch.rendering.energy import EnergyAccount

RECOVERY_RATE = 20.0
"""Largest rate of the force while the account is below zero [N/s]: no chatter where the hand stands still."""


class PassivityController:
    r"""Observer and controller of one port, in series with a force (Hannaford and Ryu 2002).

    The observer sums the work of the force that was really held. The controller puts a damper in series that takes the
    energy that the coming tick would lack:

    .. math::
        E_k &= \textstyle\sum_{j<k} f_j (x_{j+1} - x_j) \\
        \alpha_k &= \max\left(0,\; -\frac{E_k + F_k v_k T}{v_k^2 T}\right) \\
        f_k &= \max(0,\; F_k + \alpha_k v_k)

    F is the wanted force, f the force on the hand, v the velocity of the hand. While entering, the damper pushes, and
    alpha is at most what the device can render; while leaving, it only takes force away and needs no bound.

    Two things are added. While E is below zero, F rises by at most `RECOVERY_RATE` from what is held: at v = 0 no
    damper takes anything, and without this the full force comes back in the tick in which the hand stops, pushes it,
    and is taken away again. And at the loss of contact a surplus is forgotten, so that old dissipation pays for nothing
    new; a debt stays until it is paid.

    Unlike a ceiling this does not bound E from below: a reversal of the hand is known one tick later, each time.

    Args:
        largest_damping: Bound on alpha while entering [N s/m], not negative.

    Attributes:
        damping: alpha of the newest tick [N s/m].

    Raises:
        SettingError: A number is out of range.

    References:
        Hannaford and Ryu (2002), Time-domain passivity control of haptic interfaces, IEEE Transactions on Robotics and
        Automation 18(1): their series form, for a port that gives a force for a velocity.
    """

    __slots__ = ("_account", "_largest_damping", "damping")

    def __init__(self, largest_damping: float) -> None:
        require("largest_damping", largest_damping, at_least=0.0)
        self._account = EnergyAccount()
        self._largest_damping = largest_damping
        self.damping = 0.0

    @property
    def energy(self) -> float:
        """E [J], observed up to now; below zero where the hand was given more than it gave."""
        return self._account.energy

    def observe(self, position: float) -> None:
        """Book the work of the held force up to the present position [m]; one that is not a number is left out."""
        self._account.observe(position)

    def control(self, wanted: float, velocity: float, period: float) -> float:
        """Force for the hand [N], 0 or more, for the force F [N], velocity v [m/s], positive deeper, and time T [s]."""
        if self.energy < 0.0:
            wanted = min(wanted, self._account.force + RECOVERY_RATE * period)
        missing = -(self.energy + wanted * velocity * period)
        square = velocity * velocity * period
        self.damping = missing / square if missing > 0.0 and square > 0.0 else 0.0
        if velocity > 0.0:
            self.damping = min(self.damping, self._largest_damping)
        return max(wanted + self.damping * velocity, 0.0)

    def hold(self, force: float, *, touching: bool) -> None:
        """Hold this force from now on [N]; without contact (`touching`) a surplus is forgotten."""
        if not touching:
            self._account.close()
        self._account.hold(force)
