"""A sensor's calibration in sessions: right with it where it is wrong without, and refused where it does not fit."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commanded import MS, CommandedInSpace

from foretouch.errors import RecordingError, SettingError
from foretouch.messages import SessionLog, Status
from foretouch.quantities import SensorCalibration
from foretouch.recordings import write_calibration
from foretouch.robot import MovedRobot, Robot, RobotSample, SpatialSample, WrappedSpatialRobot, make_robot
from foretouch.session import SessionSettings, make_operator, simulate
from foretouch.session.runners.driven import Tick, drive_follower
from foretouch.session.runners.shadow import Shadow
from foretouch.session.settings import shadow_settings
from foretouch.session.spatial import make_scene, make_spatial_robot
from foretouch.session.spatial.probe import ProbeInSpace
from foretouch.session.steps import follower
from foretouch.session.steps.sensing import calibrated

SIMPLE = {"material": "hunt-crossley", "model": "kelvin-voigt", "position_delay": 0.02, "force_delay": 0.02}
OWN_OFFSET = 0.3
"""Of the simulated arm's sensor [N]."""


class Mounted(Robot):
    """The simulated arm with another sensor: an offset, a heavier tool, forces that come late, a tip that gives way."""

    def __init__(
        self, material: str, *, offset: float = 0.0, tool: float = 0.0, lag: int = 0, stiffness: float = math.inf
    ) -> None:
        self.robot = make_robot(material, seed=0)
        self.offset, self.tool, self.stiffness = offset, tool, stiffness
        self.late: deque[float] = deque([0.0] * lag, maxlen=lag + 1)
        self.specification = self.robot.specification
        self.give = 0.0

    def read(self) -> RobotSample:
        return self._seen(self.robot.read())

    def exchange(self, desired_position: float) -> RobotSample:
        return self._seen(self.robot.exchange(desired_position - self.give))

    def _seen(self, sample: RobotSample) -> RobotSample:
        own = self.specification
        contact = sample.sensor_force - own.tool_force(sample.acceleration)
        self.late.append(contact)
        self.give = max(sample.exact_force, 0.0) / self.stiffness
        tool = (own.tool_mass + self.tool) * (sample.acceleration - own.gravity)
        return sample._replace(sensor_force=self.late[0] + tool + self.offset, position=sample.position + self.give)


def calibration(tmp_path: Path, **known: Any) -> str:
    path = tmp_path / "sensor.toml"
    write_calibration(path, SensorCalibration(**known))
    return str(path)


def bias(offset: float, tool: float) -> dict[str, Any]:
    """What `foretouch calibrate sensor` finds of a `Mounted` arm, whose own tool is 0.1 kg or what it says."""
    own = make_robot("hunt-crossley", seed=0).specification
    return {
        "force_bias": (0.0, 0.0, -offset - OWN_OFFSET),
        "tool_mass": own.tool_mass + tool,
        "approach_gravity": own.gravity,
    }


def run(robot: Mounted, seconds: float = 5.0, **changes: Any) -> SessionLog:
    settings = SessionSettings(**SIMPLE | changes)  # type: ignore[arg-type]
    material = robot.robot.material
    operator = make_operator(settings, surface=material.surface, press_depth=material.press_depth, say=pytest.fail)
    return simulate(settings, duration=seconds, operator=operator, robot=robot).log


def stiffness(log: SessionLog) -> float:
    return float(log.models[-1].parameters[0])


def in_touch(log: SessionLog) -> Any:
    follower = log.follower[2000:]
    return follower[follower["exact_force"] > 1.0]


