"""A gripper as a robot: the maker's library, against a bus of ours on a pseudo terminal. No servo was here."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from servo_bus import COUNT, GOAL_POSITION, LEVER, TORQUE, ServoBus

from foretouch.errors import InputError, MissingExtraError, SettingError
from foretouch.grippers import servo
from foretouch.grippers.gripper import make_gripper
from foretouch.grippers.servo import CURRENT_BASED_POSITION, OPTIONS, Servo
from foretouch.plugins import Address
from foretouch.robot.drivers import LostArmError, SlowerRobot
from foretouch.session.conformance import check_robot, failed

FIRST = 500 * COUNT  # Half open, as it begins [m]
IN = FIRST - 0.02  # Way to what lies between the fingers [m]
OVERLOAD = 1 << 5

pytestmark = pytest.mark.live

Settings = Callable[..., SimpleNamespace]


@pytest.fixture
def gripper(settings: Settings) -> Iterator[Any]:
    made = make_gripper(settings())
    yield made
    made.close()


def driven(gripper: Any, position: float, seconds: float, until: Callable[[], bool] = lambda: False) -> list[float]:
    """Command a way at 40 mm/s to a position and stay there, in real time; the forces [N]."""
    at, forces, end = gripper.read().position, [], time.monotonic() + seconds
    while time.monotonic() < end and not until():
        at += min(max(position - at, -8e-5), 8e-5)
        forces.append(gripper.exchange(at).sensor_force)
        time.sleep(0.002)
    return forces


def test_what_it_is_comes_from_the_servo_and_nothing_is_written_before_a_command(gripper: Any, bus: Any) -> None:
    specification = gripper.specification
    assert specification.workspace == pytest.approx((-FIRST, FIRST))
    assert specification.encoder_resolution == pytest.approx(92e-6, rel=0.01)
    assert specification.force_limit == pytest.approx(1.75 * 0.52 / 1.47 / LEVER)
    assert specification.sample_period in servo.PERIODS
    for _ in range(20):
        gripper.exchange(math.nan)
    assert bus.written == []
    assert gripper.read().position == 0.0


def test_it_grips_lets_go_and_is_left_without_torque(gripper: Any, bus: Any) -> None:
    assert driven(gripper, IN + 0.005, 1.5)[-1] == pytest.approx(bus.met(), abs=0.5)  # the friction is in it
    assert bus.met() == pytest.approx(500.0 * 0.005 / (1.0 + 500.0 / 2000.0), abs=0.3)
    assert abs(driven(gripper, 0.0, 1.5)[-1]) < 0.5
    gripper.close()
    gripper.close()
    assert bus.get(TORQUE) == 0


def test_it_begins_where_it_stands_after_an_overload_that_a_person_has_ended(gripper: Any, bus: Any) -> None:
    driven(gripper, IN + 0.005, 1.5)
    bus.errors = OVERLOAD
    driven(gripper, IN + 0.005, 0.3)
    assert gripper.read().held
    assert gripper.says == "overload"
    bus.opening = FIRST + 0.01  # opened by hand
    written = bus.written
    driven(gripper, IN + 0.005, 0.2)
    assert bus.written == written
    bus.errors = 0
    gripper.exchange(IN + 0.005)
    driven(gripper, -0.01, 0.5, until=lambda: bool(bus.get(TORQUE)))
    driven(gripper, -0.01, 0.05)
    written = bus.written
    began = len(written) - written[::-1].index((TORQUE, 1))
    goals = [value for register, value in written[began:] if register == GOAL_POSITION]
    assert goals
    assert min(goals) > 1590  # where it stands, and nothing of the press before
    assert abs(driven(gripper, -0.01, 0.5)[-1]) < 0.5
    assert gripper.read().position == pytest.approx(-0.01, abs=1e-3)


def test_a_goal_that_jumps_is_followed_at_an_arms_speed(settings: Settings, bus: Any) -> None:
    made = Servo(Address.read("robot", settings().robot, OPTIONS), CURRENT_BASED_POSITION)
    bus.thing = 0.0
    made.go(FIRST)
    time.sleep(0.3)
    made.go(0.01)
    time.sleep(0.06)
    assert 0.01 + 0.01 < made.state.opening < FIRST  # after 60 ms 15 mm of 36 at 0.25 m/s
    time.sleep(0.4)
    assert made.state.opening == pytest.approx(0.01, abs=1e-3)
    made.close()


def test_one_that_is_pulled_out_in_a_press_shows_no_force_and_ends_the_session(gripper: Any, bus: Any) -> None:
    driven(gripper, IN + 0.005, 1.5)
    bus.kill()
    assert math.isnan(driven(gripper, IN, 0.3)[-1])
    with pytest.raises(LostArmError, match=r"XL330-M288 1 at /dev/pts/\d+: it has said nothing for 1 s"):
        driven(gripper, IN, 3.0)
    gripper.close()


@pytest.mark.long
def test_a_silent_servo_and_one_that_takes_no_writing(gripper: Any, bus: Any) -> None:
    driven(gripper, IN + 0.005, 1.5)
    bus.silent = True
    assert math.isnan(driven(gripper, IN, 0.3)[-1])
    bus.silent = False
    driven(gripper, IN, 0.3)
    assert not math.isnan(driven(gripper, IN, 0.3)[-1])
    bus.deaf, told = True, bus.get(GOAL_POSITION)
    driven(gripper, 0.0, 0.5)
    assert bus.get(GOAL_POSITION) == told


@pytest.mark.long
def test_it_keeps_the_rules_of_a_driver(settings: Settings, bus: Any) -> None:
    assert failed(check_robot(lambda: SlowerRobot(make_gripper(settings())), move=True)) == []


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("", "needs the way from the servo's axis to where it is gripped"),
        (",lever=far", "lever must be a number"),
        (",lever=3", "must lie between 0.01 and 0.3"),
        (",lever=0.06,id=1.5", "id must be a whole number"),
        (",lever=0.06,baud=12345", "baud must be a rate that the bus knows"),
        (",lever=0.06,speed=3", "'speed=3' is not understood: write it as dynamixel@PORT,KEY=VALUE"),
    ],
)
def test_an_address_that_is_none_is_refused(settings: Settings, options: str, says: str) -> None:
    with pytest.raises(SettingError, match=says):
        make_gripper(settings(options))


def test_a_scene_a_missing_port_and_a_missing_library_are_refused(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SettingError, match="moves along a line"):
        make_gripper(settings(scene="plane"))
    with pytest.raises(SettingError, match="needs the port"):
        make_gripper(settings(robot="dynamixel@lever=0.06"))
    with pytest.raises(InputError, match=r"/dev/none: .*plugged in"):
        make_gripper(settings(robot="dynamixel@/dev/none,lever=0.06"))
    monkeypatch.setitem(sys.modules, "dynamixel_sdk", None)
    with pytest.raises(MissingExtraError, match="dynamixel"):
        make_gripper(settings())


@pytest.mark.parametrize(
    ("made", "says"),
    [
        ({"model": 1060}, "a servo of model 1060"),
        ({"low": 0, "high": 4095}, "not calibrated"),
        ({"lag": 0.016}, r"takes 1\d\.\d ms .*latency_timer"),
    ],
)
def test_a_servo_that_cannot_be_used_is_refused(made: dict[str, float], says: str) -> None:
    pytest.importorskip("dynamixel_sdk")
    with ServoBus(**made) as bus, pytest.raises(InputError, match=says):  # type: ignore[arg-type]
        make_gripper(SimpleNamespace(robot=f"dynamixel@{bus.port},lever=0.06", scene=""))


def test_a_port_is_for_one_process_alone(gripper: Any, settings: Settings) -> None:
    with pytest.raises(InputError, match="free"):
        make_gripper(settings())
