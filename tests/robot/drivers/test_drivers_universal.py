"""An arm of Universal Robots: the library itself, against a controller of ours at an address of this machine."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest
from ur_controller import EMERGENCY, SERVO_L, SERVO_STOP, START, Controller

from apart import Apart
from foretouch.errors import InputError, MissingExtraError, SettingError
from foretouch.robot import SpatialRobot
from foretouch.robot.drivers import LostArmError, SlowerRobot, opening
from foretouch.robot.drivers.universal import NO_START, STARTS, make_ur
from foretouch.session.conformance import check_robot, failed

FORCE = 5.0  # At 5 mm in the spring [N]
DEEP = START[2] - 0.015

pytestmark = pytest.mark.live


@pytest.fixture
def controller() -> Iterator[Controller]:
    pytest.importorskip("rtde_control")
    with Apart(Controller) as made:
        yield made  # type: ignore[misc]


@pytest.fixture
def arm(controller: Controller) -> Iterator[SpatialRobot]:
    made = make_ur(SimpleNamespace(robot=f"ur@{controller.host}", scene="plane"))
    assert isinstance(made, SpatialRobot)
    yield made
    made.close()


def driven(arm: SpatialRobot, height: float, seconds: float, until: Callable[[], bool] = lambda: False) -> list[float]:
    """Command a way at 20 mm/s to a height and stay there, in real time; the upward forces [N]."""
    z, forces, end = arm.read().place[2], [], time.monotonic() + seconds
    while time.monotonic() < end and not until():
        z += min(max(height - z, -4e-5), 4e-5)
        forces.append(arm.exchange((*START[:2], z)).force[2])
        time.sleep(0.002)
    return forces


def pressed(arm: SpatialRobot) -> None:
    assert driven(arm, DEEP, 1.6)[-1] == pytest.approx(FORCE, abs=0.3)


def test_it_is_read_without_a_program_and_pressed_with_one(arm: SpatialRobot, controller: Controller) -> None:
    sample = arm.read()
    assert sample.place == pytest.approx(START[:3])
    assert sample.joints == pytest.approx((0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    for _ in range(20):
        arm.exchange((math.nan,) * 3)
    assert controller.programs == 0
    pressed(arm)
    assert controller.programs == 1
    assert controller.watchdog == 10.0
    assert controller.target[3:] == pytest.approx(START[3:])
    arm.close()
    assert controller.commands[-2] == SERVO_STOP
    assert not controller.runs


@pytest.mark.long
def test_it_keeps_the_rules_of_a_driver_moved_too(controller: Controller) -> None:
    make = lambda: SlowerRobot(make_ur(SimpleNamespace(robot=f"ur@{controller.host}", scene="")))  # noqa: E731
    assert failed(check_robot(make, move=True)) == []


def test_a_protective_stop_in_a_press_is_said_and_it_begins_again_where_it_stands(
    arm: SpatialRobot, controller: Controller
) -> None:
    pressed(arm)
    controller.stop()
    driven(arm, DEEP, 0.3)
    assert arm.read().held
    assert arm.says == "protective stop"
    assert controller.programs == 1  # nothing is sent to an arm that is stopped
    told = controller.commands.count(SERVO_L)
    driven(arm, DEEP, 0.3)
    assert controller.commands.count(SERVO_L) == told
    controller.unlock()
    driven(arm, START[2], 3.0, until=lambda: controller.programs == 2 and not arm.read().held)
    assert driven(arm, START[2], 1.6)[-1] == 0.0
    assert arm.read().place[2] == pytest.approx(START[2], abs=5e-4)
    assert arm.says == ""


@pytest.mark.long
def test_an_emergency_stop_and_an_arm_that_is_off_are_said(arm: SpatialRobot, controller: Controller) -> None:
    for bits, mode, says in ((EMERGENCY, 3, "emergency stop"), (1, 3, "not running: power off")):
        controller.bits, controller.mode = bits, mode
        time.sleep(0.05)
        assert arm.read().held
        assert arm.says == says


def test_a_connection_that_drops_in_a_press_is_no_force_and_then_the_end(
    arm: SpatialRobot, controller: Controller
) -> None:
    pressed(arm)
    controller.drop()
    began = time.monotonic()
    assert math.isnan(driven(arm, START[2], 0.3)[-1])
    with pytest.raises(LostArmError, match=f"UR at {controller.host}: it has said nothing for 1 s .*connection to its"):
        driven(arm, START[2], 5.0)
    assert 0.9 < time.monotonic() - began < 2.5
    arm.close()
    arm.close()


@pytest.mark.long
def test_a_silent_controller_and_one_that_answers_late(arm: SpatialRobot, controller: Controller) -> None:
    pressed(arm)
    controller.late = 0.006  # every 8 ms: still good enough
    assert all(force == pytest.approx(FORCE, abs=0.3) for force in driven(arm, DEEP, 0.3))
    controller.late = 0.05
    assert any(map(math.isnan, driven(arm, DEEP, 0.3)))
    controller.late, controller.silent = 0.0, True
    with pytest.raises(LostArmError, match="it has said nothing for 1 s: see that it stands still"):
        driven(arm, DEEP, 3.0)


@pytest.mark.long
def test_forces_and_places_that_are_no_numbers(arm: SpatialRobot, controller: Controller) -> None:
    pressed(arm)
    controller.force = math.nan
    assert math.isnan(driven(arm, DEEP, 0.1)[-1])
    controller.force = None
    assert driven(arm, DEEP, 0.1)[-1] == pytest.approx(FORCE, abs=0.3)
    before, controller.pose = arm.read().place, [math.nan] * 6
    driven(arm, DEEP, 0.1)
    assert arm.read().place == pytest.approx(before, abs=1e-4)
    assert math.isnan(arm.read().force[2])


def test_a_controller_that_takes_no_commands_stops_no_session(arm: SpatialRobot, controller: Controller) -> None:
    pressed(arm)
    controller.deaf = True
    longest, end = 0.0, time.monotonic() + 1.0
    while time.monotonic() < end:
        began = time.perf_counter()
        arm.exchange((*START[:2], DEEP))
        longest = max(longest, time.perf_counter() - began)
        time.sleep(0.002)
    assert longest < 0.02
    began = time.monotonic()
    arm.close()
    assert time.monotonic() - began < 2.5


@pytest.mark.long
def test_a_session_that_is_killed_leaves_an_arm_that_stands(arm: SpatialRobot, controller: Controller) -> None:
    pressed(arm)
    time.sleep(0.3)  # no command: the program goes on holding, and the watchdog ends it
    assert not controller.runs
    assert controller.pose[2] == pytest.approx(DEEP, abs=5e-4)


@pytest.mark.long
def test_a_controller_in_local_control_is_said(arm: SpatialRobot, controller: Controller) -> None:
    controller.remote = False
    assert not arm.read().held  # it is read all the same
    driven(arm, DEEP, 0.2)
    assert arm.says == STARTS
    driven(arm, DEEP, 0.6)
    assert controller.programs == 0
    assert arm.read().held
    assert arm.says == NO_START


@pytest.mark.long
def test_a_program_of_somebody_else_runs_on_until_the_first_command(controller: Controller) -> None:
    controller.runs = True
    arm = make_ur(SimpleNamespace(robot=f"ur@{controller.host}", scene="plane"))
    for _ in range(50):
        arm.exchange((math.nan,) * 3)
        time.sleep(0.002)
    assert controller.runs
    pressed(arm)
    assert controller.programs == 1
    arm.close()


def test_no_controller_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rtde_receive")
    monkeypatch.setattr(opening, "FIRST", 0.5)
    with pytest.raises(InputError, match=r"UR at 127.254.1.1: port 30004 does not answer \(Connection refused\): see"):
        make_ur(SimpleNamespace(robot="ur@127.254.1.1", scene=""))
    with (
        socket.create_server(("127.254.1.2", 30004)),
        pytest.raises(InputError, match=r"UR at 127.254.1.2: port 30004 does not answer \(timed out\): see"),
    ):
        make_ur(SimpleNamespace(robot="ur@127.254.1.2", scene=""))


def test_no_host_and_no_library_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SettingError, match="must be ur@HOST, with the address of the arm's controller"):
        make_ur(SimpleNamespace(robot="ur", scene=""))
    with pytest.raises(MissingExtraError, match=r"no_such_library is not installed: pip install .*\[ur\]"):
        opening.library("no_such_library", "no_such_library", "ur")
