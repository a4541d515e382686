"""What a hand holds of an Inverse3: along a line, and in space."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

from foretouch.devices.device import LEAST_DAMPING, AnyDevice, Device, DeviceSpecification, limit_force
from foretouch.devices.inverse3.service import NAME, NO_FORCE, PATIENCE, InverseService
from foretouch.devices.spatial import NOWHERE, SpatialDevice
from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.quantities.pose import Vector


class _Held(AnyDevice):
    """What both have: the service's device in a hand, felt through it."""

    name: ClassVar[str] = NAME
    closed_loop: ClassVar[bool] = True
    real_time: ClassVar[bool] = True

    def __init__(self, service: InverseService, specification: DeviceSpecification | None = None) -> None:
        own = DeviceSpecification(damping=LEAST_DAMPING) if specification is None else specification
        self._specification = dataclasses.replace(own, watchdog=PATIENCE, pulls=True)
        self._service, self._closed = service, False

    @property
    def specification(self) -> DeviceSpecification:
        """Specification of the device. The maker states no damping, mass or friction: they are the settings'."""
        return self._specification

    @property
    def clutched(self) -> bool:
        """Whether the first button of a VerseGrip is pressed."""
        return self._service.clutched and not self._closed

    @property
    def lost(self) -> bool:
        """Whether the device shows no place any more, and gives no force until it is opened anew."""
        return self._service.lost

    def close(self) -> None:
        """No force any more; the service has the device back."""
        if not self._closed:
            self._closed = True
            self._service.close()


class Inverse3(_Held, Device):
    """An Inverse3 along one of its axes. 0 is where the hand is at the first `read`.

    Args:
        service: Connection to the service.
        specification: What the device is; its damping and delay say how stiff it may be rendered. None for the least
            damping that is assumed of such a device.
        axis: 0 (to the right), 1 (forward) or 2 (up).
        direction: 1 where that axis grows into the material, -1 where the other way: by default the hand presses down.

    Raises:
        SettingError: An axis or direction that is none.
    """

    def __init__(
        self,
        service: InverseService,
        specification: DeviceSpecification | None = None,
        *,
        axis: int = 2,
        direction: int = -1,
    ) -> None:
        require("axis", axis, at_least=0, at_most=2)
        if direction not in (-1, 1):
            raise SettingError("direction", direction, "must be 1 or -1")
        super().__init__(service, specification)
        self._axis, self._direction = axis, direction
        self._origin, self._position = math.nan, 0.0

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]; no number where the service is late, so that no force is held on a guess."""
        if self._closed:
            return self._position
        along = self._direction * self._service.place[self._axis]
        if not math.isfinite(along):
            return math.nan
        if math.isnan(self._origin):
            self._origin = along
        self._position = along - self._origin
        return self._position

    def render(self, force: float) -> float:
        """Give the hand a force [N], and return the force that it really gets."""
        force = 0.0 if self._closed else limit_force(force, self._specification.force_limit, pulls=True)
        pushed = [0.0, 0.0, 0.0]
        pushed[self._axis] = -self._direction * force
        return force if self._service.push((pushed[0], pushed[1], pushed[2])) else 0.0


class SpatialInverse3(_Held, SpatialDevice):
    """An Inverse3 in three dimensions: x to the right, y forward, z up, 0 at its foot.

    Args:
        service: Connection to the service.
        specification: What the device is along each axis, as for `Inverse3`.
    """

    def __init__(self, service: InverseService, specification: DeviceSpecification | None = None) -> None:
        super().__init__(service, specification)
        self._place: Vector = NOWHERE

    def read(self, now_ns: int) -> Vector:
        """Place of the hand [m]; no numbers where the service is late."""
        if self._closed:
            return self._place
        place = self._service.place
        if place is not NOWHERE:
            self._place = place
        return place

    def render(self, force: Vector) -> None:
        """Give the hand a force [N], no larger than the limit; what is no number is none."""
        size = math.hypot(*force)
        if self._closed or not size < math.inf:
            force = NO_FORCE
        elif size > (limit := self._specification.force_limit):
            x, y, z = force
            force = x * limit / size, y * limit / size, z * limit / size
        self._service.push(force)
