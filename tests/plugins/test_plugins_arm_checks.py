"""The rules of an arm's driver: one that keeps all, and for each rule one that breaks it."""

from __future__ import annotations

import random
import re
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from foretouch.robot import RobotSpecification
from foretouch.robot.drivers import ArmLink, ArmState, arm_robot
from foretouch.robot.robot import Vector
from foretouch.session.conformance import Finding, arm_checks, check_robot, link_of
from foretouch.session.conformance.robot_checks import Subject, checked

PAGE = Path(__file__).parents[2] / "docs" / "drivers.md"


class Good(ArmLink):
    """An arm of 1 kHz that is at once where it is told to be."""

    name = "good arm"
    reach = (0.3, -0.1, 0.1), (0.5, 0.1, 0.3)
    specification = RobotSpecification(1e-3, 15.0, 1e-6, 0.0, 0.0, 0.0, 0.02, 0.0, 500.0, (0.1, 0.3), sensor_range=60.0)

    def __init__(self) -> None:
        self.place: Vector = (0.4, 0.0, 0.2)

    def state(self) -> Any:
        return ArmState(time.monotonic_ns(), self.place, (0.0, 0.0, random.gauss(0.0, 0.02)), (0.1, 0.2))

    def command(self, place: Vector) -> None:
        self.place = place


def found(kind: type[ArmLink], *, move: bool = True) -> dict[str, Finding]:
    return {one.check: one for one in check_robot(lambda: arm_robot(kind(), in_space=False), move=move)}


def changed(**fields: Any) -> type[Good]:
    """A good arm whose states say something else."""

    class Other(Good):
        def state(self) -> Any:
            return super().state()._replace(**{name: of(self) for name, of in fields.items()})

    return Other


def specified(**fields: Any) -> type[Good]:
    return type("Other", (Good,), {"specification": replace(Good.specification, **fields)})


def turned(place: Vector) -> Vector:
    x, y, z = (value - middle for value, middle in zip(place, (0.4, 0.0, 0.2), strict=True))
    return 0.4 - y, x, 0.2 + z


class Turned(Good):
    def command(self, place: Vector) -> None:
        self.place = turned(place)


class UpsideDown(Good):
    def command(self, place: Vector) -> None:
        self.place = (place[0], place[1], 0.4 - place[2])


class Slow(Good):
    def state(self) -> Any:
        time.sleep(5e-4)
        return super().state()


class Sagging(Good):
    """It sinks at 20 mm/s where it is not commanded."""

    def __init__(self) -> None:
        super().__init__()
        self._last = time.monotonic()

    def command(self, place: Vector) -> None:
        self.place, self._last = place, time.monotonic()

    def state(self) -> Any:
        x, y, z = self.place
        return super().state()._replace(place=(x, y, z - 20e-3 * (time.monotonic() - self._last)))


class Backwards(Good):
    def state(self) -> Any:
        return super().state()._replace(measured_ns=time.monotonic_ns() - random.randrange(5_000_000))


class Seldom(Good):
    """Ten states a second."""

    def state(self) -> Any:
        return super().state()._replace(measured_ns=time.monotonic_ns() // 100_000_000 * 100_000_000)


WRONG: dict[str, type[ArmLink]] = {
    "name": type("Other", (Good,), {"name": " "}),
    "reach": type("Other", (Good,), {"reach": ((300.0, -100.0, 100.0), (500.0, 100.0, 300.0))}),
    "begins within its reach": type("Other", (Good,), {"reach": ((0.3, 0.1, 0.1), (0.5, 0.2, 0.3))}),
    "rate": specified(sample_period=3e-3),
    "force limit": specified(sensor_range=10.0),
    "force": changed(force=lambda arm: (0.0, 0.0, 100.0)),
    "nothing is felt in free air": changed(force=lambda arm: (0.0, 0.0, 3.0)),
    "force noise": changed(force=lambda arm: (0.0, 0.0, random.gauss(0.0, 0.2))),
    "joints": changed(joints=lambda arm: (30.0, 45.0)),
    "it takes commands": changed(refuses=lambda arm: "protective stop"),
    "clock": changed(measured_ns=lambda arm: time.monotonic_ns() + 10**9),
    "order": Backwards,
    "new states": Seldom,
    "gaps": Seldom,
    "time of state()": Slow,
    "at rest": Sagging,
    "follows along x": Turned,
    "follows along y": Turned,
    "follows along z": UpsideDown,
    "holds without commands": Sagging,
}


def test_a_good_driver_keeps_every_rule_and_there_are_thirty_of_them() -> None:
    findings = found(Good)
    assert [one for one in findings.values() if one.passed is False] == []
    assert len(findings) >= 30
    assert all(one.rule for one in findings.values())


def test_what_may_not_be_moved_is_commanded_nothing() -> None:
    told: list[Vector] = []

    class Watched(Good):
        def command(self, place: Vector) -> None:
            told.append(place)

    findings = found(Watched, move=False)
    assert told == []
    assert findings["driver: follows along x"].passed is None
    assert findings["driver: place"].passed


@pytest.mark.parametrize("rule", WRONG)
def test_a_driver_that_breaks_a_rule_is_told_which(rule: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arm_checks, "LISTENED", 0.2)
    looks: dict[str, Any] = {name: look for name, _, look in checked._checks}
    robot = arm_robot(WRONG[rule](), in_space=False)
    passed, said, *_ = looks[f"driver: {rule}"](Subject(robot, lambda: robot, True))
    assert not passed, said


def test_a_state_that_is_none_breaks_the_rules_of_states() -> None:
    class Dict(Good):
        began = False

        def state(self) -> Any:
            state = super().state()
            return state if not self.began else {"place": state.place}

    made = Dict()
    robot = arm_robot(made, in_space=False)
    made.began = True
    findings = {one.check: one for one in check_robot(lambda: robot)}
    assert findings["driver: state"].passed is False
    assert findings["driver: place"].passed is False


def test_a_robot_without_a_driver_has_none_of_these_rules() -> None:
    assert link_of(object()) is None


def test_the_page_has_every_rule_with_what_to_do() -> None:
    rows = dict(re.findall(r"^\| `([^`]+)` \| ([^|]+) \|$", PAGE.read_text(), re.MULTILINE))
    assert {name for name, _, _ in checked._checks} == set(rows)
    assert all(text.strip() for text in rows.values())
