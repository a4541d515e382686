"""The connection to Haply's Inverse Service: its messages, and the thread that exchanges them.

The service answers each message with one state, so it goes as fast as it is asked. A command acts once and is
forgotten.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec

from foretouch.devices.felt import NO_FORCE, HandleLink
from foretouch.devices.spatial import NOWHERE
from foretouch.errors import MissingExtraError, SettingError, one_line
from foretouch.quantities.pose import Vector

NAME, ADDRESS = "inverse3", "127.0.0.1:10001"
"""Name of the operator, and where the service is if nothing else is said."""

ASKED = 5e-4  # Time after which a state is asked for where no force is rendered [s]: so positions are new at each tick
LATE, LOST = 0.01, 0.25
"""Age of the newest position from which on none is shown, and from which on the device counts as lost [s]."""
OPENING, ANSWERING = 1.0, 0.5  # Longest that the service takes to be found, and to answer at first [s]
CLOSING = 0.2  # Longest that it takes to end [s]


class _Place(msgspec.Struct):
    x: float
    y: float
    z: float


class _Scale(msgspec.Struct):
    x: float = 1.0
    y: float = 1.0
    z: float = 1.0


class _Transform(msgspec.Struct):
    """A transform as the service shows it: what is as it is without one is left out."""

    scale: _Scale = msgspec.field(default_factory=_Scale)


class _State(msgspec.Struct):
    cursor_position: _Place | None = None
    transform: _Transform = msgspec.field(default_factory=_Transform)


class _Status(msgspec.Struct):
    calibrated: bool = True
    in_use: bool = False
    power_supply: bool = True
    ready: bool = True


class _Config(msgspec.Struct):
    mount: _Transform = msgspec.field(default_factory=_Transform)


class _Listed(msgspec.Struct):
    """One device of the service's list."""

    device_id: str
    state: _State = msgspec.field(default_factory=_State)
    status: _Status = msgspec.field(default_factory=_Status)
    config: _Config = msgspec.field(default_factory=_Config)


class _Answer(msgspec.Struct):
    """What the service says, as far as it is needed here. Only services from 3.5 on number their sessions."""

    inverse3: list[_Listed] = msgspec.field(default_factory=list)
    wireless_verse_grip: Any = None
    session_id: Any = None


_decode = msgspec.json.Decoder(_Answer).decode


