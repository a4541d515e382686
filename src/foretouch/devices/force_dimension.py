"""Devices of Force Dimension (omega, delta, sigma; Novint's Falcon), by ``forcedimension-core``.

Written after the binding's and the SDK's documentation and tested against a stand-in of the binding's functions: **it
has not been tried on a device**. `docs/devices.md` says what to do at a first try.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import io
import math
import threading
from types import ModuleType
from typing import Any, ClassVar

from foretouch.devices.device import LEAST_DAMPING, Device, DeviceSpecification, limit_force
from foretouch.errors import MissingExtraError, SettingError
from foretouch.errors.checks import require

SUCCESS = (0, 1, 2)
"""What the SDK's functions return where they did it: 0; 1, asked again too soon (DHD_TIMEGUARD); 2, a motor at its end
(DHD_MOTOR_SATURATED)."""

FAILURES = 10  # Failed reads in a row after which the device counts as dead: no force until it is opened anew
PATIENCE = 0.05  # Time without a `render` after which a thread of its own sets the force to zero [s]

WATCHDOG_TICKS = 160
"""Time after which a device with a watchdog sets the force to zero itself: 20 ms, in counts of 125 us."""

NAME = "force-dimension"


class ForceDimension(Device):
    """A device of Force Dimension along one of its axes. 0 is where the hand is when it is opened.

    The force is limited here, in the SDK (`setMaxForce`) and by the device. It is zero after `close`, where a read has
    failed ten times in a row (a device that is unplugged), and where nothing has been rendered for
    50 ms, by a thread of its own and, where the device can, by its own watchdog after 20 ms.

    Args:
        binding: ``forcedimension_core.dhd``: lengths in metres, forces in newtons, -1 where a function failed.
        specification: What the device is; its damping, delay and encoder say how stiff it may be rendered. None for
            the least damping that is assumed of such a device. Its watchdog is what is found here.
        axis: 0 (towards the operator), 1 (to the operator's right) or 2 (up).
        direction: 1 where that axis grows into the material, -1 where the other way: by default the hand presses down.
        watchdog: ``forcedimension_core.dhd.expert.setWatchdog``; None without one.

    Raises:
        SettingError: No device, one that shows no position or takes no force, or an argument out of range.
    """

    name: ClassVar[str] = NAME
    closed_loop: ClassVar[bool] = True
    real_time: ClassVar[bool] = True

    def __init__(
        self,
        binding: Any,
        specification: DeviceSpecification | None = None,
        *,
        axis: int = 2,
        direction: int = -1,
        watchdog: Any = None,
    ) -> None:
        require("axis", axis, at_least=0, at_most=2)
        if direction not in (-1, 1):
            raise SettingError("direction", direction, "must be 1 or -1")
        self._binding, self._axis, self._direction = binding, axis, direction
        self._specification = DeviceSpecification(damping=LEAST_DAMPING) if specification is None else specification
        self._lock = threading.Lock()
        self._place, self._force = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        self._position, self._origin, self._failed = 0.0, 0.0, 0
        self._closed, self._rendered = False, 0
        self._id = binding.open()
        if self._id < 0:
            reason = f"no device of Force Dimension opens ({binding.errorGetLastStr()})"
            raise SettingError("operator", NAME, f"{reason}: plug it in and switch it on, and see that no other has it")
        try:
            self._begin(watchdog)
        except SettingError:
            binding.close(self._id)
            raise
        self._watch = threading.Thread(target=self._watch_renders, name="force-dimension watchdog", daemon=True)
        self._ended = threading.Event()
        self._watch.start()

    @property
    def specification(self) -> DeviceSpecification:
        """Specification of the device."""
        return self._specification

    @property
    def clutched(self) -> bool:
        """Whether the device's first button is pressed."""
        return not self.dead and not self._closed and self._binding.getButton(0, self._id) == 1

    @property
    def dead(self) -> bool:
        """Whether its reads have failed too often: it shows no position any more, and gives no force."""
        return self._failed >= FAILURES

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]; no number where the device shows none, so that no force is held on a guess."""
        if self._closed:
            return self._position
        answer = self._binding.getPosition(self._place, self._id)
        position = self._direction * self._place[self._axis]
        if answer in SUCCESS and math.isfinite(position):
            if self.dead:
                return math.nan
            self._failed, self._position = 0, position - self._origin
            return self._position
        self._failed += 1
        if self._failed == FAILURES:
            self._set(0.0)
        return math.nan

    def render(self, force: float) -> float:
        """Give the hand a force [N], and return the force that it really got."""
        force = limit_force(force, self._specification.force_limit, pulls=True)
        self._rendered += 1
        if self._closed or self.dead:
            return 0.0
        return force if self._set(force) else 0.0

    def close(self) -> None:
        """No force, no motors, and the device is given back."""
        if self._closed:
            return
        self._closed = True
        self._ended.set()
        self._watch.join(1.0)
        self._set(0.0)
        self._binding.enableForce(False, self._id)
        self._binding.close(self._id)

    def _begin(self, watchdog: Any) -> None:
        binding, limit = self._binding, self._specification.force_limit
        if binding.getPosition(self._place, self._id) not in SUCCESS:
            raise SettingError("operator", NAME, f"the device shows no position: {binding.errorGetLastStr()}")
        self._origin = self._direction * self._place[self._axis]
        own = watchdog is not None and watchdog(WATCHDOG_TICKS, self._id) in SUCCESS  # not every device has one
        ends = WATCHDOG_TICKS * 125e-6 if own else 2.0 * PATIENCE
        self._specification = dataclasses.replace(self._specification, watchdog=ends, pulls=True)
        if binding.setMaxForce(limit, self._id) not in SUCCESS or binding.enableForce(True, self._id) not in SUCCESS:
            raise SettingError("operator", NAME, f"the device takes no force: {binding.errorGetLastStr()}")
        if not self._set(0.0):
            raise SettingError("operator", NAME, f"the device takes no force: {binding.errorGetLastStr()}")

    def _set(self, force: float) -> bool:
        """Push the hand out with a force [N]; whether the device took it."""
        with self._lock:
            self._force[self._axis] = -self._direction * force
            return self._binding.setForce(self._force, self._id) in SUCCESS

    def _watch_renders(self) -> None:
        """Set the force to zero where `render` is no longer called."""
        before = -1
        while not self._ended.wait(PATIENCE):
            if self._rendered == before:
                self._set(0.0)
            before = self._rendered


def open_force_dimension(specification: DeviceSpecification | None = None) -> ForceDimension:
    """The first device of Force Dimension on this machine.

    Raises:
        MissingExtraError: ``forcedimension-core`` is not installed.
        SettingError: The SDK's libraries (libdhd, libdrd) are not there, or no device is.
    """
    dhd, expert = _binding()
    return ForceDimension(dhd, specification, watchdog=expert.setWatchdog)


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
