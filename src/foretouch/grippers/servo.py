"""One servo of Robotis' XL330 series on a bus of its own, by ``dynamixel-sdk``; a jaw or a trigger is on its axis.

Registers, units and stall figures are those of the maker's manuals (XL330-M077-T and XL330-M288-T, protocol 2.0).
"""

from __future__ import annotations

import contextlib
import importlib
import math
import random
import statistics
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

from foretouch.errors import InputError, MissingExtraError, one_line
from foretouch.plugins import Address
from foretouch.robot.drivers.driven_arm import FASTEST

MODELS: Final = {1190: ("XL330-M077", 0.215 / 1.47), 1200: ("XL330-M288", 0.52 / 1.47)}
"""By number of the model: its name, and its torque by current [N m/A], at stall with 5 V."""

OPTIONS: Final = {"id": "1", "lever": "", "baud": "1000000"}
"""The servo's number on the bus; the way from its axis to where it is gripped [m]; the bus's rate [bit/s]."""

COUNTS, AMPERE = 4096, 1000.0  # Of a turn; of 1 A
TURN = 2.0 * math.pi
SPEED = 0.229 * TURN / 60.0  # One count of a velocity [rad/s]

CURRENT_CONTROL, CURRENT_BASED_POSITION = 0, 5
"""Operating modes: a current, or a position with a current that is not exceeded."""

CURRENT_LIMIT, FARTHEST_COUNT, NEAREST_COUNT = (38, 2), (48, 4), (52, 4)
MODE, TORQUE, ERRORS, WATCHDOG = (11, 1), (64, 1), (70, 1), (98, 1)
GOAL_CURRENT, PROFILE_VELOCITY, GOAL_POSITION = (102, 2), (112, 4), (116, 4)
NOW = (126, 10)  # Present current, velocity and position
"""Address and size of the registers that are used [byte]."""

PROBLEMS = {0: "input voltage", 2: "overheating", 3: "encoder", 4: "electrical shock", 5: "overload"}
"""Bits of the hardware's errors; with any of them the servo lets go until it is restarted."""
ALERT = 128  # In a status: the hardware has an error

WATCHDOG_TICKS = 5  # The servo's own, in counts of 20 ms: see `Servo` for what it is worth
INTERRUPTED = 0.08  # Silence after which the servo is set up again [s]: before its watchdog, and in a restart
READ_TIMEOUT = 0.01  # Longest wait for bytes [s]; the library would look again and again without
TRIES, MARGIN = 40, 1.2  # Exchanges by which the rate is measured; what a period leaves them
WRITING = 17  # Bytes of a goal on its way
PERIODS = (0.001, 0.002, 0.004, 0.005)  # That a session knows [s]
LOST = 0.25  # Silence that is told [s]
ATTEMPTS = 3  # For each word of the end
CLOSING = 1.0  # Longest wait for the bus at the end [s]


class ServoState(NamedTuple):
    """How a servo is.

    Attributes:
        measured_ns: When that came in, by `time.monotonic_ns`.
        opening: How far it is open where it is gripped [m].
        force: What its current pushes with there [N], positive where it opens.
        refuses: Why it has let go, for people; "" where it has not.
    """

    measured_ns: int
    opening: float
    force: float
    refuses: str


