"""What is said of a robot or device that is connected, against machines whose faults are known."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import Any

import numpy as np
import pytest

from foretouch.cli.app import app
from foretouch.devices import AnyDevice, DeviceSpecification
from foretouch.doctor import Verdict
from foretouch.doctor.machines import check_machine, judge, watch_device, watch_robot
from foretouch.robot import RobotSpecification, SpatialRobot, SpatialSample
from foretouch.robot.robot import Vector

LATE = 0.02  # [s]


class Known(SpatialRobot):
    """A robot of a known latency, noise, step, drift and frame, and a floor of 1,000 N/m below 0."""

    reach = (-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)

    def __init__(self, turn: Any = None, scale: float = 1.0, height: float = 0.05, deaf: bool = False) -> None:
        self.specification = RobotSpecification(1e-3, 15.0, 1e-6, 0.0, 0.0, 0.0, 0.02, 0.0, 500.0, (-0.1, 0.1))
        self._turn, self._scale, self._deaf = np.eye(3) if turn is None else turn, scale, deaf
        self._start = self._place = np.array((0.0, 0.0, height))
        self._told: deque[tuple[float, Any]] = deque()
        self._random, self._began = np.random.default_rng(1), time.perf_counter()

    def read(self) -> SpatialSample:
        now = time.perf_counter()
        while self._told and self._told[0][0] <= now - LATE:
            self._place = self._told.popleft()[1]
        force = max(-1000.0 * self._place[2], 0.0) + 0.1 * (now - self._began) + self._random.normal(0.0, 0.05)
        place: Any = tuple((np.rint(self._place / 1e-5) * 1e-5).tolist())
        return SpatialSample(place, (0.0, 0.0, force), (math.nan,) * 3, (math.nan,) * 3, (), False)

    def exchange(self, desired: Vector) -> SpatialSample:
        if not self._deaf and all(map(math.isfinite, desired)):
            way = self._turn @ (np.array(desired) - self._start)
            self._told.append((time.perf_counter(), self._start + self._scale * way))
        return self.read()


def found(robot: SpatialRobot, move: float = 0.005) -> dict[str, Any]:
    return {one.name.partition(": ")[2]: one for one in judge("robot known", watch_robot(robot, 0.5, move))}


@pytest.mark.long
def test_latency_noise_and_drift_are_those_that_it_has() -> None:
    findings = found(Known())
    figures = findings["rate"].figures
    assert figures["latency"] == pytest.approx(LATE, abs=5e-3)
    assert figures["force_noise"] == pytest.approx(0.05, rel=0.3)
    assert figures["force_drift"] == pytest.approx(0.1, abs=0.06)
    assert findings["force"].verdict is Verdict.WARNING  # 6 N a minute
    assert findings["sign and frame"].verdict is Verdict.GOOD
    assert findings["force after motion"].verdict is Verdict.UNKNOWN
    assert "ms from a command" in findings["latency"].summary


def test_a_robot_that_may_not_move_is_told_nothing() -> None:
    robot = Known()
    findings = found(robot, move=0.0)
    assert not robot._told
    assert robot._place[2] == 0.05
    assert findings["latency"].verdict is Verdict.UNKNOWN
    assert "sign and frame" not in findings


@pytest.mark.parametrize(
    ("robot", "said"),
    [
        (Known(scale=-1.0), "the wrong way round"),
        (Known(scale=1e-3), "0.00 of the way"),
        (Known(turn=np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])), "along another axis"),
    ],
    ids=["sign", "unit", "frame"],
)
@pytest.mark.first
def test_a_wrong_sign_unit_or_frame_is_bad(robot: Known, said: str) -> None:
    finding = found(robot)["sign and frame"]
    assert finding.verdict is Verdict.BAD
    assert said in finding.summary


@pytest.mark.long
def test_one_that_does_not_move_is_bad() -> None:
    assert found(Known(deaf=True))["latency"].verdict is Verdict.BAD


def test_steps_of_the_encoders_are_told() -> None:
    class Shaking(Known):
        def read(self) -> SpatialSample:
            x = round(3e-5 * self._random.normal() / 1e-5) * 1e-5
            return super().read()._replace(place=(x, 0.0, 0.05))

    figures = found(Shaking(), move=0.0)["position"].figures
    assert figures["place_step"] == pytest.approx(1e-5, rel=1e-6)
    assert figures["place_noise"] == pytest.approx(3e-5, rel=0.3)


def test_a_sensor_that_shows_no_number_is_bad() -> None:
    class Blind(Known):
        def read(self) -> SpatialSample:
            return super().read()._replace(force=(math.nan,) * 3)

    findings = found(Blind(), move=0.0)
    assert findings["force"].verdict is Verdict.BAD
    assert findings["samples"].verdict is Verdict.BAD


class Handle(AnyDevice):  # type: ignore[type-arg]
    """A device that shows a place every 4 ms."""

    name = "handle"
    specification = DeviceSpecification(damping=1.0)

    def read(self, now_ns: int) -> float:
        return 1e-3 * math.sin(6.0 * (now_ns // 4_000_000) * 4e-3)

    def render(self, force: float) -> float:
        raise AssertionError("it is given no force")


def test_a_device_is_read_alone_and_its_rate_is_told() -> None:
    report = watch_device(Handle(), 1.0)
    rate, *_, carries = judge("device handle", report)
    assert rate.verdict is Verdict.WARNING
    assert 50.0 < report["rate"] < 290.0  # 250, but for what the machine kept from looking
    assert f"carries {Handle.specification.largest_stiffness(1e-3):.0f} N/m" in carries.summary


@pytest.mark.long
def test_a_robot_of_the_package_is_looked_at_in_a_process_of_its_own() -> None:
    names = {one.name: one for one in check_machine("robot", "simulated", 0.3, 0.002)}
    assert names["robot simulated: sign and frame"].verdict is Verdict.GOOD
    assert names["robot simulated: samples"].verdict is Verdict.GOOD


@pytest.mark.long
def test_one_that_cannot_be_made_is_one_bad_line() -> None:
    (finding,) = check_machine("device", "gamepad", 0.3, 0.0)
    assert finding.verdict is Verdict.BAD
    assert "gamepad" in finding.name


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--robot", "nobody"], "unknown robot"),
        (["--device", "nobody"], "unknown operator"),
        (["--move", "5"], "add --robot NAME"),
        (["--robot", "simulated", "--move", "500"], "must be 0 to 20 mm"),
    ],
)
def test_a_name_or_way_that_cannot_be_is_refused(options: list[str], said: str) -> None:
    from foretouch.errors import ForetouchError

    with pytest.raises(ForetouchError, match=said):
        app(["doctor", *options], standalone_mode=False)
