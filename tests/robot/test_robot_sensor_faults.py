"""Sensors that fail on purpose: what they show, and that the watch finds each within its time."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from foretouch.errors import SettingError, UnknownNameError
from foretouch.identification import SensorState, SensorWatch
from foretouch.robot import SENSOR_FAULTS, FaultySensor, RobotSample, SensorFault, make_robot

BEGIN, END = 0.4, 0.6
EXPECTED = {
    "nan": (SensorState.NOT_FINITE, 0.0),
    "dropout": (SensorState.DROPOUT, 0.02),
    "stuck": (SensorState.STUCK, 0.1),
    "saturated": (SensorState.SATURATED, 0.001),
    "offset-step": (SensorState.OFFSET_STEP, 0.055),
    "spikes": (SensorState.SPIKE, 0.15),
    "encoder-jump": (SensorState.ENCODER_JUMP, 0.0),
}
"""State, and the time in which it is found with the arm held still in free air [s]."""


def run(robot, ticks: int, still: bool = False) -> list[RobotSample]:
    return [robot.exchange(-0.005 if still else 0.02 + 0.01 * math.sin(0.01 * tick)) for tick in range(1, ticks + 1)]


@pytest.fixture(scope="module")
def good() -> list[RobotSample]:
    return run(make_robot("hand", seed=3), 800)


@pytest.mark.parametrize("kind", SENSOR_FAULTS)
def test_only_what_fails_is_changed_and_only_then(kind: str, good: list[RobotSample]) -> None:
    samples = run(FaultySensor(make_robot("hand", seed=3), SensorFault(kind, BEGIN, END), seed=1), 800)
    first, last = round(1e3 * BEGIN), round(1e3 * END)
    # NaN is not equal to itself: compare what is written
    assert list(map(str, samples[: first - 1])) == list(map(str, good[: first - 1]))
    assert list(map(str, samples[last - 1 :])) == list(map(str, good[last - 1 :]))
    inside = list(zip(samples, good, strict=True))[first - 1 : last - 1]
    assert any(str(changed) != str(right) for changed, right in inside)
    for changed, right in inside:
        assert (changed.exact_force, changed.exact_position) == (right.exact_force, right.exact_position)
        assert changed.commanded_position == right.commanded_position


def test_what_each_fault_shows(good: list[RobotSample]) -> None:
    def at(kind: str) -> RobotSample:
        return run(FaultySensor(make_robot("hand", seed=3), SensorFault(kind, BEGIN)), 450)[-1]

    before, right = good[398], good[449]
    assert math.isnan(at("nan").sensor_force)
    assert at("stuck") == right._replace(sensor_force=before.sensor_force)
    assert at("dropout")[:3] == before[:3]
    assert at("saturated").sensor_force == make_robot("hand", seed=3).specification.sensor_range
    assert at("offset-step").sensor_force == pytest.approx(right.sensor_force + 3.0)
    assert at("encoder-jump").position == pytest.approx(right.position + 5e-3)


def test_the_same_seed_gives_the_same_spikes() -> None:
    def spikes(seed: int) -> list[RobotSample]:
        return run(FaultySensor(make_robot("hand", seed=3), SensorFault("spikes", 0.1), seed=seed), 600)

    assert spikes(1) == spikes(1)
    assert spikes(1) != spikes(2)


@pytest.mark.parametrize("kind", SENSOR_FAULTS)
def test_the_watch_finds_each_fault_in_time(kind: str) -> None:
    robot = FaultySensor(make_robot("foam-measured", seed=3), SensorFault(kind, BEGIN), seed=1)
    specification = robot.specification
    watch = SensorWatch((-specification.sensor_range, specification.sensor_range))
    state, longest = EXPECTED[kind]
    began = None
    for tick, sample in enumerate(run(robot, 800, still=True), 1):
        result = watch.update(
            tick * 1e-3, sample.position, sample.sensor_force, specification.tool_force(sample.acceleration)
        )
        if tick * 1e-3 < BEGIN - 1e-9:
            assert result is SensorState.GOOD
            continue
        began = tick if began is None else began
        if result is state:
            assert (tick - began) * 1e-3 <= longest + 1e-9
            return
    pytest.fail(f"{kind} was not found")


def test_faults_from_text() -> None:
    assert SensorFault.from_text("sensor-fault", "stuck:5:8") == SensorFault("stuck", 5.0, 8.0)
    assert SensorFault.from_text("sensor-fault", "nan:2.5") == SensorFault("nan", 2.5, math.inf)
    with pytest.raises(UnknownNameError, match="unknown sensor-fault 'broken': choose one of dropout"):
        SensorFault.from_text("sensor-fault", "broken:1:2")
    for text in (
        "stuck",
        "stuck:",
        "stuck:a:b",
        "stuck:8:5",
        "stuck:-1:5",
        "stuck:1:2:3",
        "stuck:nan:5",
        "stuck:1:nan",
    ):
        with pytest.raises(SettingError, match="for example stuck:5:8"):
            SensorFault.from_text("sensor-fault", text)


def test_it_is_a_robot_like_the_one_inside() -> None:
    arm = make_robot("hand", seed=0)
    robot = FaultySensor(arm, SensorFault("nan", 0.0))
    assert robot.read() == arm.read()
    assert robot.specification is arm.specification
    assert not robot.faulty
    robot.exchange(0.0)
    assert robot.faulty
    assert math.isnan(robot.read().sensor_force)
    robot.close()
    robot.close()
    with pytest.raises(SettingError, match="seed"):
        FaultySensor(arm, SensorFault("nan", 0.0), seed=-1)


def test_the_page_of_the_room_says_what_each_shows() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "rooms" / "robot.md").read_text()
    for kind, shown in SENSOR_FAULTS.items():
        assert f"| `{kind}` | {shown} |" in page
