"""Devices of Force Dimension (omega, delta, sigma; Novint's Falcon), by ``forcedimension-core``.

Written after the binding's and the SDK's documentation and tested against a stand-in of the binding's functions: **it
has not been tried on a device**. `docs/devices.md` says what to do at a first try.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import math
from types import ModuleType
from typing import Any, ClassVar

from foretouch.devices.device import DeviceSpecification
from foretouch.devices.felt import NO_FORCE, FeltAlongAxis, HandleLink
from foretouch.devices.spatial import NOWHERE
from foretouch.errors import MissingExtraError, SettingError
from foretouch.quantities.pose import Vector

SUCCESS = (0, 1, 2)
"""What the SDK's functions return where they did it: 0; 1, asked again too soon (DHD_TIMEGUARD); 2, a motor at its end
(DHD_MOTOR_SATURATED)."""

FAILURES = 10  # Failed reads in a row after which the device counts as lost: no force until it is opened anew

WATCHDOG_TICKS, TICK = 160, 125e-6
"""Time after which a device with a watchdog sets the force to zero itself: 20 ms, in counts of 125 us; a count [s]."""

NAME = "force-dimension"


class ForceDimensionLink(HandleLink):
    """The first device on this machine. Its axes: x towards the operator, y to the operator's right, z up.

    The force is limited in the SDK (`setMaxForce`) too. Where the device can, its own watchdog ends it after 20 ms.

    Args:
        binding: ``forcedimension_core.dhd``: lengths in metres, forces in newtons, -1 where a function failed.
        force_limit: Largest force that the SDK is to let through [N].
        watchdog: ``forcedimension_core.dhd.expert.setWatchdog``; None without one.

    Raises:
        SettingError: No device, or one that shows no position or takes no force.
    """

    def __init__(self, binding: Any, force_limit: float, watchdog: Any = None) -> None:
        self._binding, self._found, self._failed = binding, [0.0, 0.0, 0.0], 0
        self._id = binding.open()
        if self._id < 0:
            reason = f"no device of Force Dimension opens ({binding.errorGetLastStr()})"
            raise SettingError("operator", NAME, f"{reason}: plug it in and switch it on, and see that no other has it")
        lacks = self._begin(force_limit, watchdog)
        if lacks:
            reason = f"the device {lacks}: {binding.errorGetLastStr()}"
            self.close()
            raise SettingError("operator", NAME, reason)

    @property
    def clutched(self) -> bool:
        """Whether the device's first button is pressed."""
        return not self.lost and self._binding.getButton(0, self._id) == 1

    @property
    def lost(self) -> bool:
        """Whether ten reads in a row have failed, as of a device that is unplugged."""
        return self._failed >= FAILURES

    def place(self) -> Vector:
        """Where the hand is [m]; no numbers where the device does not show it."""
        if self.lost:
            return NOWHERE
        if self._binding.getPosition(self._found, self._id) in SUCCESS and math.isfinite(sum(self._found)):
            self._failed = 0
            return self._found[0], self._found[1], self._found[2]
        self._failed += 1
        return NOWHERE

    def push(self, force: Vector) -> bool:
        """Give the hand a force [N], and none where the device is lost; whether the device took it."""
        given = NO_FORCE if self.lost else force
        return self._binding.setForce(given, self._id) in SUCCESS and not self.lost

    def close(self) -> None:
        """No motors, and the device is given back."""
        self._binding.enableForce(False, self._id)
        self._binding.close(self._id)

    def _begin(self, force_limit: float, watchdog: Any) -> str:
        """Let the device give forces, none at first; what it does not do, "" for nothing."""
        binding = self._binding
        if binding.getPosition(self._found, self._id) not in SUCCESS:
            return "shows no position"
        if watchdog is not None and watchdog(WATCHDOG_TICKS, self._id) in SUCCESS:  # not every device has one
            self.watchdog = WATCHDOG_TICKS * TICK
        limited = binding.setMaxForce(force_limit, self._id) in SUCCESS
        enabled = limited and binding.enableForce(True, self._id) in SUCCESS
        return "" if enabled and self.push(NO_FORCE) else "takes no force"


class ForceDimension(FeltAlongAxis):
    """A device of Force Dimension along one of its axes."""

    name: ClassVar[str] = NAME


def open_force_dimension(specification: DeviceSpecification) -> ForceDimension:
    """The first device of Force Dimension on this machine, which presses down; `specification` says what it is.

    Raises:
        MissingExtraError: ``forcedimension-core`` is not installed.
        SettingError: The SDK's libraries (libdhd, libdrd) are not there, or no device is.
    """
    dhd, expert = _binding()
    return ForceDimension(ForceDimensionLink(dhd, specification.force_limit, expert.setWatchdog), specification)


def _binding() -> tuple[ModuleType, ModuleType]:
    """The binding, whose import needs the SDK's libraries."""
    try:
        with contextlib.redirect_stderr(io.StringIO()):  # it says there too what it is about to raise
            return (
                importlib.import_module("forcedimension_core.dhd"),
                importlib.import_module("forcedimension_core.dhd.expert"),
            )
    except ModuleNotFoundError:
        raise MissingExtraError("forcedimension-core", "forcedimension") from None
    except (ImportError, OSError) as error:
        text = " ".join(str(error).split())
        rule = "needs libdhd and libdrd of the Force Dimension SDK, version 3.16 or later: install it and set FDSDK or"
        raise SettingError("operator", NAME, f"{rule} LD_LIBRARY_PATH to it ({text})") from None