@pytest.mark.long
def test_an_offset_and_a_tool_are_taken_off_from_the_first_tick_on(tmp_path: Path) -> None:
    offset, tool = 3.0, 0.1
    without = run(Mounted("hunt-crossley", offset=offset, tool=tool), 0.5)
    with_it = run(
        Mounted("hunt-crossley", offset=offset, tool=tool), calibration=calibration(tmp_path, **bias(offset, tool))
    )
    free, gravity = slice(50, 400), make_robot("hunt-crossley", seed=0).specification.gravity
    assert abs(np.mean(with_it.follower["force"][free])) < 0.05
    assert np.abs(with_it.follower["sensor_force"][free]).mean() < 0.1
    rows = in_touch(with_it)
    assert np.abs(rows["force"] - rows["exact_force"]).max() < 0.15
    # Without it the learner finds most of it in free air; but safety, which knows how large an offset can be, feels a
    # contact from the first tick on, and jerks of a tool that is heavier than it should be are felt as contact.
    assert without.follower["sensor_force"][free].mean() == pytest.approx(OWN_OFFSET + offset - tool * gravity, abs=0.1)
    unexplained = without.follower["sensor_force"] - make_robot("hunt-crossley", seed=0).specification.largest_offset
    assert unexplained[free].min() > 1.0
    assert (with_it.follower["sensor_force"][free]).max() < 0.2


def test_a_follower_that_begins_in_contact_knows_what_it_presses_with(tmp_path: Path) -> None:
    result = {}
    for path in ("", calibration(tmp_path, **bias(0.9, 0.0))):
        robot = Mounted("hunt-crossley", offset=0.9)
        surface = robot.robot.surface
        for depth in np.linspace(-0.005, 0.004, 600):
            robot.exchange(surface + float(depth))
        log = run(robot, 0.3, calibration=path, operator="scripted", first_touch="follow")
        result[bool(path)] = log.follower["force"][20] / log.follower["exact_force"][20]
    assert result[True] == pytest.approx(1.0, abs=0.1)
    assert result[False] < 0.2  # taken for the sensor's offset


class Hardware(Mounted):
    """The same, which does not know what it touches."""

    def _seen(self, sample: RobotSample) -> RobotSample:
        return super()._seen(sample)._replace(exact_force=math.nan, exact_position=math.nan)


def test_a_zero_that_is_wrong_is_refused_where_nothing_can_be_touched(tmp_path: Path) -> None:
    wrong = SessionSettings(calibration=calibration(tmp_path, **bias(0.8, 0.0)))
    with pytest.raises(
        SettingError, match=r"sensor.toml': leaves 0.8\d? N at the start, in free air, where at most 0.5 N may"
    ):
        drive_follower(Mounted("hunt-crossley"), wrong, 1)
    drive_follower(Hardware("hunt-crossley"), wrong, 1)  # it may begin in contact
    for seed in range(20):  # it may have drifted
        settings = replace(wrong, calibration=calibration(tmp_path, **bias(0.4, 0.0)), seed=seed)
        drive_follower(Mounted("hunt-crossley"), settings, 1)


class Shifted(WrappedSpatialRobot):
    """Its sensor shows 2.5 N more."""

    def read(self) -> SpatialSample:
        sample = self.robot.read()
        return sample._replace(force=(sample.force[0] + 2.5, *sample.force[1:]))

    def exchange(self, desired_position: Any) -> SpatialSample:
        self.robot.exchange(desired_position)
        return self.read()


def test_in_space_more_than_the_bias_is_refused(tmp_path: Path) -> None:
    known = calibration(tmp_path, force_bias=(0.0, 0.0, 0.4), tool_mass=0.1)
    settings = SessionSettings(scene="plane", calibration=known)
    robot = make_spatial_robot(settings, make_scene("plane"))
    drive_follower(robot, settings, 1)
    with pytest.raises(SettingError, match=r"leaves 2.\d N at the start, in free air, where at most 0.55 N may"):
        drive_follower(Shifted(robot), settings, 1)


@pytest.mark.long
def test_a_late_sensor_makes_a_material_that_pushes_on_and_calibrated_does_not(tmp_path: Path) -> None:
    lag = 10
    without = run(Mounted("hunt-crossley", lag=lag))
    with_it = run(Mounted("hunt-crossley", lag=lag), calibration=calibration(tmp_path, sensor_lag=lag * 1e-3))
    exact = run(Mounted("hunt-crossley"))
    damping = [float(log.models[-1].parameters[1]) for log in (exact, with_it, without)]
    assert abs(damping[1] - damping[0]) < 0.35 * abs(damping[2] - damping[0])
    assert stiffness(with_it) == pytest.approx(stiffness(exact), rel=0.05)


