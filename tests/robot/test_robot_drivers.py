"""A real arm behind its driver: late, silent, refusing, talking nonsense."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import InputError
from foretouch.robot import RobotSpecification
from foretouch.robot.along_line import AlongLine
from foretouch.robot.drivers import (
    ArmLink,
    ArmState,
    DrivenArm,
    LostArmError,
    SlowerRobot,
    SlowerSpatialRobot,
)
from foretouch.robot.robot import Vector

MS = 1_000_000
START: Vector = (0.3, 0.0, 0.2)


class Arm(ArmLink):
    """An arm that is where it is told to be at once; time passes with `pass_time`."""

    name = "test arm"

    def __init__(self, rate: int = 1000) -> None:
        self.specification = RobotSpecification(1.0 / rate, 15.0, 1e-6, 0.0, 0.0, 0.0, 0.02, 0.0, 500.0, (0.1, 0.3))
        self.reach = (0.2, -0.1, 0.1), (0.4, 0.1, 0.3)
        self.now, self.place, self.force = 0, START, (0.0, 0.0, 1.0)
        self.refuses, self.silent, self.closed = "", False, 0
        self.commands: list[Vector] = []
        self._newest = ArmState(0, START, self.force)

    def clock(self) -> int:
        return self.now

    def state(self) -> ArmState:
        if not self.silent:
            self._newest = ArmState(self.now, self.place, self.force, (), self.refuses)
        return self._newest

    def command(self, place: Vector) -> None:
        self.commands.append(place)
        self.place = place

    def close(self) -> None:
        self.closed += 1


def driven(arm: Arm) -> DrivenArm:
    return DrivenArm(arm, clock=arm.clock)


def passed(arm: Arm, robot: DrivenArm, ticks: int, desired: Vector = START) -> list[object]:
    samples = []
    for _ in range(ticks):
        arm.now += MS
        samples.append(robot.exchange(desired))
    return samples


def test_who_only_watches_commands_nothing() -> None:
    arm = Arm()
    passed(arm, driven(arm), 50, (math.nan,) * 3)
    assert arm.commands == []


def test_a_command_that_is_none_leaves_the_one_before() -> None:
    arm = Arm()
    robot = driven(arm)
    passed(arm, robot, 200, (0.32, 0.0, 0.2))
    passed(arm, robot, 5, (math.nan, 0.0, 0.0))
    assert len(arm.commands) == 205
    assert arm.commands[-1] == pytest.approx((0.32, 0.0, 0.2))


@given(st.lists(st.tuples(*[st.floats(width=64)] * 3), max_size=60))
def test_whatever_is_asked_the_arm_is_told_small_steps_within_its_reach(asked: list[Vector]) -> None:
    arm = Arm()
    robot, before, (low, high) = driven(arm), START, arm.reach
    for place in asked:
        arm.now += MS
        robot.exchange(place)
    for told in arm.commands:
        assert math.dist(told, before) <= 0.25e-3 * (1.0 + 1e-9)
        assert all(a - 1e-12 <= value <= b + 1e-12 for a, value, b in zip(low, told, high, strict=True))
        before = told


def test_an_arm_that_refuses_is_held_commanded_nothing_and_begins_again_where_it_stands() -> None:
    arm = Arm()
    robot = driven(arm)
    passed(arm, robot, 10)
    arm.refuses, arm.place = "protective stop", (0.35, 0.05, 0.25)
    told = len(arm.commands)
    (sample,) = passed(arm, robot, 1)
    assert sample.held
    assert robot.says == "protective stop"
    passed(arm, robot, 500)
    assert len(arm.commands) == told
    arm.refuses = ""
    (sample,) = passed(arm, robot, 1)
    assert not sample.held
    assert robot.says == ""
    assert math.dist(arm.commands[-1], (0.35, 0.05, 0.25)) <= 0.25e-3 * (1.0 + 1e-9)


def test_silence_is_no_force_at_first_and_then_the_end() -> None:
    arm = Arm()
    robot = driven(arm)
    passed(arm, robot, 10)
    arm.silent = True
    forces = [sample.force[2] for sample in passed(arm, robot, 100)]
    assert forces[:19] == [1.0] * 19
    assert all(map(math.isnan, forces[20:]))
    passed(arm, robot, 900, (0.3, 0.0, 0.21))
    assert arm.commands[-1][2] == pytest.approx(0.21)  # an arm that only cannot speak is led out all the same
    with pytest.raises(LostArmError, match="test arm: it has said nothing for 1 s: see that it stands still"):
        passed(arm, robot, 5)


@pytest.mark.parametrize("method", ["state", "command"])
def test_a_driver_that_raises_is_silent_and_says_why(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = Arm()
    robot = driven(arm)

    def broken(*_: object) -> ArmState:
        raise ConnectionResetError("the other end\nhas gone")

    passed(arm, robot, 10)
    monkeypatch.setattr(arm, method, broken)
    passed(arm, robot, 50)
    assert robot.says == "the other end has gone"
    if method == "state":
        with pytest.raises(LostArmError, match=r"nothing for 1 s \(the other end has gone\)"):
            passed(arm, robot, 1000)


@pytest.mark.parametrize("force", [(math.nan,) * 3, (0.0, math.inf, 0.0), (1e9, 0.0, 0.0), None, (1.0,)])
def test_a_force_that_is_none_is_shown_as_none(force: object) -> None:
    arm = Arm()
    robot = driven(arm)
    arm.force = force  # type: ignore[assignment]
    (sample,) = passed(arm, robot, 1)
    assert all(map(math.isnan, sample.force))


def test_a_place_that_is_none_says_nothing() -> None:
    arm = Arm()
    robot = driven(arm)
    passed(arm, robot, 10)
    arm.command = lambda _: None  # type: ignore[assignment]
    arm.place = (math.nan, 0.0, 0.0)
    samples = passed(arm, robot, 30)
    assert all(sample.place == START for sample in samples)
    assert math.isnan(samples[-1].force[0])


def test_an_arm_that_never_says_where_it_is_is_refused_and_closed() -> None:
    arm = Arm()
    arm.place = (300.0, 0.0, 200.0)  # millimetres

    def clock() -> int:
        arm.now += 500 * MS
        return arm.now

    with pytest.raises(InputError, match=r"test arm: no place of its tip within 3 s \(it says it is at \(300.0, 0.0"):
        DrivenArm(arm, clock=clock)
    assert arm.closed == 1


def test_along_a_line_it_goes_down_from_where_it_was() -> None:
    arm = Arm()
    robot = AlongLine(driven(arm), START)
    assert robot.specification.workspace == pytest.approx((-0.1, 0.1))
    assert robot.read().position == 0.0
    for _ in range(20):
        arm.now += MS
        sample = robot.exchange(0.002)
    assert arm.commands[-1] == pytest.approx((0.3, 0.0, 0.198))
    assert sample.commanded_position == pytest.approx(0.002)
    assert sample.sensor_force == 1.0


def test_a_line_that_only_watches_commands_nothing() -> None:
    arm = Arm()
    robot = AlongLine(driven(arm), START)
    for _ in range(5):
        robot.exchange(math.nan)
    assert arm.commands == []


@pytest.mark.parametrize(("rate", "ticks"), [(500, 2), (250, 4), (200, 5)])
def test_a_slower_arm_gets_every_nth_command_and_says_what_that_costs(rate: int, ticks: int) -> None:
    arm = Arm(rate)
    robot = SlowerSpatialRobot(driven(arm))
    assert robot.specification.sample_period == 1e-3
    assert f"takes a command every {ticks} ms" in robot.says
    passed(arm, robot, 100)  # type: ignore[arg-type]
    assert len(arm.commands) == 100 // ticks


@pytest.mark.parametrize("period", [0.0, 0.0015, 0.01, math.nan])
def test_another_rate_is_refused_with_those_that_are_taken(period: float) -> None:
    arm = Arm()
    robot = AlongLine(driven(arm), START)
    robot.specification = RobotSpecification(period, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 500.0, (0.0, 0.1))
    with pytest.raises(InputError, match="1 kHz, 500, 250 or 200 Hz"):
        SlowerRobot(robot)
