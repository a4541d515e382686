"""The last stage before the hand: limits on force and on how fast it changes."""

from __future__ import annotations

import math

from foretouch.models.checks import require

__all__ = ["LARGEST_FORCE", "LARGEST_FORCE_RATE", "ForceLimiter"]

LARGEST_FORCE = 10.0
"""Default limit of the rendered force [N]."""

NOTICED = 1e-3
"""Less is not worth telling [N]."""

LARGEST_FORCE_RATE = 200.0
"""Default limit of its rate [N/s]."""


class ForceLimiter:
    r"""Clamps a force and its rate.

    .. math:: F_k = \mathrm{clip}\big(\mathrm{clip}(F, 0, F_{max}),\;
        F_{k-1} - \dot F_{max} T,\; F_{k-1} + \dot F_{max} T\big)

    A force that is not finite counts as zero: the rendered force then falls to zero as fast as the rate allows.

    Args:
        largest_force: [N], positive.
        largest_rate: [N/s], positive.

    Attributes:
        largest_force: [N].
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
        """Limit one tick's force [N].

        Args:
            wanted: [N].
            period: Time since the last tick [s].
            ceiling: Never more than this [N], however fast that is; 0 or more.
        """
        step = self._largest_rate * (period if period > 0.0 else 0.0)
        lowest, highest = self.force - step, self.force + step
        force = wanted if 0.0 <= wanted < math.inf else 0.0
        # Without `min` and `max`, which take longer than all the rest of it.
        force = self.largest_force if force > self.largest_force else force
        force = lowest if force < lowest else force
        force = highest if force > highest else force
        force = ceiling if force > ceiling else force
        self.force = force
        self.clipped = not -NOTICED <= force - wanted <= NOTICED
        return force