@pytest.mark.long
def test_what_gives_way_behind_the_tip_is_no_part_of_the_material(tmp_path: Path) -> None:
    series = 3000.0
    path = calibration(tmp_path, series_stiffness=series)
    # The first presses are slow: the robot goes into what it does not know.
    exact = run(Mounted("hunt-crossley"), 7.0)
    without = run(Mounted("hunt-crossley", stiffness=series), 7.0)
    with_it = run(Mounted("hunt-crossley", stiffness=series), 7.0, calibration=path)
    true = stiffness(exact)
    assert stiffness(with_it) == pytest.approx(true, rel=0.03)
    assert stiffness(without) == pytest.approx(true * series / (true + series), rel=0.05)
    # Commands say where the tip is to be: it goes as deep as without anything that gives way, and the force is right.
    deepest = [float(np.percentile(log.follower["position"][4000:], 99)) for log in (exact, with_it)]
    assert deepest[1] == pytest.approx(deepest[0], abs=1e-4)
    felt = [float(np.percentile(log.follower["exact_force"][4000:], 99)) for log in (exact, without, with_it)]
    assert felt[2] == pytest.approx(felt[0], rel=0.03)
    assert felt[1] < 0.93 * felt[0]
    assert felt[2] < 15.0


def test_the_force_stays_below_the_ceiling_on_a_stiff_wall_behind_a_soft_arm(tmp_path: Path) -> None:
    """Following the tip pushes the encoder on as the force grows: less than it grew, or it would not come to rest."""
    path = calibration(tmp_path, series_stiffness=40_000.0)
    log = run(Mounted("bone", stiffness=40_000.0), calibration=path, material="bone", model="contact-map", estimator="")
    assert log.follower["exact_force"].max() < 15.0
    jump = np.diff(log.follower["desired_position"])
    assert np.abs(jump).max() <= 0.25e-3 + 1e-9


def test_noise_that_is_known_counts_as_no_contact_from_the_first_sample_on(tmp_path: Path) -> None:
    specification = make_robot("hunt-crossley", seed=0).specification
    settings = SessionSettings(calibration=calibration(tmp_path, sensor_lag=0.0, force_noise=0.1))
    assert calibrated(specification, settings).contact_floor == pytest.approx(0.6)
    quiet = SessionSettings(calibration=calibration(tmp_path, sensor_lag=0.0, force_noise=1e-3))
    assert calibrated(specification, quiet).contact_floor == 0.05


@pytest.mark.long
def test_a_shadow_predicts_at_the_tip(tmp_path: Path) -> None:
    series = 3000.0
    errors = {}
    for path in ("", calibration(tmp_path, series_stiffness=series)):
        settings = shadow_settings(SessionSettings(**SIMPLE | {"calibration": path}))  # type: ignore[arg-type]
        watching, output = Shadow(pressing(Mounted("hunt-crossley", stiffness=series)), settings, 5), []
        for tick in range(3500):
            watching.pass_time(min(tick, 1))
            record, telemetry, *_ = watching.tick(Tick(tick * MS, MS))
            output.append((record.position, telemetry.position, watching.follows.sample))
        tips = [abs(hand - exact.exact_position) for hand, _, exact in output]
        learnt = watching.follows.state.learner.learnt().model
        errors[bool(path)] = max(tips[1000:]), math.nan if learnt is None else learnt.parameters[0]
        assert all(hand == tip for hand, tip, _ in output)
    # The hand is at the tip, and what is learnt is the material's alone.
    assert errors[True][0] < 0.25 * errors[False][0]
    assert errors[True][1] == pytest.approx(1.2 * errors[False][1], rel=0.1)


def pressing(robot: Mounted) -> MovedRobot:
    surface = robot.robot.surface
    return MovedRobot(robot, lambda time: surface + 0.004 * math.sin(4.0 * time) + robot.give)


