"""An operator that waits where it is."""

from __future__ import annotations

from typing import ClassVar

from foretouch.devices.device import Device, limit_force

__all__ = ["RestingOperator"]


class RestingOperator(Device):
    """A hand at 0 that never moves: what stands in for a script where nobody knows where the surface is."""

    __slots__ = ()
    name: ClassVar[str] = "resting"
    closed_loop: ClassVar[bool] = False

    def read(self, now_ns: int) -> float:
        """Position of the hand: 0 [m]."""
        return 0.0

    def render(self, force: float) -> float:
        """Nobody feels it: the force [N] within the limit that every device has."""
        return limit_force(force)
