"""The proxy: position of the operator's hand for the model and for the follower."""

from __future__ import annotations

import math

from foretouch.errors.checks import require

RETURN_SPEED = 0.01
"""Speed of the proxy at which the indexed distance is given back [m/s]."""


class Proxy:
    r"""The point that is sent to the follower and at which the model is evaluated; the hand carries it along.

    .. math:: y = p\,x - i, \quad i = i_0 + i_1 + i_2

    p is the position scale, x the hand, and i the distance between hand and proxy:

    - :math:`i_0`, the reference: set when hand and proxy are coupled, so that nothing jumps whatever their poses, and
      anew each time that the clutch is let go;
    - :math:`i_1`, indexed: a surface that turned up where the hand already was is met by it;
    - :math:`i_2`, yielded: while the device can carry no more than a share rho of the model's stiffness, the proxy
      takes part in that share of the hand's motion, both ways, :math:`\dot i_2 = (1 - \rho)\, p\, \dot x`, but never
      leaves later than the hand does, :math:`i_2 \ge 0`.

    Indexed and yielded are to be given back, the reference is not.

    Args:
        scale: p, positive.

    Attributes:
        position: Position y [m]; NaN until hand and proxy are coupled.
        engaged: Whether they are coupled.
        indexed: i_1 [m], not negative.
        yielded: i_2 [m], not negative.
    """

    __slots__ = ("_hand", "_reference", "_scale", "engaged", "indexed", "position", "yielded")

    def __init__(self, scale: float = 1.0) -> None:
        require("position_scale", scale, above=0.0)
        self._scale = scale
        self._reference = 0.0
        self._hand = math.nan
        self.position = math.nan
        self.engaged = False
        self.indexed = 0.0
        self.yielded = 0.0

    @property
    def apart(self) -> float:
        """Distance that is to be given back [m], not negative: the hand is further in by it."""
        return self.indexed + self.yielded

    def engage(self, hand: float, position: float | None = None) -> None:
        """Couple the hand with a proxy at this position [m]; without one, at the scaled position of the hand."""
        self._hand = hand
        self._reference = 0.0 if position is None else self._scale * hand - position
        self.indexed = self.yielded = 0.0
        self.engaged = True
        self._place()

    def release(self) -> None:
        """Uncouple the hand; the proxy stays."""
        self.engaged = False

    def leave(self) -> None:
        """Uncouple the hand; the proxy has no position until it is coupled again."""
        self.engaged = False
        self.position = math.nan

    def follow(self, hand: float, share: float = 1.0, free: float = 0.0) -> float:
        """Carry the proxy along with the hand [m]; returns y [m].

        Args:
            hand: Position x [m]; one that is not a number counts as not moved.
            share: Share rho of the motion, 0 to 1.
            free: Distance of the proxy to the surface [m], over which there is nothing to carry.
        """
        if self.engaged and math.isfinite(hand):
            if share != 1.0:
                way = self._scale * (hand - self._hand)
                carried = max(way - free, 0.0) if way > 0.0 else way
                self.yielded = max(self.yielded + (1.0 - share) * carried, 0.0)
            self._hand = hand
            self._place()
        return self.position

    def index(self, distance: float) -> None:
        """Move the proxy outwards by this distance [m]; inwards, if negative, by at most the indexed distance."""
        self.indexed += distance
        self._place()

    def give_back(self, distance: float, *, yielded: bool) -> None:
        """Bring the proxy back by at most this distance [m]; with `yielded` that distance too, last."""
        returned = min(distance, self.indexed)
        self.indexed -= returned
        if yielded:
            self.yielded -= min(distance - returned, self.yielded)
        self._place()

    def _place(self) -> None:
        self.position = self._scale * self._hand - (self._reference + self.indexed + self.yielded)
