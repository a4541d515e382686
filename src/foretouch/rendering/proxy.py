"""The proxy: position of the operator's hand for the model and for the follower."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Held, Kernel, Record, compiled
from foretouch.errors.checks import require

RETURN_SPEED = 0.01  # Speed of the proxy at which the indexed distance is given back [m/s]
CLEARANCE = 1e-3  # Distance from the surface up to which the proxy is brought back in free air [m]

LARGEST_MOVE = 5e-4
"""Least jump of a surface towards the hand [m] that is met by the index; smaller ones are met by mediation alone."""


class ProxyState(Record):
    """State of a `Proxy`."""

    scale: float = 1.0  # p
    reference: float  # i_0 [m]
    hand: float = math.nan  # x [m]
    position: float = math.nan  # y [m]
    engaged: bool
    indexed: float  # i_1 [m]
    yielded: float  # i_2 [m]


@compiled
def place(proxy: ProxyState) -> None:
    """Put the proxy where its distance from the hand says."""
    proxy.position = proxy.scale * proxy.hand - (proxy.reference + proxy.indexed + proxy.yielded)


@compiled
def engage(proxy: ProxyState, hand: float, position: float) -> None:
    """See `Proxy.engage`."""
    proxy.hand, proxy.reference = hand, proxy.scale * hand - position
    proxy.indexed = proxy.yielded = 0.0
    proxy.engaged = True
    place(proxy)


@compiled
def leave(proxy: ProxyState) -> None:
    """See `Proxy.leave`."""
    proxy.engaged = False
    proxy.position = math.nan


@compiled
def follow(proxy: ProxyState, hand: float, share: float, free: float) -> float:
    """See `Proxy.follow`."""
    if proxy.engaged and math.isfinite(hand):
        if share != 1.0:
            way = proxy.scale * (hand - proxy.hand)
            carried = max(way - free, 0.0) if way > 0.0 else way
            proxy.yielded = max(proxy.yielded + (1.0 - share) * carried, 0.0)
        proxy.hand = hand
        place(proxy)
    return float(proxy.position)


@compiled
def index(proxy: ProxyState, distance: float) -> None:
    """See `Proxy.index`."""
    proxy.indexed += distance
    place(proxy)


@compiled
def give_back(proxy: ProxyState, distance: float, yielded: bool) -> float:
    """See `Proxy.give_back`; how far the proxy moved by it [m], which causes no damping force."""
    before = proxy.position
    returned = min(distance, proxy.indexed)
    proxy.indexed -= returned
    if yielded:
        proxy.yielded -= min(distance - returned, proxy.yielded)
    place(proxy)
    return float(proxy.position - before)


@compiled
def return_freely(proxy: ProxyState, depth: float, period: float) -> float:
    """Bring the proxy back in free air, up to a distance from the surface; how far it moved [m]."""
    return give_back(proxy, min(max(-CLEARANCE - depth, 0.0), RETURN_SPEED * period), True)


@compiled
def meet(proxy: ProxyState, before: float, surface: float) -> float:
    """Keep the depth below the former surface [m] at a new one; how far the proxy moved outwards [m].

    Where the new surface is further from the hand, the proxy goes back by at most the indexed distance.
    """
    depth = 0.0 if math.isnan(before) else max(proxy.position - before, 0.0)
    nearer = max(proxy.position - surface - depth, -proxy.indexed)
    if not abs(nearer) > LARGEST_MOVE:
        return 0.0
    index(proxy, nearer)
    return float(nearer)


_engage = Kernel(engage, "(ProxyState, f8, f8)")
_follow = Kernel(follow, "(ProxyState, f8, f8, f8)")
_index = Kernel(index, "(ProxyState, f8)")
_give_back = Kernel(give_back, "(ProxyState, f8, b1)")
_return_freely = Kernel(return_freely, "(ProxyState, f8, f8)")


class Proxy(Held):
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
        proxies: Array of one `ProxyState` that this one takes, part of another record; None for one of its own.

    Attributes:
        position: Position y [m]; NaN until hand and proxy are coupled.
        engaged: Whether they are coupled.
        indexed: i_1 [m], not negative.
        yielded: i_2 [m], not negative.
    """

    __slots__ = ()

    position: float
    engaged: bool
    indexed: float
    yielded: float

    def __init__(self, scale: float = 1.0, *, proxies: NDArray[np.void] | None = None) -> None:
        require("position_scale", scale, above=0.0)
        super().__init__(ProxyState.new() if proxies is None else proxies)
        self.records[:] = ProxyState.new(scale=scale)

    @property
    def apart(self) -> float:
        """Distance that is to be given back [m], not negative: the hand is further in by it."""
        return self.indexed + self.yielded

    def engage(self, hand: float, position: float | None = None) -> None:
        """Couple the hand with a proxy at this position [m]; without one, at the scaled position of the hand."""
        _engage.entry(self.records[0], hand, self.scale * hand if position is None else position)

    def release(self) -> None:
        """Uncouple the hand; the proxy stays."""
        self.engaged = False

    def leave(self) -> None:
        """Uncouple the hand; the proxy has no position until it is coupled again."""
        self.engaged, self.position = False, math.nan

    def follow(self, hand: float, share: float = 1.0, free: float = 0.0) -> float:
        """Carry the proxy along with the hand [m]; returns y [m].

        Args:
            hand: Position x [m]; one that is not a number counts as not moved.
            share: Share rho of the motion, 0 to 1.
            free: Distance of the proxy to the surface [m], over which there is nothing to carry.
        """
        return _follow.entry(self.records[0], hand, share, free)

    def index(self, distance: float) -> None:
        """Move the proxy outwards by this distance [m]; inwards, if negative, by at most the indexed distance."""
        _index.entry(self.records[0], distance)

    def give_back(self, distance: float, *, yielded: bool) -> None:
        """Bring the proxy back by at most this distance [m]; with `yielded` that distance too, last."""
        _give_back.entry(self.records[0], distance, yielded)

    def return_freely(self, depth: float, period: float) -> float:
        """In free air bring it back, at this depth below the surface [m], for a period [s]; how far it moved [m]."""
        return _return_freely.entry(self.records[0], depth, period)
