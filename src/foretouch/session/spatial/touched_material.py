"""The law of the place where the hand is, from the newest field of materials, and its doubt."""

from __future__ import annotations

import math

from foretouch.errors import DecodeError, InputError
from foretouch.messages import FieldUpdate
from foretouch.models import FIELD_DEPTH, MaterialField, QuadraticContact
from foretouch.quantities.pose import Vector, norm, subtract

__all__ = ["TouchedMaterial"]

FAR_FROM_LAW = 1e-3
"""The material of another place is taken once the hand is so far from where it was taken last [m]."""

NEAR = 5e-3
"""Materials are taken from the field within this way of the surface [m]."""

NOWHERE = (math.nan, math.nan, math.nan)


class TouchedMaterial:
    r"""What is known of the surface's material, place by place, at the leader.

    A field states the standard deviation of the local stiffness K at 2 mm. The force at a place is doubted in the same
    proportion,

    .. math:: \sigma_F = F\, \sigma_K / K

    Attributes:
        doubt: sigma_K / K of the law that was taken last; NaN before the first.
        refused: Fields that could not be used.
    """

    __slots__ = ("_at", "_field", "_run", "_sequence", "doubt", "refused")

    def __init__(self) -> None:
        self._field: MaterialField | None = None
        self._sequence = self._run = 0
        self._at: Vector = NOWHERE
        self.doubt = math.nan
        self.refused = 0

    def take(self, update: FieldUpdate) -> None:
        """Take a field, unless a newer one of the same process of the follower is there already."""
        if update.run == self._run and update.sequence <= self._sequence:
            return
        self._sequence, self._run = update.sequence, update.run
        try:
            self._field = MaterialField.from_bytes(update.content)
        except (InputError, DecodeError):
            self.refused += 1

    def law(self, point: Vector, depth: float) -> QuadraticContact | None:
        """The law of a place; None where nothing is known of it, or the hand is too far above.

        Args:
            point: On the surface, in the fixture's frame [m].
            depth: Of the hand below it [m].
        """
        if self._field is None or depth < -NEAR:
            return None
        law, deviation, known = self._field.law_at(point)
        stiffness = law.stiffness + 2.0 * FIELD_DEPTH * law.stiffening
        self.doubt = deviation / stiffness if stiffness > 0.0 else math.nan
        if not known:
            return None
        self._at = point
        return law

    def is_elsewhere(self, point: Vector) -> bool:
        """Whether the law was taken so far from this point, or never, that another may hold."""
        return not norm(subtract(point, self._at)) <= FAR_FROM_LAW
