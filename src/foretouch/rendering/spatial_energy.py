"""The energy account of one contact in three dimensions."""

from __future__ import annotations

import math
from typing import TypeAlias

from foretouch.models.checks import require
from foretouch.rendering.energy import SMALLEST_COUNT, WAY_BACK

__all__ = ["SpatialEnergyAccount"]

Vector: TypeAlias = tuple[float, float, float]


class SpatialEnergyAccount:
    r"""What the hand has put into the rendered force, in all directions, and the ceiling that keeps it in bounds.

    .. math::
        E_{k+1} &= E_k - f_k \cdot (x_{k+1} - x_k) \\
        |f_k| &\le \max(\epsilon F,\; F + E_k / (D - \Delta / 2)) \quad \text{while } E_k < 0 \\
        E_k &\ge -F D \quad \text{always}

    As `EnergyAccount`, whose proof holds for vectors too: a tick takes the force times its step at most. F is the
    largest force of this contact, D its longest step and one count of the encoders, Delta, in all three directions. A
    force along the normal of a curved surface, held for a tick, turns late: in a hollow of radius R it gives out
    :math:`|f|\,|\Delta x|^2 / 2 R` a tick more than it takes. The account along the normal cannot see that; this does.

    Args:
        resolution: One count of each encoder [m], not negative; less than a micrometre counts as one.

    Attributes:
        energy: E [J].
        force: f, held now [N].
        largest_force: F [N].
        largest_step: D [m].
        cut: Whether the ceiling has cut the newest force.
    """

    __slots__ = ("_count", "_newest_step", "_place", "cut", "energy", "force", "largest_force", "largest_step")

    def __init__(self, resolution: float = 0.0) -> None:
        require("resolution", resolution, at_least=0.0)
        self._count = math.sqrt(3.0) * max(resolution, SMALLEST_COUNT)
        self._place: Vector | None = None
        self._newest_step = 0.0
        self.force: Vector = (0.0, 0.0, 0.0)
        self.cut = False
        self.close()

    def close(self) -> None:
        """Contact is lost: begin anew."""
        self.energy = 0.0
        self.largest_force = 0.0
        self.largest_step = self._count

    @property
    def bound(self) -> float:
        """F D [J]: the account is never further below zero."""
        return self.largest_force * self.largest_step

    def observe(self, place: Vector) -> None:
        """Book the work of the held force up to where the hand is now [m]; a place that is not finite is left out."""
        if not all(map(math.isfinite, place)):
            return
        before, self._place = self._place, place
        if before is None:
            return
        x, y, z = place[0] - before[0], place[1] - before[1], place[2] - before[2]
        self.energy -= self.force[0] * x + self.force[1] * y + self.force[2] * z
        self._newest_step = math.sqrt(x * x + y * y + z * z) + self._count
        if self.force != (0.0, 0.0, 0.0):
            self.largest_step = max(self.largest_step, self._newest_step)

    def hold(self, force: Vector) -> Vector:
        """Hold a force [N] from now on, cut to the ceiling; returns what is held."""
        x, y, z = force
        size = math.sqrt(x * x + y * y + z * z)
        if not size < math.inf:
            x = y = z = size = 0.0
        ceiling = self.ceiling
        self.cut = size > ceiling
        if self.cut:
            share = ceiling / size
            x, y, z, size = x * share, y * share, z * share, ceiling
        self.force = (x, y, z)
        self.largest_force = max(self.largest_force, size)
        return self.force

    @property
    def ceiling(self) -> float:
        """Largest force that may be held now [N]."""
        if self.energy >= 0.0:
            return math.inf
        reach = max(self.largest_step - 0.5 * self._count, 0.5 * self._count)
        back = WAY_BACK * self.largest_force if self.energy > (WAY_BACK - 1.0) * self.bound else 0.0
        return max(self.largest_force + self.energy / reach, back)
