"""When hand and follower belong together: from the first that is known of both, but for a pressed clutch."""

from __future__ import annotations

import math

from foretouch.rendering import Proxy

__all__ = ["meeting_place"]


def meeting_place(proxy: Proxy, hand: float, follower: float, *, clutched: bool) -> float:
    """Where a hand and a proxy that are apart are to be coupled in this tick [m]; NaN where they are not to be.

    They meet where the follower is, and after a clutch where the proxy was left; a pressed clutch lets the hand go.

    Args:
        proxy: Of the hand.
        hand: Its position [m]; one that is no number is not coupled.
        follower: Where the follower is, as far as it is known [m]; NaN before.
        clutched: Whether the clutch is pressed.
    """
    if clutched:
        proxy.release()
    if clutched or proxy.engaged or not math.isfinite(hand):
        return math.nan
    return follower if math.isnan(proxy.position) else proxy.position
