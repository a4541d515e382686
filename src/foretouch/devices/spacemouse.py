"""A SpaceMouse of 3Dconnexion as a handle that is moved by rate. It gives no force.

The reports are read as they come from the mouse (`hidapi`), without the maker's driver: id 1 is how far the cap is
pushed, three numbers of 16 bits, and in some mice three more of its rotation; id 3 is the buttons. That, the signs and
the numbers of the products are those of public drivers of these mice; tested against a stand-in of the reports: **it
has not been tried on a mouse**.
"""

from __future__ import annotations

import importlib
import math
import struct
import sys
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple

from foretouch.devices.device import Device, Tracker, limit_force
from foretouch.devices.gamepad import (
    LARGEST_SPEED,
    STICK_SPEED,
    TRACKING_RATE,
    UNKNOWN_REACH,
    RateControlled,
    Reach,
    deflection,
    farthest,
)
from foretouch.devices.spatial import HALF_REACH, SpatialDevice
from foretouch.errors import MissingExtraError, SettingError, one_line, printable
from foretouch.plugins import named_at
from foretouch.quantities.pose import Vector

NAME = "spacemouse"
MAKER, BEFORE = 0x256F, 0x046D  # Vendors: 3Dconnexion, and Logitech in the years before
MICE = (
    *((MAKER, product) for product in (0xC62E, 0xC62F, 0xC631, 0xC632, 0xC633, 0xC635, 0xC636, 0xC638, 0xC63A)),
    *((MAKER, product) for product in (0xC641, 0xC652)),
    *((BEFORE, product) for product in (0xC625, 0xC626, 0xC627, 0xC628, 0xC629, 0xC62B)),
)
"""Vendor and product of the mice: SpaceMouse (Wireless, Pro, Enterprise, Compact, Module) and their receivers; before
them SpacePilot, SpaceNavigator, SpaceExplorer and SpaceMouse Pro."""
MULTI_AXIS = (1, 8)  # Usage page and usage of the part of a mouse that has the cap

PUSHED, BUTTONS = 1, 3  # Ids of reports
FULL = 350.0  # A cap at its end
LONGEST_REPORT, MOST_REPORTS = 64, 64  # Bytes of a report, and reports that one read takes
SILENT = 0.3
"""Time without a report after which a cap counts as let go [s]: pushed, it tells of itself every 8 to 16 ms."""

BEGINS: Vector = (0.0, 0.0, 0.05)
"""Where the handle begins in a scene, in the world's frame [m]: where the script's hand does, over the specimen."""

SAYS = "operator: spacemouse moves the handle by rate and gives no force: a contact is seen and not felt"
GONE = "spacemouse: the mouse is gone, and the handle stands still: plug it in and begin again"


class CapState(NamedTuple):
    """How far the cap is pushed, each -1 to 1, and whether the first button, the left one, is pressed."""

    right: float = 0.0
    forward: float = 0.0
    up: float = 0.0
    clutched: bool = False


def after(state: CapState, report: Sequence[int]) -> CapState:
    """The state after a report; one that is none, or of something else, changes nothing."""
    if len(report) >= 7 and report[0] == PUSHED:
        right, back, down = (max(-1.0, min(number / FULL, 1.0)) for number in struct.unpack("<3h", bytes(report[1:7])))
        return state._replace(right=right, forward=-back, up=-down)
    if len(report) >= 2 and report[0] == BUTTONS:
        return state._replace(clutched=bool(report[1] & 1))
    return state


class HidMouse:
    """An opened mouse.

    Args:
        device: A ``hid.device`` that is open.
    """

    def __init__(self, device: Any) -> None:
        self._device = device
        device.set_nonblocking(1)
        self._state = CapState()
        self._asked_ns = self._heard_ns = -math.inf

    def state(self, now_ns: int) -> CapState | None:
        """Present state of the cap; None where the mouse is gone.

        What it said before the first call, or in a gap between two that is longer than 0.3 s, moves nothing: the kernel
        keeps the oldest reports and drops the newest, among which may be that it was let go.
        """
        waited = now_ns - self._asked_ns > SILENT * 1e9
        self._asked_ns = now_ns
        try:
            for _ in range(MOST_REPORTS):
                report = self._device.read(LONGEST_REPORT)
                if not report:
                    break
                self._state, self._heard_ns = after(self._state, report), now_ns
        except (OSError, ValueError):  # unplugged, and from then on not open
            return None
        if waited or now_ns - self._heard_ns > SILENT * 1e9:
            self._state = CapState(clutched=self._state.clutched)
        return self._state

    def close(self) -> None:
        """Give the mouse back."""
        self._device.close()


class _Pushed(RateControlled):
    """A handle that the cap moves, whatever it touches. A mouse that is gone stays so until it is opened anew."""

    name: ClassVar[str] = NAME

    def __init__(self, mouse: HidMouse, tell: Callable[[str], object]) -> None:
        super().__init__()
        self._mouse, self._tell = mouse, tell

    def close(self) -> None:
        """Give the mouse back."""
        if not self._closed:
            self._closed = True
            self._mouse.close()

    def _push(self, now_ns: int) -> tuple[CapState, float]:
        """How the cap is pushed from the last `read` to this one, and the time between them [s]."""
        now_ns, period = self._pass_time(now_ns)
        state = None if self._closed or self._gone else self._mouse.state(now_ns)
        if state is None and not (self._closed or self._gone):
            self._gone = True
            self._tell(GONE)
        state = state or CapState()
        self._clutched = state.clutched
        return state, period


