"""Where a hand would have been, had it felt nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import GRIPS, Device, DeviceSpecification, Hand
from foretouch.errors import ForetouchError
from foretouch.messages import SessionLog

__all__ = ["free_hand"]

Array = NDArray[np.float64]


class _Intention(Device):
    """What a hand wanted, read again."""

    name = "recorded intention"
    closed_loop = False

    def __init__(self, positions: Array) -> None:
        self._positions = iter(positions.tolist())

    def read(self, now_ns: int) -> float:
        return float(next(self._positions))

    def render(self, force: float) -> float:
        return 0.0


def free_hand(log: SessionLog) -> Array | None:
    """Where the hand that the settings name would have been by its intention alone, without any force [m].

    Args:
        log: The session.

    Returns:
        Positions, shape (n,), NaN where nobody knows what the hand wanted; None where nobody knows whose hand it is, or
        what device it holds.
    """
    try:
        grip = GRIPS[log.settings["grip"]]
        mass, damping, friction = (float(log.settings[f"device_{name}"]) for name in ("mass", "damping", "friction"))
        device = DeviceSpecification(mass=mass, damping=damping, friction=friction, resolution=0.0)
    except (KeyError, ValueError, ForetouchError):
        return None
    wanted = log.leader["intended_position"]
    known = np.isfinite(wanted)
    hand = Hand(_Intention(wanted[known]), grip, device)
    places = np.full(wanted.size, np.nan)
    places[known] = [hand.read(now) for now in log.leader["time_ns"][known].tolist()]
    return places
