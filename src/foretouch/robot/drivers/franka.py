"""Franka Research 3 and Panda, by ``franky-control`` 2 over libfranka.

Tested with the library itself against a simulated controller of its author (``franky-sim``), which speaks the arm's
protocol, and against a stand-in of its functions, and **not tried on an arm**: `docs/drivers.md` says what to do at a
first try.

The arm's loop of 1 kHz runs in C++ in the library: a spring and a damper draw the tip to the newest reference
(``CartesianImpedanceTrackingMotion``). The session's thread sets the reference and takes the newest state; a thread of
its own waits for the states, and for the end of a motion.

What holds where the session fails: that motion knows no time-out of references, so the thread that waits for the
states is one: after 100 ms without a command it draws the tip out of what presses it, to next to nothing. The spring is
stretched by at most 10 mm, so that it never presses by more than 20 N; at 30 N the arm stops by itself, with
a reflex; and where this process dies, the arm misses the packets of its own loop and stops, which was not tried.

``O_F_ext_hat_K`` is estimated from the joint torques, in the axes of the base, and in libfranka positive where the arm
pushes: a table under the tip shows as negative z. Here it is turned round, to what pushes the tip: along +z.
"""

from __future__ import annotations

import contextlib
import functools
import math
import threading
import time
from pathlib import Path
from typing import Any

from foretouch.errors import one_line
from foretouch.robot.drivers.arm_link import ArmLink, ArmState
from foretouch.robot.drivers.driven_arm import arm_robot
from foretouch.robot.drivers.opening import host_of, library, opened, reach_about, require_answer
from foretouch.robot.robot import AnyRobot, RobotSpecification, Vector

PORT = 1337  # Of the Franka Control Interface
STIFFNESS, TURNING = 2000.0, 100.0
"""Of the spring that draws the tip [N/m], [N m/rad]; the arm takes up to 3000 and 300."""

QUIET, PRESSED, OUT = 0.1, 1.0, 5e-4
"""Time without a command after which the arm unloads by itself [s]; the force above which it does, for what it shows in
free air is below [N]; and how far outwards of where it is it is drawn then [m]."""

STRETCHED = 0.01  # The spring is stretched by at most this along each axis [m]
REFLEX = 30.0  # Force at which the arm stops by itself [N]
LOOKS = 5e-4  # Time between two looks at the state of an arm in motion; one at rest is waited for [s]
SLOWER = 0.02  # Time between two looks where that failed [s]
AGAIN = 1.0  # Time between two attempts to start a motion [s]
CLOSING = 2.5  # Longest wait at the end until the arm stands [s]; the library stops by itself after 2 s

STARTS = "its motion starts"
ADVICE = "see that FCI is active, and that nobody else has it"
REALTIME = Path("/sys/kernel/realtime")

MODES = {
    "UserStopped": "stopped by a person",
    "Guiding": "guided by hand",
    "AutomaticErrorRecovery": "recovers from an error",
    "Other": "not ready: open its brakes and activate FCI",
}
"""Modes in which the arm does not move, but for Reflex."""

SPECIFICATION = RobotSpecification(
    sample_period=1e-3,
    force_limit=STIFFNESS * STRETCHED,
    encoder_resolution=1e-5,  # not published: as of the simulated arm in this package
    encoder_noise=0.0,
    tool_mass=0.0,
    gravity=0.0,
    sensor_noise=0.035,  # data sheet of the Panda: force noise (RMS)
    accelerometer_noise=0.0,
    sensor_bandwidth=100.0,  # not published
    workspace=(-1.0, 1.0),
    sensor_range=50.0,  # data sheet of the Panda: the least of its force ranges
    moved_mass=4.5,  # of the FR3's description in this package, as it begins
    largest_offset=1.0,  # not published as such: the data sheet gives a relative accuracy of 0.8 N
)
"""Reach 0.855 m and pose repeatability 0.1 mm by the same data sheet (Franka Emika Panda)."""


