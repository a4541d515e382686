"""Force that is withheld: a model gives it, and the hand is given less than half of it for a while.

What mediation and the ceiling of energy cut for a moment nobody misses; a hand that presses and feels next to nothing
for half a second has to be told why.
"""

from __future__ import annotations

from foretouch.rendering.limits import LARGEST_FORCE

LEAST_FORCE = 0.5
"""Models that give less are not missed [N]."""

LEAST_SHARE = 0.5
"""A hand that is given less than this share of it is not given the force."""

LEAST_TICKS = 500
"""It is withheld after so many ticks in a row in which a model gave force: half a second. Times between presses, in
which it gives none, neither count nor begin anew ..."""

FORGOTTEN_NS = 2_000_000_000
"""... unless they are longer than this [ns]: then whoever is told has gone."""

OWED = "the hand was given more energy than it put in, and owes it"
UNPAID = "nobody had paid yet for what the model would give back"
"""Why force is withheld: the account of energy is below zero, or what the hand has put in does not reach."""


def due_force(predicted: float, force_scale: float) -> float:
    """What of a model's force the hand is due [N]: in its scale, and within the limit."""
    force = force_scale * predicted
    return force if force < LARGEST_FORCE else LARGEST_FORCE


class Withheld:
    """Whether force is withheld, from tick to tick.

    Attributes:
        owed: Whether the account of energy was below zero in the newest tick that counted.
    """

    __slots__ = ("_newest_ns", "_ticks", "owed")

    def __init__(self) -> None:
        self._ticks = self._newest_ns = 0
        self.owed = False

    def update(self, predicted: float, rendered: float, energy: float, now_ns: int) -> bool:
        """One tick of a hand that is coupled.

        Args:
            predicted: What the hand is due (`due_force`) [N].
            rendered: What it is given [N].
            energy: Of the account [J].
            now_ns: Time of the tick [ns].

        Returns:
            Whether force is withheld.
        """
        if predicted >= LEAST_FORCE:
            self._ticks = self._ticks + 1 if rendered < LEAST_SHARE * predicted else 0
            self._newest_ns, self.owed = now_ns, energy < 0.0
        elif now_ns - self._newest_ns > FORGOTTEN_NS:
            self._ticks = 0
        return self._ticks >= LEAST_TICKS