class Servo:
    """A servo that is asked over and over again in a thread of its own, as often as its bus allows.

    It is closed where its position limits say *minimum* and open at *maximum*, as calibrating it for LeRobot leaves
    them; its drive mode says which way that turns. Nothing is written before there is a goal: until then a servo keeps
    whatever it was doing.

    The servo's own watchdog is set, but is no safety: users report that firmware of this series (51) notices a bus that
    is silent and goes on pushing all the same. What it pushes with is bounded by its *Current Limit*.

    Args:
        address: Its port, and options as in `OPTIONS`.
        mode: `CURRENT_CONTROL` or `CURRENT_BASED_POSITION`.
        lose: Gets once why the servo has said nothing for 0.25 s.

    Attributes:
        name: For people.
        state: The newest.
        why: Why there is no newer one, for people; "" where there is.
        period: Time of one exchange [s], one of `PERIODS`.
        width: Largest opening [m].
        count: What one count of the encoder is [m].
        force_per_ampere: [N/A].
        force_limit: By the servo's own current limit [N].
        lever: As given [m].

    Raises:
        SettingError: An address that is none.
        MissingExtraError: ``dynamixel-sdk`` is not installed.
        InputError: No such port or servo, one of another model, one that is not calibrated, or a bus that is too slow.
    """

    def __init__(self, address: Address, mode: int, lose: Callable[[str], object] = lambda why: None) -> None:
        self.lever = _lever(address)
        self._id, baud = _whole(address, "id", 252), _whole(address, "baud", 4_000_000)
        if not address.place:
            raise address.refuse("needs the port of the servo's adapter: dynamixel@/dev/ttyUSB0,lever=0.06")
        self.name, self.why, self._mode = f"servo {self._id} at {address.place}", "", mode
        sdk = _library()
        self._packets, self._port = sdk.PacketHandler(2.0), _opened(sdk, address, baud)
        self._goal: int | None = None
        self._lose, self._lost = lose, False
        self._on, self._ended = False, threading.Event()
        try:
            self._know()
            self.period = self._measured_period(baud)
        except (InputError, OSError) as error:
            self._port.closePort()
            raise error if isinstance(error, InputError) else InputError(f"{self.name}: {one_line(error)}") from None
        self._thread = threading.Thread(target=self._run, name="servo", daemon=True)
        self._thread.start()

    def push(self, force: float) -> None:
        """Push with a force [N], positive where it opens, from the next exchange on."""
        self._goal = round(AMPERE * force / self.force_per_ampere)

    def go(self, opening: float) -> None:
        """Go to an opening [m] from the next exchange on."""
        self._goal = self._closed + round(opening / self.count)

    def close(self) -> None:
        """Let go, if it was ever told anything, and give back the port; a second call does nothing."""
        if not self._ended.is_set():
            self._ended.set()
            self._thread.join(CLOSING)

    def _know(self) -> None:
        """Learn what it is, and how it is calibrated."""
        model, result, _ = self._packets.ping(self._port, self._id)
        if result != 0:
            raise InputError(f"{self.name}: it does not answer: see its power, its number (id=) and its rate (baud=)")
        if model not in MODELS:
            known = " and ".join(name for name, _ in MODELS.values())
            raise InputError(f"{self.name}: a servo of model {model}, of which no torque is known here: use {known}")
        (name, torque_per_ampere), numbers = MODELS[model], (CURRENT_LIMIT, NEAREST_COUNT, FARTHEST_COUNT)
        self._most, self._closed, self._open = (self._get(*register) for register in numbers)
        self.name = f"{name} {self._id} at {self._port.getPortName()}"
        if self._open - self._closed >= COUNTS - 1 or self._open <= self._closed:
            rule = "set its Min Position Limit to where it is closed, and its Max Position Limit to where it is open"
            raise InputError(f"{self.name}: it is not calibrated, for its limits are a whole turn: {rule}")
        self.count = TURN / COUNTS * self.lever
        self.width = (self._open - self._closed) * self.count
        self.force_per_ampere = torque_per_ampere / self.lever
        self.force_limit = self._most / AMPERE * self.force_per_ampere

    def _measured_period(self, baud: int) -> float:
        """The shortest period that leaves an exchange a fifth more time than it usually takes [s]."""
        times = []
        for _ in range(TRIES):
            began = time.perf_counter()
            self.state = self._read()
            times.append(time.perf_counter() - began)
        usual = statistics.median(times) + 10.0 * WRITING / baud
        if MARGIN * usual > PERIODS[-1]:
            raise InputError(
                f"{self.name}: its bus takes {1e3 * usual:.1f} ms for an exchange, and a session needs one in "
                f"{1e3 * PERIODS[-1]:g} ms: set the adapter's latency timer to 1 ms (/sys/bus/usb-serial/devices/*/"
                "latency_timer), the servo's Return Delay Time to 0, and its rate to 1000000 bit/s or more"
            )
        return next(period for period in PERIODS if period >= MARGIN * usual)

    def _run(self) -> None:
        due = time.monotonic()
        while not self._ended.wait(max(due - time.monotonic(), 0.0)):
            due = max(due + self.period, time.monotonic())
            try:
                self._exchange()
                self.why = ""
            except Exception as error:  # whatever the library, or what it stands on, raises
                self.why = one_line(error) or type(error).__name__
                if not self._lost and time.monotonic_ns() - self.state.measured_ns > 1e9 * LOST:
                    self._lost = True
                    self._lose(self.why)
        self._end()

    def _exchange(self) -> None:
        if self._goal is not None and not self.state.refuses:
            if not self._on or time.monotonic_ns() - self.state.measured_ns > 1e9 * INTERRUPTED:
                self._switch_on()
            self._tell(self._goal)
        self.state = self._read()
        if self.state.refuses:  # what it was told before is not where it begins again
            self._on, self._goal = False, None

    def _switch_on(self) -> None:
        """Begin without a jump: with no force, or where it is and no faster than an arm is commanded."""
        if self._mode == CURRENT_CONTROL:
            start = [(GOAL_CURRENT, 0)]
        else:
            here = self._closed + round(self._read().opening / self.count)
            speed = round(FASTEST / self.lever / SPEED)
            start = [(GOAL_CURRENT, self._most), (GOAL_POSITION, here), (PROFILE_VELOCITY, speed)]
        steps = [(TORQUE, 0), (WATCHDOG, 0), (MODE, self._mode), *start, (TORQUE, 1), (WATCHDOG, WATCHDOG_TICKS)]
        for register, value in steps:
            self._set(register, value)
        self._on = True

    def _tell(self, goal: int) -> None:
        """Send a goal; nothing answers, so it takes half the time of one that is answered."""
        most, low, high = self._most, self._closed, self._open
        if self._mode == CURRENT_CONTROL:
            (address, size), value = GOAL_CURRENT, min(max(goal, -most), most)
        else:
            (address, size), value = GOAL_POSITION, min(max(goal, low), high)
        self._packets.syncWriteTxOnly(self._port, address, size, [self._id, *_bytes(value, size)], 1 + size)

    def _read(self) -> ServoState:
        """Ask how it is."""
        data, result, error = self._packets.readTxRx(self._port, self._id, *NOW)
        now = time.monotonic_ns()
        if result != 0:
            raise ConnectionError(f"it does not answer ({self._packets.getTxRxResult(result).strip('[]')})")
        current, place = _signed(data[:2]), _signed(data[6:10])
        refuses = self._problem() if error & ALERT else ""
        # A current that stands still is the same whole count each time, and a session would take that for a sensor that
        # hangs: half a count of dither shows that it was measured anew.
        force = (current + random.uniform(-0.5, 0.5)) / AMPERE * self.force_per_ampere
        return ServoState(now, (place - self._closed) * self.count, force, refuses)

    def _problem(self) -> str:
        bits = self._get(*ERRORS)
        found = [problem for bit, problem in PROBLEMS.items() if bits >> bit & 1]
        return " and ".join(found) or f"hardware error {bits}"

    def _get(self, address: int, size: int) -> int:
        """The value of a register."""
        data, result, _ = self._packets.readTxRx(self._port, self._id, address, size)
        if result != 0:
            raise InputError(f"{self.name}: it does not answer any more")
        return _signed(data)

    def _set(self, register: tuple[int, int], value: int) -> None:
        """Write a register, and see that it is taken."""
        address, size = register
        result, error = self._packets.writeTxRx(self._port, self._id, address, size, _bytes(value, size))
        if result != 0 or error & ~ALERT:
            raise InputError(f"it takes no {value} at {address}")

    def _end(self) -> None:
        """Let go: an answer that is lost is no reason to leave a torque behind."""
        for register, value in ((GOAL_CURRENT, 0), (TORQUE, 0), (WATCHDOG, 0)) if self._goal is not None else ():
            for _ in range(ATTEMPTS):
                try:
                    self._set(register, value)
                    break
                except Exception:  # whatever the library raises
                    continue
        with contextlib.suppress(Exception):
            self._port.closePort()


