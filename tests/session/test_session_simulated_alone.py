"""A session in simulated time of its settings alone, and with what a caller brings."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import foretouch
from foretouch.cli.app import app
from foretouch.devices import GRIPS, BrowserOperator, Device, Hand, RecordedOperator, ScriptedOperator
from foretouch.errors import InputError, SettingError
from foretouch.messages import SessionLog
from foretouch.quantities import Frame
from foretouch.recordings import read_session
from foretouch.report import session_figures
from foretouch.robot import FaultySensor, MovedRobot, RcmArm, Robot, RobotSample, SensorFault, make_material, make_robot
from foretouch.session import FramedDevice, FramedRobot, SessionSettings, inverse, make_operator, simulate

SETTINGS = SessionSettings(material="hunt-crossley", seed=3)
SECONDS = 0.3


def by_command(path: Path, *options: str) -> SessionLog:
    arguments = ["simulate", "--duration", str(SECONDS), "--seed", "3", "--recording", str(path), *options]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    return read_session(path)


@pytest.mark.parametrize(
    "options",
    [
        {"material": "hunt-crossley"},
        {"follower_frame": "0.05,-1", "grip": "normal"},
        {"scene": "plane", "fusion": "contact"},
    ],
    ids=str,
)
def test_settings_alone_give_the_session_that_the_command_gives(options: dict[str, str], tmp_path: Path) -> None:
    log = simulate(SessionSettings(seed=3, **options), duration=SECONDS).log  # type: ignore[arg-type]
    given = [part for name, value in options.items() for part in (f"--{name.replace('_', '-')}", value)]
    recorded = by_command(tmp_path / "session.mcap", *given)
    for side in ("leader", "follower", "leader_space", "follower_space"):
        mine, theirs = getattr(log, side), getattr(recorded, side)
        assert mine.size == theirs.size
        assert all(
            (mine[name] == theirs[name]).all() or (mine[name] != mine[name]).all()
            for name in mine.dtype.names
            if name != "compute_ns"
        )
    assert log.settings.items() <= recorded.settings.items()


@pytest.mark.parametrize(
    "changes",
    [
        {"scene": "plane", "fusion": "contact"},
        pytest.param({"scene": "hill", "fusion": "contact", "jitter": 0.01}, marks=pytest.mark.long),
        {"baseline": "delayed-tdpa", "grip": "soft", "jitter": 0.01, "burst": 5.0},
    ],
    ids=str,
)
def test_a_session_equals_its_repetition_whatever_the_computer_took(changes: dict[str, Any]) -> None:
    settings = SessionSettings(**{"material": "hunt-crossley", "seed": 3, "loss": 0.1} | changes)
    one, other = (simulate(settings, duration=SECONDS) for _ in range(2))
    for side in (other.log.leader, other.log.follower):
        side["compute_ns"] += 1
    other = dataclasses.replace(other, elapsed=one.elapsed + 1.0)
    assert one == other
    assert one.log == other.log
    assert one.log.rows() == other.log.rows()
    assert hash(one) == hash(other)
    assert hash(one.log) == hash(other.log)
    reports = [session_figures(session.log) for session in (one, other)]
    assert reports[0] != reports[1]
    for report in reports:
        del report["timing"], report["latency"]
    assert reports[0] == reports[1]
    other.log.follower["force"][-1] += 1e-12
    assert one != other
    assert simulate(dataclasses.replace(settings, seed=4), duration=SECONDS) != one


def test_either_of_operator_and_robot_may_be_brought() -> None:
    alone = simulate(SETTINGS, duration=SECONDS).log
    robot = make_robot("hunt-crossley", seed=3)
    with_robot = simulate(SETTINGS, duration=SECONDS, robot=robot).log
    with_operator = simulate(SETTINGS, duration=SECONDS, operator=make_operator(SETTINGS)).log
    for log in (with_robot, with_operator):
        assert log.settings == alone.settings
        assert (log.follower["force"] == alone.follower["force"]).all()


FRAMED = FramedRobot(FaultySensor(make_robot("hunt-crossley"), SensorFault("stuck", 1.0)), Frame(0.1, -1.0))


@pytest.mark.parametrize(
    ("changes", "robot", "message"),
    [
        (
            {"scene": "plane"},
            make_robot("bone"),
            "robot = 'RcmArm': moves along one axis, and the scene plane is touch",
        ),
        ({"operator": "browser"}, None, "operator = 'browser': needs real time"),
        ({"operator": "browser", "scene": "plane"}, None, "operator = 'browser': needs real time"),
        ({"material": "bone"}, make_robot("hunt-crossley"), "material = 'bone': the robot presses hunt-crossley; make"),
        ({"material": "bone"}, FRAMED, "material = 'bone': the robot presses hunt-crossley; make it with make_ro"),
    ],
)
def test_what_does_not_go_together_is_refused(changes: dict[str, Any], robot: Robot | None, message: str) -> None:
    with pytest.raises(SettingError, match=message):
        simulate(SessionSettings(**changes), duration=SECONDS, robot=robot)


def test_an_operator_or_a_robot_that_was_used_before_is_refused() -> None:
    robot = make_robot("hunt-crossley", seed=3)
    operator = make_operator(SETTINGS, robot=robot)
    simulate(SETTINGS, duration=SECONDS, operator=operator, robot=robot)
    with pytest.raises(InputError, match="the operator was used before: make a fresh one for each session"):
        simulate(SETTINGS, duration=SECONDS, operator=operator)
    with pytest.raises(InputError, match="the robot was used before: make a fresh one for each session"):
        simulate(SETTINGS, duration=SECONDS, robot=robot)


def operators() -> list[Device]:
    script = ScriptedOperator(0.01, 0.005)
    motion = RecordedOperator([0.0, 0.3, 0.6, 0.9], [0.0, 0.01, 0.0, 0.01], 0.01, 0.005)  # type: ignore[arg-type]
    hand = Hand(ScriptedOperator(0.01, 0.005), GRIPS["normal"], SETTINGS.device)
    framed = FramedDevice(ScriptedOperator(0.01, 0.005), Frame(0.1, -1.0))
    return [script, motion, hand, framed, BrowserOperator(ScriptedOperator(0.01, 0.005))]


@pytest.mark.parametrize("operator", operators(), ids=lambda operator: type(operator).__name__)
def test_every_operator_of_the_package_says_whether_it_is_fresh(operator: Device) -> None:
    assert operator.fresh
    operator.read(0)
    assert not operator.fresh


def test_every_robot_says_whether_it_is_fresh_and_one_that_does_not_is_taken() -> None:
    def arm() -> Robot:
        return make_robot("hunt-crossley")

    fault = SensorFault("stuck", 1.0)
    robots = [arm(), FaultySensor(arm(), fault), MovedRobot(arm(), lambda _: 0.0), FramedRobot(arm(), inverse(Frame()))]
    for robot in robots:
        robot.read()
        assert robot.fresh
        robot.exchange(0.0)
        assert not robot.fresh
    robot = Wall()
    for _ in range(2):
        operator = ScriptedOperator(0.01, 0.005)
        assert simulate(SETTINGS, duration=SECONDS, operator=operator, robot=robot).log.follower.size


class Wall(Robot):
    def __init__(self) -> None:
        self._arm = make_robot("hunt-crossley")
        self.specification = self._arm.specification

    def read(self) -> RobotSample:
        return self._arm.read()

    def exchange(self, desired_position: float) -> RobotSample:
        return self._arm.exchange(desired_position)


def test_the_log_names_a_material_of_the_callers_own() -> None:
    material = dataclasses.replace(make_material("hunt-crossley"), name="my gel")
    log = simulate(SETTINGS, duration=SECONDS, robot=make_robot(material)).log
    assert log.settings["material"] == "my gel"
    assert foretouch.session_report(log).settings["material"] == "my gel"


def test_what_is_made_for_a_session_is_closed_after_it_and_what_is_brought_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    closed: list[Robot] = []
    monkeypatch.setattr(RcmArm, "close", lambda robot: closed.append(robot))
    brought = make_robot("hunt-crossley")
    simulate(SETTINGS, duration=0.01, robot=brought)
    assert closed == []
    simulate(SETTINGS, duration=0.01)
    assert len(closed) == 1