class SpaceMouse(_Pushed, Device):
    r"""A SpaceMouse along a line: pushed down, the handle goes in at up to 60 mm/s; lifted, it comes out.

    It goes as `foretouch.devices.gamepad.Gamepad` does by its stick, with the same dead zone. A mouse that is gone
    leaves the handle where it is.

    Args:
        mouse: Mouse to read.
        reach: Reach of the material; where it is known, the handle goes as far as a press does.
        tell: Gets one line where the mouse is gone.

    Raises:
        SettingError: A reach that is no place to press.
    """

    def __init__(
        self, mouse: HidMouse, reach: Reach = UNKNOWN_REACH, tell: Callable[[str], object] = lambda line: None
    ) -> None:
        super().__init__(mouse, tell)
        self._farthest = farthest(reach)
        self._goal, self._tracker = 0.0, Tracker(TRACKING_RATE)

    def read(self, now_ns: int) -> float:
        """Position of the handle [m]."""
        state, period = self._push(now_ns)
        goal = self._goal - STICK_SPEED * deflection(state.up) * period
        self._goal = min(max(goal, 0.0), self._farthest)
        return self._tracker.update(self._goal, LARGEST_SPEED, period)

    def render(self, force: float) -> float:
        """The force within the limit that every device has [N], 0 once closed; no hand feels it."""
        return 0.0 if self._closed else limit_force(force)


class SpatialSpaceMouse(_Pushed, SpatialDevice):
    """A SpaceMouse in three dimensions: x is pushed to the right, y forward and z up, each at up to 60 mm/s.

    Args:
        mouse: Mouse to read.
        scale: Follower's motion over the hand's; the follower is meant within 0.25 m of the world's origin.
        tell: Gets one line where the mouse is gone.
    """

    def __init__(self, mouse: HidMouse, scale: float = 1.0, tell: Callable[[str], object] = lambda line: None) -> None:
        super().__init__(mouse, tell)
        self._farthest = HALF_REACH / scale
        self._goal = [value / scale for value in BEGINS]
        self._trackers = [Tracker(TRACKING_RATE) for _ in range(3)]
        for tracker, value in zip(self._trackers, self._goal, strict=True):
            tracker.aim = tracker.position = value

    @property
    def intention(self) -> Vector:
        """Where the handle is: nothing else moves it."""
        x, y, z = (tracker.position for tracker in self._trackers)
        return x, y, z

    def read(self, now_ns: int) -> Vector:
        """Place of the handle [m]."""
        state, period = self._push(now_ns)
        for axis, pushed in enumerate((state.right, state.forward, state.up)):
            goal = self._goal[axis] + STICK_SPEED * deflection(pushed) * period
            self._goal[axis] = min(max(goal, -self._farthest), self._farthest)
            self._trackers[axis].update(self._goal[axis], LARGEST_SPEED, period)
        return self.intention


def open_mouse(path: str = "") -> HidMouse:
    """The first SpaceMouse of this machine, or the one at this path, such as ``/dev/hidraw3``.

    Raises:
        MissingExtraError: hidapi is not installed.
        SettingError: No SpaceMouse is there, or it does not open.
    """
    hid = _binding()
    if not path:
        found = [one for one in hid.enumerate() if (one["vendor_id"], one["product_id"]) in MICE]
        found.sort(key=lambda one: (one["usage_page"], one["usage"]) != MULTI_AXIS)
        if not found:
            rule = "no SpaceMouse is connected: plug it or its receiver in, and see that it stands in `lsusb`"
            raise SettingError("operator", NAME, rule)
        path = found[0]["path"].decode(errors="replace")
    device = hid.device()
    try:
        device.open_path(path.encode())
    except OSError as error:
        rule = f"{path} does not open ({one_line(error)}): give yourself the right to read it, by a rule of udev"
        raise SettingError("operator", NAME, rule) from None
    return HidMouse(device)


def _binding() -> Any:
    """The kernel's raw devices by hidapi, which leave the mouse to other programs too; elsewhere as it comes."""
    for name in ("hidraw", "hid"):
        try:
            module = importlib.import_module(name)
        except ImportError:
            continue
        if hasattr(module, "device"):  # another package is called hid as well
            return module
    raise MissingExtraError("hidapi", "spacemouse")


def make_spacemouse(settings: Any, reach: Reach) -> SpaceMouse | SpatialSpaceMouse:
    """The handle of a session, along a line or, with a scene, in space; it says that no force is felt.

    Args:
        settings: `foretouch.session.SessionSettings`: ``operator`` may have a path, ``spacemouse@/dev/hidraw3``.
        reach: How far the material is along a line.

    Raises:
        MissingExtraError: hidapi is not installed.
        SettingError: No SpaceMouse is there, or it does not open.
    """
    _, path = named_at(settings.operator)
    mouse = open_mouse(path)
    _say(SAYS)
    if settings.scene:
        return SpatialSpaceMouse(mouse, settings.position_scale, _say)
    return SpaceMouse(mouse, reach, _say)


def _say(line: str) -> None:
    sys.stderr.write(f"{printable(line)}\n")
