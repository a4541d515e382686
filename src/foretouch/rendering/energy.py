"""The energy account of one contact, and the ceiling on force that keeps it in bounds."""

from __future__ import annotations

import math

from foretouch.models.checks import require

__all__ = ["EnergyAccount"]

SMALLEST_COUNT = 1e-6
"""[m]."""

WAY_BACK = 1e-8
"""Share of the largest force that is never cut: with it, whoever presses again builds it up anew within some steps."""


class EnergyAccount:
    r"""What the hand has put into the rendered force in this contact, and what that force may give back.

    .. math::
        E_{k+1} &= E_k + f_k (x_{k+1} - x_k) \\
        f_k &\le \max\left(\epsilon F,\; F + E_k / (D - \Delta / 2)\right) \quad \text{while } E_k < 0 \\
        E_k &\ge -F D \quad \text{always}

    f is held from one tick to the next, so the sum is the work itself; x is the hand's position as the encoder shows it
    and grows into the material. F is the largest force of this contact so far, and D the farthest that the hand went in
    one tick of it, and one count of the encoder, Delta, more.

    The bound is the energy of one tick and one count: nobody can know of it before. It holds for any motion and any
    forces that are asked for. Where E is not negative, one tick takes F D at most. Where it is, the ceiling takes care
    that a tick no longer than D leaves E at -F (D - Delta / 2) or above, and one that is longer makes D longer. Half a
    count is left for epsilon = 1e-8, as long as there is that much: without it E would come so near to its bound on a
    long way out that no force would ever bring it back. The bound is also what sampling makes of a spring that takes
    nothing: pressed and let go at speed v, it gives back K x v T = F D more than was put in, so that such a spring is
    not cut.

    At the loss of contact the account is closed: what was dissipated in a former contact pays for nothing.

    Args:
        resolution: One count of the encoder [m], not negative; less than a micrometre counts as one.

    Attributes:
        energy: E [J].
        force: f, held now [N].
        largest_force: F [N].
        largest_step: D [m].

    References:
        Hannaford and Ryu (2002), Time-domain passivity control of haptic interfaces, IEEE Transactions on Robotics and
        Automation 18(1): observer and controller, whose damping is replaced here by a ceiling that needs no velocity.
        The bound is derived here.
    """

    __slots__ = ("_newest_step", "_position", "_resolution", "energy", "force", "largest_force", "largest_step")

    def __init__(self, resolution: float = 0.0) -> None:
        require("resolution", resolution, at_least=0.0)
        self._resolution = max(resolution, SMALLEST_COUNT)
        self._position = math.nan
        self._newest_step = 0.0
        self.force = 0.0
        self.close()

    def close(self) -> None:
        """Contact is lost: begin anew."""
        self.energy = 0.0
        self.largest_force = 0.0
        self.largest_step = self._resolution

    @property
    def bound(self) -> float:
        """F D [J]: the account is never further below zero."""
        return self.largest_force * self.largest_step

    def bound_with(self, force: float) -> float:
        """F D [J] as it will be once this force [N] has been held over a tick like the newest."""
        largest, step = self.largest_force, self.largest_step
        return (force if force > largest else largest) * (self._newest_step if self._newest_step > step else step)

    @property
    def ceiling(self) -> float:
        """Largest force that may be held now [N]."""
        if self.energy >= 0.0:
            return math.inf
        reach = self.largest_step - 0.5 * self._resolution
        back = WAY_BACK * self.largest_force if self.energy > (WAY_BACK - 1.0) * self.bound else 0.0
        return max(self.largest_force + self.energy / reach, back)

    def observe(self, position: float) -> None:
        """Book the work of the held force up to where the hand is now [m]; a position that is no number is left out."""
        if not math.isfinite(position):
            return
        moved = position - self._position
        self._position = position
        if math.isnan(moved):  # the first
            return
        self._newest_step = step = abs(moved) + self._resolution
        force = self.force
        self.energy += force * moved
        if force > 0.0 and step > self.largest_step:
            self.largest_step = step

    def pay(self, work: float) -> None:
        """Book work of the hand [J] in directions that this line does not see; what is no number is left out."""
        if math.isfinite(work):
            self.energy += work

    def hold(self, force: float) -> None:
        """From now on this force acts [N], 0 or more."""
        self.force = force
        if force > self.largest_force:
            self.largest_force = force
