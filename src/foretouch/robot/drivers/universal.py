"""Arms of Universal Robots (e-Series and newer, 500 Hz), by ``ur-rtde``.

Tested with the library itself against a controller of ours that speaks its protocols, and **not tried on an arm**:
`docs/drivers.md` says what to do at a first try.

The session's thread only reads what the library received last. A thread of its own sends the poses: `servoL` waits for
up to 4 s where the controller does not take them. At the first command the library's control program is sent to the
controller, and stops whatever runs there; a session that only watches leaves a running program alone. The program
repeats the last pose by itself, so an arm that gets none holds its place; where it has got none for 100 ms, the
controller's watchdog stops the program, and the arm stands.

`actual_TCP_force` is what acts on the tool, in the axes of the base and with the payload of the installation weighed
out: a table pushes up, along +z, as here.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from typing import Any

from foretouch.errors import InputError, one_line
from foretouch.robot.drivers.arm_link import ArmLink, ArmState
from foretouch.robot.drivers.driven_arm import FIRST, arm_robot
from foretouch.robot.drivers.opening import host_of, library, reach_about, require_answer
from foretouch.robot.robot import AnyRobot, RobotSpecification, Vector

PORT, VERSION_2 = 30004, b"\0\5V\0\2"  # RTDE, and its question whether the controller speaks version 2
RATE = 500.0  # [Hz]
VARIABLES = ["timestamp", "actual_q", "actual_TCP_pose", "actual_TCP_force", "robot_mode", "safety_status_bits"]

LOOKAHEAD, GAIN = 0.03, 300.0
"""How `servoL` follows: the time over which it smooths, its shortest [s], and the gain of the controller's manual."""

WATCHDOG = 10.0  # The controller's own: commands come at least so often, or it stops its program [Hz]
AGAIN = 1.0  # Time between two attempts to start the control program [s]
START = 0.5  # Longest time until the program runs that was sent [s]
PATIENCE = 0.05  # Longest wait for a command until it is seen whether the program still runs [s]
CLOSING = 1.5  # Longest wait at the end, for a command on its way and for the library, which takes half a second [s]

RUNNING = 7  # The robot mode in which an arm moves
MODES = {-1: "no controller", 0: "disconnected", 1: "confirm safety", 2: "booting", 3: "power off", 4: "power on"}
MODES |= {5: "idle, brakes on", 6: "backdrive", 8: "updating firmware"}

STOPS = {
    5: "emergency stop of the system",
    6: "emergency stop of the robot",
    7: "emergency stop",
    9: "safety fault",
    8: "safety violation",
    2: "protective stop",
    4: "safeguard stop",
    3: "recovery mode",
    10: "stopped for safety",
}
"""Bits of the safety status that stop an arm, the graver first."""

STARTS = "its control program starts"
NO_START = "its control program does not start: is it in remote control?"

SPECIFICATION = RobotSpecification(
    sample_period=1.0 / RATE,
    force_limit=50.0,  # range of the force sensor of a UR5e by its data sheet: the arm's own force limit is higher
    encoder_resolution=1e-5,  # not published: what a step of 17 bits makes at 0.2 m
    encoder_noise=0.0,
    tool_mass=0.0,
    gravity=0.0,
    sensor_noise=0.1,  # not published: the data sheet gives a precision of 3.5 N, which is no noise
    accelerometer_noise=0.0,
    sensor_bandwidth=100.0,  # not published
    workspace=(-1.0, 1.0),
    sensor_range=50.0,  # data sheet
    moved_mass=3.1,  # of the UR5e's description in this package, as it begins
    largest_offset=4.0,  # accuracy by the data sheet
)
"""A UR5e; its data sheet (Technical details UR5e) gives a reach of 0.85 m and a pose repeatability of 0.03 mm, too."""


