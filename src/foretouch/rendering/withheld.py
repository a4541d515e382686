"""Detection of withheld force: a model gives it, and the hand gets less than half of it for half a second."""

from __future__ import annotations

from foretouch.rendering.limits import LARGEST_FORCE

LEAST_FORCE = 0.5  # Least force of a model whose lack is noticed [N]
LEAST_SHARE = 0.5  # Ratio of rendered to due force below which the force counts as withheld
REDUCED_BELOW = 0.9  # Ratio of rendered to due force below which a console reports a reduced force

LEAST_TICKS = 500
"""Number of ticks in a row with a model's force after which it is withheld: half a second. Times between presses,
without force, neither count nor restart the count."""

FORGOTTEN_NS = 2_000_000_000
"""Longest time between presses that keeps the count [ns]: after more the operator may be another one."""

OWED = "the hand was given more energy than it put in, and owes it"
UNPAID = "nobody had paid yet for what the model would give back"
"""Reason for withheld force: the account of energy is below zero, or the work put in by the hand is too little."""


def due_force(predicted: float, force_scale: float) -> float:
    """Force of a model that is due to the hand [N]: scaled, and within the limit."""
    force = force_scale * predicted
    return force if force < LARGEST_FORCE else LARGEST_FORCE


class Withheld:
    """Detects withheld force, from tick to tick.

    Args:
        least_ratio: Ratio of rendered to due force below which it counts as withheld, 0 to 1.

    Attributes:
        owed: Whether the account of energy was below zero in the newest tick that counted.
    """

    __slots__ = ("_least_ratio", "_newest_ns", "_ticks", "owed")

    def __init__(self, least_ratio: float = LEAST_SHARE) -> None:
        self._least_ratio = least_ratio
        self._ticks = self._newest_ns = 0
        self.owed = False

    def update(self, predicted: float, rendered: float, energy: float, now_ns: int) -> bool:
        """One tick [ns] of a coupled hand: due and rendered force [N] and energy [J]; whether force is withheld."""
        if predicted >= LEAST_FORCE:
            self._ticks = self._ticks + 1 if rendered < self._least_ratio * predicted else 0
            self._newest_ns, self.owed = now_ns, energy < 0.0
        elif now_ns - self._newest_ns > FORGOTTEN_NS:
            self._ticks = 0
        return self._ticks >= LEAST_TICKS
