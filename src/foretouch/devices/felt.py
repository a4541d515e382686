"""A device whose force a hand feels: what its driver has to say and do, and what is the same for all of them.

Along a line and in space it gives at most its force limit, none that is no number, and none where the session falls
silent or has closed it.
"""

from __future__ import annotations

import dataclasses
import math
import threading
import time
from abc import ABC, abstractmethod
from typing import ClassVar

from foretouch.devices.device import AnyDevice, Device, DeviceSpecification, limit_force
from foretouch.devices.spatial import NOWHERE, SpatialDevice
from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.quantities.pose import Vector

PATIENCE, LOOKS = 0.04, 0.01
"""Time without a `render` after which the force is set to zero [s], and how often a thread looks for that [s]."""

NO_FORCE: Vector = (0.0, 0.0, 0.0)


class HandleLink(ABC):
    """Driver of a handle that gives a force. Places and forces are in the device's own axes.

    Attributes:
        watchdog: Longest time that the device gives a force which is not renewed [s].
    """

    watchdog: float = PATIENCE + LOOKS

    @property
    def clutched(self) -> bool:
        """Whether the operator holds the clutch; a device without one has none held."""
        return False

    @property
    def lost(self) -> bool:
        """Whether the device shows no place any more, and gives no force until it is opened anew."""
        return False

    @abstractmethod
    def place(self) -> Vector:
        """Where the hand is [m]; no numbers where the device does not show it, so that no force is held on a guess."""

    @abstractmethod
    def push(self, force: Vector) -> bool:
        """Give the hand a force [N], and say whether it got it; one whose place is unknown gets none."""

    @abstractmethod
    def close(self) -> None:
        """Give the device back, once its force is zero."""


class FeltDevice(AnyDevice):
    """A handle that a hand holds and feels.

    Calls come from the loop, and `close` from any thread: nothing is given after it. Where nothing has been rendered
    for 40 ms, a thread of its own sets the force to zero within 10 ms.

    Args:
        link: Its driver, opened; closed with the device.
        specification: What the device is; its damping and delay say how stiff it may be rendered. Its watchdog is the
            driver's.
    """

    closed_loop: ClassVar[bool] = True
    real_time: ClassVar[bool] = True

    def __init__(self, link: HandleLink, specification: DeviceSpecification) -> None:
        self._link, self._closed, self._rendered = link, False, -math.inf
        self._specification = dataclasses.replace(specification, watchdog=link.watchdog, pulls=True)
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._watch = threading.Thread(target=self._watch_renders, name=f"{self.name} watch", daemon=True)
        self._watch.start()

    @property
    def specification(self) -> DeviceSpecification:
        """Specification of the device: it can pull."""
        return self._specification

    @property
    def clutched(self) -> bool:
        """Whether the operator holds the clutch."""
        return not self._closed and self._link.clutched

    @property
    def lost(self) -> bool:
        """Whether the device shows no place any more, and gives no force until it is opened anew."""
        return self._link.lost

    def close(self) -> None:
        """No force any more, and the device is given back."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._link.push(NO_FORCE)
        self._ended.set()
        self._watch.join(1.0)
        self._link.close()

    def _give(self, force: Vector) -> bool:
        """Give the hand a force [N]; whether it got it."""
        with self._lock:
            self._rendered = time.monotonic()
            return not self._closed and self._link.push(force)

    def _watch_renders(self) -> None:
        """Set the force to zero where `render` is no longer called."""
        while not self._ended.wait(LOOKS):
            with self._lock:
                if not self._closed and time.monotonic() - self._rendered > PATIENCE:
                    self._link.push(NO_FORCE)


class FeltAlongAxis(FeltDevice, Device):
    """Along one of the device's axes. 0 is where the hand is at the first `read`.

    Args:
        link: Driver of the device.
        specification: What the device is.
        axis: 0, 1 or 2.
        direction: 1 where that axis grows into the material, -1 where the other way: by default the hand presses down.

    Raises:
        SettingError: An axis or direction that is none.
    """

    def __init__(
        self, link: HandleLink, specification: DeviceSpecification, *, axis: int = 2, direction: int = -1
    ) -> None:
        require("axis", axis, at_least=0, at_most=2)
        if direction not in (-1, 1):
            raise SettingError("direction", direction, "must be 1 or -1")
        self._axis, self._direction = axis, direction
        self._origin, self._position = math.nan, 0.0
        super().__init__(link, specification)

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]; no number where the device does not show it."""
        if self._closed:
            return self._position
        along = self._direction * self._link.place()[self._axis]
        if not math.isfinite(along):
            return math.nan
        if math.isnan(self._origin):
            self._origin = along
        self._position = along - self._origin
        return self._position

    def render(self, force: float) -> float:
        """Give the hand a force [N], and return the force that it really got."""
        force = limit_force(force, self._specification.force_limit, pulls=True)
        pushed = [0.0, 0.0, 0.0]
        pushed[self._axis] = -self._direction * force
        return force if self._give((pushed[0], pushed[1], pushed[2])) else 0.0


class FeltInSpace(FeltDevice, SpatialDevice):
    """In three dimensions, in the device's axes.

    Args:
        link: Driver of the device.
        specification: What the device is along each axis; its force limit is that of the whole force.
    """

    _place = NOWHERE

    def read(self, now_ns: int) -> Vector:
        """Place of the hand [m]; no numbers where the device does not show it."""
        if self._closed:
            return self._place
        place = self._link.place()
        if not math.isfinite(sum(place)):
            return NOWHERE
        self._place = place
        return place

    def render(self, force: Vector) -> None:
        """Give the hand a force [N], no larger than the limit; what is no number is none."""
        size, limit = math.hypot(*force), self._specification.force_limit
        if not size < math.inf:
            force = NO_FORCE
        elif size > limit:
            x, y, z = force
            force = x * limit / size, y * limit / size, z * limit / size
        self._give(force)