class UrArm(ArmLink):
    """The connection to an arm. It is moved within 0.15 m to the sides and 0.12 m up and down from where it is found.

    Args:
        host: Name or address of its controller.

    Raises:
        MissingExtraError: ``ur-rtde`` is not installed.
        InputError: The controller does not answer, or shows no pose within 3 s.
    """

    specification = SPECIFICATION

    def __init__(self, host: str) -> None:
        self.name = f"UR at {host}"
        receive = library("rtde_receive", "ur-rtde", "ur").RTDEReceiveInterface
        control = library("rtde_control", "ur-rtde", "ur").RTDEControlInterface
        require_answer(self.name, host, PORT, VERSION_2)
        try:  # now: both wait with Python's lock held
            self._receive = receive(host, RATE, VARIABLES)
            made = control(host, RATE, control.FLAG_NO_WAIT | control.FLAG_DISABLE_REMOTE_CONTROL_CHECK)
        except Exception as error:  # whatever the library raises
            raise InputError(f"{self.name}: {one_line(error)}: it has to be an e-Series or newer, of 500 Hz") from None
        self._control = _Control(made, self._stopped)
        self._stamp, self._closed = 0.0, False
        self._state: ArmState | None = None
        self.reach = reach_about(self._first().place)
        self._rotation = tuple(self._receive.getActualTCPPose()[3:])  # which the tip keeps

    def _first(self) -> ArmState:
        """Wait for a state."""
        end = time.monotonic() + FIRST
        while (state := self.state()) is None:
            if time.monotonic() > end:
                self.close()
                raise InputError(f"{self.name}: it shows no pose within {FIRST:g} s: switch the arm on")
            time.sleep(1.0 / RATE)
        return state

    def state(self) -> ArmState | None:
        """The newest state."""
        if not self._receive.isConnected():
            raise ConnectionError("the connection to its controller is lost")
        stamp = self._receive.getTimestamp()
        if stamp != self._stamp:
            x, y, z, *_ = self._receive.getActualTCPPose()
            force_x, force_y, force_z, *_ = self._receive.getActualTCPForce()
            joints = tuple(self._receive.getActualQ())
            refuses = self._stopped() or self._control.why
            place, force = (x, y, z), (force_x, force_y, force_z)
            self._stamp, self._state = stamp, ArmState(time.monotonic_ns(), place, force, joints, refuses)
        return self._state

    def command(self, place: Vector) -> None:
        """Take where the tip should be."""
        self._control.aim((*place, *self._rotation))

    def close(self) -> None:
        """Stop the arm, end its control program, and disconnect."""
        if not self._closed:
            self._closed = True
            self._control.close()

    def _stopped(self) -> str:
        """Why the controller lets the arm not move; "" where it does."""
        bits, mode = self._receive.getSafetyStatusBits(), self._receive.getRobotMode()
        for bit, why in STOPS.items():
            if bits >> bit & 1:
                return why
        return "" if mode == RUNNING else f"not running: {MODES.get(mode, f'robot mode {mode}')}"


class _Control:
    """The thread that keeps the control program up, and gives it the newest pose.

    It begins at the first command. A program that has ended, as after a protective stop, is sent again when the
    controller lets the arm move; the arm then stands until it is commanded.

    Args:
        made: The library's ``RTDEControlInterface``, which has sent no program.
        stopped: Says why the arm may not move; "" where it may.

    Attributes:
        why: Why no commands are taken; "" where they are, or none has come yet.
    """

    def __init__(self, made: Any, stopped: Callable[[], str]) -> None:
        self.why = ""
        self._made, self._stopped = made, stopped
        self._pose: tuple[float, ...] = ()
        self._news, self._ended, self._sent, self._next = threading.Event(), threading.Event(), False, 0.0
        self._thread = threading.Thread(target=self._run, name="ur-commands", daemon=True)

    def aim(self, pose: tuple[float, ...]) -> None:
        """Take the pose that is sent next: place [m] and rotation vector [rad]."""
        if not self._pose:
            self.why = STARTS
            self._thread.start()
        self._pose = pose
        self._news.set()

    def close(self) -> None:
        """Stop the arm, end the program and disconnect, as far as that is done in time."""
        self._ended.set()
        self._news.set()
        if not self._pose:
            self._thread.start()
        self._thread.join(CLOSING)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                if self._up() and self._news.wait(PATIENCE) and not self._ended.is_set():
                    self._news.clear()
                    self._sent = self._made.servoL(list(self._pose), 0.0, 0.0, 1.0 / RATE, LOOKAHEAD, GAIN)
            except Exception as error:  # whatever the library raises
                self.why = one_line(error) or type(error).__name__
        self._end()

    def _end(self) -> None:
        if not self._made.isConnected():  # the library would wait for a new connection
            return
        for step in (self._made.servoStop, self._made.stopScript) if self._sent else ():
            with contextlib.suppress(Exception):
                step()
        with contextlib.suppress(Exception):
            self._made.disconnect()

    def _up(self) -> bool:
        """Whether the program runs; send it where it may and does not, at most once a second."""
        if self._sent and self._made.isProgramRunning():
            return True
        self.why = self.why or STARTS
        if self._stopped() or time.monotonic() < self._next or not self._made.isConnected():
            self._ended.wait(PATIENCE)
            return False
        self._next, self._sent = time.monotonic() + AGAIN, False
        self._made.reuploadScript()
        end = time.monotonic() + START
        while not self._made.isProgramRunning():
            if time.monotonic() > end:
                self.why = NO_START
                return False
            time.sleep(1.0 / RATE)
        self._sent = self._made.setWatchdog(WATCHDOG)
        self._news.clear()  # what came before is not where the arm begins
        self.why = "" if self._sent else NO_START
        return self._sent


def make_ur(settings: Any) -> AnyRobot[Any, Any]:
    """The robot ``ur@HOST`` of the settings.

    Raises:
        SettingError: Without a host.
        MissingExtraError: ``ur-rtde`` is not installed.
        InputError: The arm's controller does not answer.
    """
    return arm_robot(UrArm(host_of(settings)), in_space=bool(settings.scene))
