"""An operator's time: a hand that feels something begins once it is coupled."""

from __future__ import annotations

from foretouch.devices import Device, SpatialDevice

__all__ = ["OperatorClock"]


class OperatorClock:
    """The clock that an operator is read by.

    A hand that holds a device waits where it is until it is known where the follower is; a person would. From then on
    its time runs, from zero. For an operator that feels nothing it is the session's own clock.

    Args:
        operator: Whose time it is.
    """

    __slots__ = ("_begun_ns", "_waits")

    def __init__(self, operator: Device | SpatialDevice) -> None:
        self._waits = operator.closed_loop
        self._begun_ns = 0

    def read(self, now_ns: int, *, coupled: bool) -> int:
        """The operator's time [ns] at the session's [ns]; `coupled` says whether hand and follower have met."""
        if self._waits:
            self._begun_ns, self._waits = now_ns, not coupled
        return now_ns - self._begun_ns