def servo_address(setting: str, settings: Any) -> Address:
    """The address in a setting, ``robot`` or ``operator``, of a session.

    Raises:
        SettingError: It is none, or the session has a scene.
    """
    address = Address.read(setting, getattr(settings, setting), OPTIONS, "PORT")
    if settings.scene:
        raise address.refuse("moves along a line: leave the scene out")
    return address


def _lever(address: Address) -> float:
    if not address.options["lever"]:
        form = "dynamixel@/dev/ttyUSB0,lever=0.06"
        raise address.refuse(f"needs the way from the servo's axis to where it is gripped [m]: {form}")
    return address.number("lever", at_least=0.01, at_most=0.3)


def _whole(address: Address, key: str, most: int) -> int:
    number = address.number(key, at_least=0, at_most=most)
    if number != int(number):
        raise address.refuse(f"{key} must be a whole number, and is {address.options[key]}")
    return int(number)


def _library() -> Any:
    try:
        return importlib.import_module("dynamixel_sdk")
    except ModuleNotFoundError as error:
        if error.name != "dynamixel_sdk":  # it is there and misses something itself
            raise
        raise MissingExtraError("dynamixel-sdk", "dynamixel") from None


def _opened(sdk: Any, address: Address, baud: int) -> Any:
    """The port, for this process alone."""
    port = sdk.PortHandler(address.place)
    try:
        if not port.setBaudRate(baud):  # which opens it
            raise address.refuse(f"baud must be a rate that the bus knows, such as {OPTIONS['baud']}, and is {baud}")
        port.ser.exclusive = True
    except OSError as error:  # pyserial's are, too
        raise InputError(f"{address.place}: {one_line(error)}: see that it is plugged in, yours, and free") from None
    port.ser.timeout = READ_TIMEOUT
    return port


def _bytes(value: int, size: int) -> list[int]:
    return list(value.to_bytes(size, "little", signed=True))


def _signed(data: Sequence[int]) -> int:
    return int.from_bytes(bytes(data), "little", signed=True)