@pytest.mark.parametrize(
    ("known", "message"),
    [
        ({}, "holds neither bias, tool, lag nor series stiffness"),
        ({"sensor_lag": 0.08}, r"has a sensor lag of 0.08 s: a session mends at most 0.05 s"),
        ({"series_stiffness": 1000.0}, r"gives way by 15 mm under 15 N: at most 5 mm"),
        ({"force_bias": (0.0, 0.0, 900.0), "tool_mass": 0.1}, r"has a force bias of 900 N, and the robot's sensor"),
        ({"tool_mass": 0.3, "approach_gravity": -9.8}, r"m/s\^2 of gravity along the approach, and the robot"),
    ],
)
def test_one_that_does_not_fit_is_refused_in_one_line(tmp_path: Path, known: dict[str, Any], message: str) -> None:
    specification = replace(make_robot("foam", seed=0).specification, sensor_range=70.0, gravity=9.81, tool_mass=0.1)
    settings = SessionSettings(calibration=calibration(tmp_path, **known))
    with pytest.raises(SettingError, match=message) as refused:
        calibrated(specification, settings)
    assert "\n" not in str(refused.value)
    assert "sensor.toml" in str(refused.value)


def test_a_file_that_is_not_there_is_refused_where_the_robot_is() -> None:
    settings = SessionSettings(calibration="nowhere.toml")  # the leader's machine has no such file either
    with pytest.raises(RecordingError, match=r"nowhere.toml.*cannot be read"):
        run(Mounted("hunt-crossley"), 0.1, calibration=settings.calibration)


# --- in space ---------------------------------------------------------------------------------------------------------


class Offset(CommandedInSpace):
    offset: tuple[float, float, float]

    def seen(self, sample: SpatialSample) -> SpatialSample:
        return sample._replace(force=tuple(a + b for a, b in zip(sample.force, self.offset, strict=True)))


def in_space(path: str, offset: tuple[float, float, float], ticks: int = 4500) -> list[Any]:
    settings = SessionSettings(scene="plane", fusion="none", displacement=0.0, turn=0.0, calibration=path)
    scene = make_scene("plane")
    driven, output = Offset(make_spatial_robot(settings, scene), settings, scene.surface, scene.nominal), []
    driven.offset = offset
    x, y, z = driven.sample.exact_place
    for tick in range(ticks):
        exact = driven.sample.exact_force
        outputs = driven.tick((x, y, z if tick < 1000 else max(z - 3e-5 * (tick - 1000), -0.004)))
        output.append((outputs.telemetry, outputs.telemetry.space, exact))
    return output


def test_in_space_an_offset_of_known_size_is_found_where_it_was_taken_for_contact(tmp_path: Path) -> None:
    offset = (2.5, 0.0, 0.0)  # beside that of the simulated arm
    path = calibration(tmp_path, force_bias=(0.0, 0.0, 2.8), tool_mass=0.1)
    without, with_it = in_space("", offset, 900), in_space(path, offset)

    def felt(said: list[Any]) -> Any:
        return np.array([(space.force_x, space.force_y, space.force_z) for _, space, _ in said[600:900]])

    assert np.abs(felt(with_it)).max() < 0.15
    assert felt(without).mean(axis=0) == pytest.approx((2.6, -0.15, 0.3), abs=0.1)  # no such offset can be: contact
    assert math.hypot(*with_it[-1][2]) > 1.0  # it presses
    assert with_it[-1][0].force == pytest.approx(math.hypot(*with_it[-1][2]), abs=0.2)


@pytest.mark.long  # a shadow's are, and those along a line
def test_in_space_lag_and_compliance_are_used_along_the_normal(tmp_path: Path) -> None:
    path = calibration(tmp_path, sensor_lag=0.004, series_stiffness=10_000.0)
    settings = SessionSettings(scene="plane", calibration=path)
    scene = make_scene("plane")
    probe = ProbeInSpace(scene.surface, scene.nominal)
    state = follower.start(make_spatial_robot(settings, scene).specification, settings, probe=probe)
    assert state.memory["compliance"].item() == pytest.approx(1e-4)
    assert state.felt_room == 5
    assert state.memory["zero"].item() == 0.0
    assert in_space(path, (0.0, 0.0, 0.0))[-1][0].status == Status.FOLLOWING
