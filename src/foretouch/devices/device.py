"""What a device is: where the operator's hand is, and what it is given to feel."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

from foretouch.devices.specification import DeviceSpecification

__all__ = ["FORCE_LIMIT", "Device", "limit_force"]

FORCE_LIMIT = 10.0
"""Largest force [N] that a device without a limit of its own accepts."""


class Device(ABC):
    """An operator's handle. It reads no clock: the caller says what time it is.

    Times never go back; a time that does counts as the newest one. The first time that `read` is given is the start.

    Attributes:
        name: Name of the device, one of `foretouch.devices.OPERATORS` for those in the package.
        closed_loop: Whether the rendered force moves the hand. Where it is False, the motion would have been the same
            without any force, and reports say so.
        real_time: Whether somebody's own hand moves it: then it needs a session in real time.
    """

    __slots__ = ()
    name: ClassVar[str]
    closed_loop: ClassVar[bool]
    real_time: ClassVar[bool] = False

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet, so that a simulated session can begin; True where a device does not say."""
        return True

    @abstractmethod
    def read(self, now_ns: int) -> float:
        """Position of the hand [m] in the probe's frame: 0 = start in free air, growing into the material."""

    @abstractmethod
    def render(self, force: float) -> float:
        """Give the hand a force [N], 0 or more, and return what it was really given after the device's own limits.

        A force that is not a number is rendered as none.
        """

    @property
    def specification(self) -> DeviceSpecification | None:
        """What the device can render; None where nothing is felt (open loop)."""
        return None

    @property
    def intention(self) -> float:
        """Where the hand wants to be [m] at the newest `read`; NaN where nobody knows."""
        return math.nan

    @property
    def exact_position(self) -> float:
        """Where the hand is [m] at the newest `read`, without the encoder's counts; NaN where nobody knows."""
        return math.nan

    @property
    def clutched(self) -> bool:
        """Whether the operator holds the clutch at the newest `read`: the hand moves, the probe is to stay."""
        return False

    def close(self) -> None:  # noqa: B027 - most hold nothing
        """Give no force any more and give back what the device holds; a second call does nothing."""


def limit_force(force: float, limit: float = FORCE_LIMIT) -> float:
    """The force [N] within 0 and `limit` [N]; 0 where it is not a number."""
    if not force > 0.0:
        return 0.0
    return force if force < limit else limit