class FrankaArm(ArmLink):
    """The connection to an arm. It is moved within 0.15 m to the sides and 0.12 m up and down from where it is found.

    Args:
        host: Name or address of its controller.

    Raises:
        MissingExtraError: ``franky-control`` is not installed.
        InputError: The arm does not answer, or takes no connection.
    """

    specification = SPECIFICATION

    def __init__(self, host: str) -> None:
        self.name = f"Franka at {host}"
        self._franky = franky = library("franky", "franky-control", "franka")
        require_answer(self.name, host, PORT)
        self._robot, first = opened(self.name, lambda: _connected(franky, host), ADVICE)
        self._turned = first.O_T_EE.quaternion
        self._time, self._why, self._lost = -1, "", ""
        self._state = self._said(first)
        self._motion: Any = None
        self._wanted, self._next, self._ended = False, 0.0, threading.Event()
        self._commanded = 0.0
        self.reach = reach_about(self._state.place)
        self._thread = threading.Thread(target=self._run, name="franka-states", daemon=True)
        self._thread.start()

    def state(self) -> ArmState:
        """The newest state."""
        if self._lost:
            raise ConnectionError(self._lost)
        return self._state

    def command(self, place: Vector) -> None:
        """Take where the tip should be."""
        self._commanded = time.monotonic()
        if not self._wanted:
            self._wanted, self._why = True, STARTS  # until its motion runs: then it begins where it stands
        elif self._motion is not None and not self._why:
            self._refer(self._motion, place)

    def close(self) -> None:
        """Let the arm come to rest and give it back."""
        self._ended.set()
        self._thread.join(CLOSING)
        if not self._thread.is_alive():
            self._robot = self._motion = None  # which disconnects

    def _refer(self, motion: Any, place: Vector) -> None:
        target = self._franky.Affine(list(place), self._turned)
        motion.set_reference(self._franky.CartesianReference(target=target))

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._look(self._robot.state)
                self._lost = ""
            except Exception as error:  # whatever the library raises
                self._lost = one_line(error) or type(error).__name__
                self._ended.wait(SLOWER)
            self._ended.wait(LOOKS)
        with contextlib.suppress(Exception):
            self._rest()

    def _look(self, state: Any) -> None:
        """Take a state, and keep the motion up."""
        moment = state.time.to_msec()
        if self._motion is not None and not self._robot.is_in_control:
            self._motion, self._why = None, STARTS
            with contextlib.suppress(Exception):  # why it ended is in the state
                self._robot.join_motion(timeout=0.0)
        if moment == self._time:
            return
        if self._wanted and self._motion is None and not _refusal(state) and time.monotonic() > self._next:
            self._next = time.monotonic() + AGAIN
            try:
                self._start(state)
            except Exception as error:
                self._why = f"its motion does not start: {one_line(error)}"
        self._time, self._state = moment, self._said(state)
        force = math.hypot(*self._state.force)
        if time.monotonic() - self._commanded > QUIET and self._motion is not None and force > PRESSED:
            at = zip(self._state.place, self._state.force, strict=True)
            x, y, z = (place + OUT * pushed / force for place, pushed in at)
            self._refer(self._motion, (x, y, z))

    def _start(self, state: Any) -> None:
        """Begin to hold the tip where it is; errors are never recovered from here."""
        self._turned = state.O_T_EE.quaternion
        motion = self._franky.CartesianImpedanceTrackingMotion(
            translational_stiffness=STIFFNESS,
            rotational_stiffness=TURNING,
            translational_error_clip=[STRETCHED] * 3,
        )
        self._refer(motion, _place(state))
        self._robot.move(motion, asynchronous=True)
        self._motion, self._why = motion, ""

    def _rest(self) -> None:
        if self._motion is not None and self._robot.is_in_control:
            self._robot.move(self._franky.TorqueStopMotion(), asynchronous=True)
            self._robot.join_motion(timeout=CLOSING)

    def _said(self, state: Any) -> ArmState:
        x, y, z, *_ = (-float(value) for value in state.O_F_ext_hat_K)
        joints = tuple(map(float, state.q))
        return ArmState(time.monotonic_ns(), _place(state), (x, y, z), joints, _refusal(state) or self._why)


def _connected(franky: Any, host: str) -> tuple[Any, Any]:
    """The library's robot, and a first state of it."""
    config = franky.RealtimeConfig.Enforce if REALTIME.exists() else franky.RealtimeConfig.Ignore
    robot = franky.Robot(host, default_force_threshold=REFLEX, realtime_config=config)
    return robot, robot.state


def _place(state: Any) -> Vector:
    x, y, z = map(float, state.O_T_EE.translation)
    return x, y, z


def _refusal(state: Any) -> str:
    """Why an arm in this state does not move; "" where it would."""
    mode = state.robot_mode.name
    if mode == "Reflex":
        return f"reflex: {_errors_of(state.current_errors) or 'without a reason'}"
    if errors := _errors_of(state.current_errors) if mode == "Idle" else "":
        return f"error: {errors}"
    return MODES.get(mode, "")


def _errors_of(errors: Any) -> str:
    """Names of the errors that a state has, of the library's ``Errors``."""
    return ", ".join(name.replace("_", " ") for name in _names_of(errors.__class__) if getattr(errors, name))


@functools.cache
def _names_of(kind: Any) -> tuple[str, ...]:
    """Names of the public attributes of a class."""
    return tuple(name for name in dir(kind) if not name.startswith("_"))


def make_franka(settings: Any) -> AnyRobot[Any, Any]:
    """The robot ``franka@HOST`` of the settings.

    Raises:
        SettingError: Without a host.
        MissingExtraError: ``franky-control`` is not installed.
        InputError: The arm does not answer.
    """
    return arm_robot(FrankaArm(host_of(settings)), in_space=bool(settings.scene))