class InverseService(HandleLink):
    """The connection to the service, kept by a thread of its own: no call from outside waits for it.

    The thread sends the force as soon as it is rendered, and asks for a state again half a tick later. Where no place
    of the hand is known it sends no force; where the service is late it sends none after that, so that the newest
    command is without force when the service goes on. In the device's frame x is to the right, y forward and z up.

    Args:
        address: ``HOST:PORT`` of the service.
        tell: Gets one line where the device is lost.

    Raises:
        MissingExtraError: websockets is not installed.
        SettingError: Nothing answers there as the service does; it has no device that is ready; or one whose lengths it
            scales.
    """

    def __init__(self, address: str = ADDRESS, tell: Callable[[str], object] = lambda line: None) -> None:
        self.address, self._tell = _checked(address), tell
        self._problem, self._lost = "", False
        self._ended, self._woken = threading.Event(), threading.Event()
        self._pushed = NO_FORCE
        self._newest: tuple[Vector, float] = NOWHERE, time.monotonic()
        self._clutched = False
        self._errors, self._connection = _connect(self.address)
        try:
            self._begin()
        except SettingError:
            self._connection.close()
            raise
        except self._errors as error:
            self._connection.close()
            raise _unanswered(self.address, error) from None
        self._thread = threading.Thread(target=self._serve, name="inverse3", daemon=True)
        self._thread.start()

    @property
    def clutched(self) -> bool:
        """Whether the first button of a VerseGrip is pressed."""
        return self._clutched

    @property
    def lost(self) -> bool:
        """Whether the device shows no place any more, and gives no force until it is opened anew."""
        return self._lost

    def place(self) -> Vector:
        """Newest place of the hand in the device's frame [m]; no numbers where it is old."""
        place, seen = self._newest
        return place if time.monotonic() - seen <= LATE else NOWHERE

    def push(self, force: Vector) -> bool:
        """Give the hand a force [N] in the device's frame, from about now on; whether it is given."""
        self._pushed = force
        self._woken.set()
        return self.place() is not NOWHERE and not self._ended.is_set()

    def close(self) -> None:
        """Send a command without force and end the connection."""
        self._ended.set()
        self._woken.set()
        self._thread.join(LOST + CLOSING)

    def _begin(self) -> None:
        """Choose the first device of the service's list, and say what axes are meant."""
        answer = self._heard(ANSWERING)
        if answer is None:
            raise SettingError("operator", f"{NAME}@{self.address}", f"is no Inverse Service: {self._problem}")
        if not answer.inverse3:
            rule = "the service has no Inverse3: plug it in and switch it on, and see that the Haply Hub shows it"
            raise SettingError("operator", f"{NAME}@{self.address}", rule)
        device = answer.inverse3[0]
        if rule := _unready(device):
            raise SettingError("operator", f"{NAME}@{self.address}", f"device {device.device_id} {rule}")
        self._id, new = device.device_id, answer.session_id is not None
        self._vector = "vector" if new else "values"
        # Another program may have left other axes behind; before 3.5 there was no such word.
        words = {"profile": {"name": "foretouch:leader"}, "basis": {"permutation": "XYZ"}}
        self._send(NO_FORCE, {"session": {"configure": words}} if new else {})
        self._take(ANSWERING)
        if self.place() is NOWHERE:
            rule = f"device {self._id} shows no position: {self._problem or 'it took too long'}"
            raise SettingError("operator", f"{NAME}@{self.address}", rule)

    def _serve(self) -> None:
        """The thread: one exchange for each force that is rendered, and others between them."""
        try:
            while not self._ended.is_set():
                self._woken.wait(ASKED)
                self._woken.clear()
                self._exchange()
                if time.monotonic() - self._newest[1] > LOST:
                    raise TimeoutError(self._problem)
            self._send(NO_FORCE)
            self._take(LATE)
        except self._errors as error:
            self._lose(error)
        finally:
            self._connection.close()

    def _exchange(self) -> None:
        """One command, and the state that answers it; where that is late a command without force comes after it."""
        self._send(NO_FORCE if self.place() is NOWHERE else self._pushed)
        try:
            self._take(LATE)
        except TimeoutError:
            self._send(NO_FORCE)
            for _ in range(2):
                self._take(LOST)

    def _send(self, force: Vector, more: dict[str, Any] | None = None) -> None:
        x, y, z = force
        commands = {"set_cursor_force": {self._vector: {"x": x, "y": y, "z": z}}}
        message = {**(more or {}), "inverse3": [{"device_id": self._id, "commands": commands}]}
        self._connection.send(msgspec.json.encode(message), text=True)

    def _heard(self, patience: float) -> _Answer | None:
        """The next message of the service; None where it says something else."""
        text = self._connection.recv(patience)
        try:
            return _decode(text)
        except msgspec.MsgspecError as error:
            self._problem = f"it says what is no state ({one_line(error)})"
            return None

    def _take(self, patience: float) -> None:
        """Take the next state, where it is one that shows the device."""
        answer = self._heard(patience)
        if answer is None:
            return
        for device in answer.inverse3:
            if device.device_id == self._id:
                break
        else:
            self._problem = f"the service has no device {self._id} any more"
            return
        cursor = device.state.cursor_position
        place = NOWHERE if cursor is None else (cursor.x, cursor.y, cursor.z)
        if rule := _unready(device, ours=True) or ("" if math.isfinite(sum(place)) else "shows no position"):
            self._problem = f"the device {rule}"
            return
        self._newest, self._problem = (place, time.monotonic()), ""
        self._clutched = _pressed(answer.wireless_verse_grip)

    def _lose(self, error: Exception) -> None:
        self._lost = True
        self._newest = NOWHERE, -math.inf
        self._ended.set()
        silent = isinstance(error, TimeoutError)
        reason = self._problem or ("it does not answer" if silent else f"the connection ended ({one_line(error)})")
        self._tell(
            f"{NAME}: lost the device at {self.address}: {reason}. The hand gets no force and counts as not moved: end "
            "the session, and begin again when the Haply Hub shows the device"
        )


def _checked(address: str) -> str:
    """An address, once it is one."""
    host, _, port = address.rpartition(":")
    if not (host and port.isdecimal() and 0 < int(port) < 65536 and not set(host) & set("/@?# ")):
        raise SettingError("operator", f"{NAME}@{address}", f"must be {NAME} or {NAME}@HOST:PORT, as {NAME}@{ADDRESS}")
    return address


def _connect(address: str) -> tuple[tuple[type[Exception], ...], Any]:
    """What a connection raises where it ends, and one to the service."""
    try:
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect
    except ImportError:
        raise MissingExtraError("websockets", "haply") from None
    errors = (WebSocketException, OSError)
    try:  # nothing between here and a service on this machine: no proxy, no compression, no pings
        return errors, connect(
            f"ws://{address}",
            compression=None,
            proxy=None,
            ping_interval=None,
            open_timeout=OPENING,
            close_timeout=CLOSING,
        )
    except (*errors, ValueError) as error:
        raise _unanswered(address, error) from None


def _unanswered(address: str, error: Exception) -> SettingError:
    said = one_line(error) or type(error).__name__
    rule = f"no Inverse Service answers there ({said}): start the Haply Hub, or say where it is: {NAME}@HOST:PORT"
    return SettingError("operator", f"{NAME}@{address}", rule)


def _unready(device: _Listed, *, ours: bool = False) -> str:
    """Why a device cannot be used, empty where it can; while it is `ours`, another program's use is our own."""
    status = device.status
    if not status.power_supply:
        return "has no power: plug in its supply"
    if not status.ready:
        return "is not ready: wait until its light says so, or unplug it and plug it in again"
    if not status.calibrated:
        return "is not calibrated: put its handle where the Haply Hub says"
    if status.in_use and not ours:
        return "is used by another program, and forces of two add up: close that one"
    if _Scale() != device.config.mount.scale or _Scale() != device.state.transform.scale:
        return "has its lengths scaled by the service: set the scale of mount and workspace to 1 in the Haply Hub"
    return ""


def _pressed(grips: Any) -> bool:
    """Whether the first button of a VerseGrip is pressed; no grip, or one told of otherwise, is none."""
    try:
        return bool(grips[0]["state"]["buttons"]["a"])
    except (TypeError, KeyError, IndexError):
        return False
