"""A device that swings: in the place of a driver of your own."""

from __future__ import annotations

import math
from typing import ClassVar

from foretouch.devices import Device, Reach
from foretouch.session import SessionSettings

LARGEST_FORCE = 10.0
"""[N]."""


class Swing(Device):
    r"""A hand that swings smoothly between its start and a depth, whatever it feels.

    .. math:: x = a \sin^2(\pi f t)

    Args:
        farthest: a, where it turns [m].
        frequency: f [Hz].
    """

    name: ClassVar[str] = "swing"
    closed_loop: ClassVar[bool] = False  # the force moves nobody's hand; True needs a `specification`
    real_time: ClassVar[bool] = False  # True where somebody's own hand moves it

    def __init__(self, farthest: float, frequency: float = 0.5) -> None:
        self._farthest, self._frequency = farthest, frequency
        self._start_ns: int | None = None
        self._newest_ns = 0

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]; times never go back."""
        if self._start_ns is None:
            self._start_ns = now_ns
        self._newest_ns = max(self._newest_ns, now_ns)
        time = (self._newest_ns - self._start_ns) * 1e-9
        return self._farthest * math.sin(math.pi * self._frequency * time) ** 2

    def render(self, force: float) -> float:
        """The force that the hand was really given [N]; none where it is no number."""
        return 0.0 if math.isnan(force) else min(max(force, 0.0), LARGEST_FORCE)


def make_swing(settings: SessionSettings, reach: Reach) -> Swing:
    """The device of a session; `reach` says where the material begins, NaN where nobody knows."""
    return Swing(reach.surface + 0.7 * reach.press_depth if reach.known else 0.015)
