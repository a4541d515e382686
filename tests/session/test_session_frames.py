"""Machines that count otherwise than the session does."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from foretouch.devices import GRIPS, UNKNOWN_REACH, BrowserOperator, Device, DeviceSpecification, Hand, ScriptedOperator
from foretouch.errors import SettingError
from foretouch.quantities import Frame, Pose, SpatialFrame
from foretouch.robot import FaultySensor, RcmArm, Robot, RobotSample, SensorFault, make_robot
from foretouch.session import SessionSettings, framed_device, framed_robot, inverse, make_operator, simulate
from foretouch.session.operators import reach_of
from foretouch.session.spatial import make_scene, make_spatial_robot
from foretouch.session.workspace import browser_operator


class MirroredArm(Robot):
    def __init__(self, arm: RcmArm) -> None:
        self._arm = arm
        low, high = arm.specification.workspace
        self.specification = dataclasses.replace(
            arm.specification, workspace=(-high, -low), gravity=-arm.specification.gravity
        )

    def read(self) -> RobotSample:
        return self._turned(self._arm.read())

    def exchange(self, desired_position: float) -> RobotSample:
        return self._turned(self._arm.exchange(-desired_position))

    def _turned(self, sample: RobotSample) -> RobotSample:
        return sample._replace(
            position=-sample.position,
            acceleration=-sample.acceleration,
            exact_position=-sample.exact_position,
            commanded_position=-sample.commanded_position,
        )


class MirroredDevice(Device):
    name = "mirrored"
    closed_loop = True

    def __init__(self, device: Device) -> None:
        self._device = device

    @property
    def specification(self) -> DeviceSpecification | None:
        return self._device.specification

    @property
    def intention(self) -> float:
        return -self._device.intention

    @property
    def exact_position(self) -> float:
        return -self._device.exact_position

    def read(self, now_ns: int) -> float:
        return -self._device.read(now_ns)

    def render(self, force: float) -> float:
        return self._device.render(force)


COMPARED = ("rendered_force", "predicted_force", "position", "hand_position", "intended_position", "energy")


def session(settings: SessionSettings, *, mirrored: bool = False, duration: float = 3.0) -> Any:
    """A session with machines that count as the session does, or that are mirrored."""
    arm = make_robot("hunt-crossley", seed=1)
    operator = make_operator(dataclasses.replace(settings, leader_frame="0,1", follower_frame="0,1"), robot=arm)
    machines = (MirroredDevice(operator), MirroredArm(arm)) if mirrored else (operator, arm)
    return simulate(settings, duration=duration, operator=machines[0], robot=machines[1]).log


@pytest.mark.long
def test_mirrored_machines_give_the_same_session_to_the_last_bit_where_that_is_declared() -> None:
    settings = SessionSettings(material="hunt-crossley", grip="normal", seed=1)
    plain = session(settings)
    turned = session(dataclasses.replace(settings, leader_frame="0,-1", follower_frame="0,-1"), mirrored=True)
    assert plain.leader["rendered_force"].max() > 0.2
    for name in COMPARED:
        np.testing.assert_array_equal(plain.leader[name], turned.leader[name], err_msg=name)
    for name in ("position", "force", "exact_force", "desired_position"):
        np.testing.assert_array_equal(plain.follower[name], turned.follower[name], err_msg=name)
    settings = SessionSettings(material="hunt-crossley", grip="normal", seed=1)
    assert session(settings, mirrored=True, duration=2.0).leader["rendered_force"].max() < 0.01


@pytest.mark.long
def test_machines_of_the_package_count_as_they_are_told() -> None:
    """Shifted and mirrored by what is no round number: the same but for the rounding of positions to 1e-17 m."""

    def run(**frames: str) -> Any:
        settings = SessionSettings(material="hunt-crossley", grip="normal", seed=1, **frames)
        arm = make_robot("hunt-crossley", seed=1)
        reach = arm.material
        return simulate(
            settings,
            duration=3.0,
            operator=make_operator(settings, surface=reach.surface, press_depth=reach.press_depth, say=print),
            robot=framed_robot(arm, inverse(settings.follower_frame)),
        ).log

    plain, other = run(), run(leader_frame="0.0213,-1", follower_frame="-0.117,-1")
    assert plain.leader["rendered_force"].max() > 0.2
    np.testing.assert_allclose(plain.leader["hand_position"], other.leader["hand_position"], atol=5.1e-5)
    np.testing.assert_allclose(plain.leader["rendered_force"], other.leader["rendered_force"], atol=0.12)


def test_a_frame_turns_the_machine_s_numbers_and_no_force() -> None:
    frame = Frame(0.02, -1)
    arm = make_robot("hunt-crossley", seed=0)
    robot = framed_robot(arm, frame)
    low, high = arm.specification.workspace
    assert robot.specification.workspace == (frame.inside(high), frame.inside(low))
    assert robot.specification.workspace[0] < robot.specification.workspace[1]
    assert robot.specification.gravity == -arm.specification.gravity
    for _ in range(100):
        inside = robot.exchange(0.019)
    own = arm.read()
    assert own.commanded_position == pytest.approx(0.001, abs=1e-4)
    assert inside.commanded_position == frame.inside(own.commanded_position)
    assert inside.position == frame.inside(own.position)
    assert inside.acceleration == -own.acceleration
    assert inside.sensor_force == own.sensor_force
    assert robot.specification.force_limit == arm.specification.force_limit
    for _ in range(50):
        held = robot.exchange(math.nan).commanded_position
    assert held == pytest.approx(0.019, abs=1e-6)
    robot.close()


def test_what_counts_alike_is_left_as_it_is_and_the_mouse_is_found_behind_hand_and_frame() -> None:
    device, robot = ScriptedOperator(0.01, 0.005), make_robot("hunt-crossley", seed=0)
    assert framed_device(device, Frame()) is device
    assert framed_robot(robot, Frame()) is robot
    mouse = BrowserOperator(ScriptedOperator(0.01, 0.005))
    hand = Hand(mouse, GRIPS["normal"], DeviceSpecification(damping=2.0))
    for device in (mouse, hand, framed_device(mouse, Frame(0.1, -1)), framed_device(hand, Frame(0.1, -1))):
        assert browser_operator(device) is mouse
    framed = framed_device(hand, Frame(0.1, -1))
    assert (framed.name, framed.closed_loop, framed.clutched) == ("browser", True, False)
    assert math.isnan(framed.exact_position)
    assert framed.read(0) == pytest.approx(0.1)
    assert framed.intention == pytest.approx(0.1)
    assert framed.render(3.0) == 3.0
    assert browser_operator(ScriptedOperator(0.01, 0.005)) is None


@pytest.mark.parametrize("frame", [Frame(), Frame(0.25, 1), Frame(0.25, -1), Frame(-0.5, -1)])
def test_the_inverse_of_a_frame_undoes_it(frame: Frame) -> None:
    back = inverse(frame)
    for position in (-0.125, 0.0, 0.03125):
        assert back.inside(frame.inside(position)) == position
        assert back.outside(frame.outside(position)) == position


def test_a_frame_in_space_is_a_pose_that_its_inverse_undoes() -> None:
    frame = SpatialFrame((0.4, -0.1, 0.2), (0.3, -0.2, 1.4))
    assert SpatialFrame.from_text("frame", str(frame)) == frame
    back, pose = inverse(frame), Pose.from_rotation_vector(frame.rotation, frame.place)
    for place in ((0.0, 0.0, 0.0), (0.1, 0.2, -0.3)):
        assert frame.inside(place) == pytest.approx(pose.apply(place), abs=1e-15)
        for one, other in ((frame, back), (back, frame)):
            assert other.inside(one.inside(place)) == pytest.approx(place, abs=1e-15)
            assert other.inside(place) == pytest.approx(one.outside(place), abs=1e-15)
    seen = (0.05, 0.0, 0.01, 0.1, 0.2, -0.3)
    assert back.pose_inside(frame.pose_inside(seen)) == pytest.approx(seen, abs=1e-12)


def test_machines_in_space_are_translated_forces_and_the_fixture_too() -> None:
    settings = SessionSettings(scene="hill", seed=2)
    frame, scene = SpatialFrame((0.4, -0.1, 0.2), (0.3, -0.2, 1.4)), make_scene("hill")
    plain = make_spatial_robot(settings, scene)
    framed = make_spatial_robot(dataclasses.replace(settings, follower_frame=frame), scene)
    again = framed_robot(framed, frame)
    for tick in range(600):  # down, into the hill
        place = (0.0, 0.0, 0.05 - 1e-4 * tick)
        right, own, seen = plain.exchange(place), framed.exchange(frame.outside(place)), again.read()
        assert own.place == pytest.approx(frame.outside(right.place), abs=1e-12)
        for name in ("place", "force", "exact_force", "exact_place", "fixture"):
            assert getattr(seen, name) == pytest.approx(getattr(right, name), abs=1e-6), name
    assert right.exact_force[2] > 0.1
    low, high = again.reach
    assert all(a <= b for a, b in zip(low, high, strict=True))
    assert again.fresh is plain.fresh is False
    assert plain.read().place == right.place


@pytest.mark.parametrize("text", ["nonsense", "0", "0,2", "0,0.5", "2,1", "nan,1", "0,1,1"])
def test_a_frame_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(SettingError, match=r"^leader_frame = .*: must be ORIGIN,DIRECTION: metres within 1, "):
        SessionSettings(leader_frame=text)


def test_an_operator_learns_surface_and_depth_from_the_robot_whatever_stands_about_it() -> None:
    settings = SessionSettings(material="hunt-crossley", follower_frame="-0.117,-1")
    arm = make_robot("hunt-crossley", surface=0.013)
    built_to = framed_robot(FaultySensor(arm, SensorFault("nan", 9.0), seed=0), inverse(settings.follower_frame))
    known = reach_of(built_to, settings)
    assert known.surface == pytest.approx(0.013, abs=1e-15)
    assert known.press_depth == arm.material.press_depth
    assert reach_of(arm, settings).surface == settings.follower_frame.inside(0.013)  # it counts as it does by itself
    assert reach_of(None, settings).surface == arm.material.surface
    assert reach_of(framed_robot(MirroredArm(arm), settings.follower_frame), settings) is UNKNOWN_REACH


def test_an_operator_needs_no_more_than_settings_and_speaks_on_the_error_stream(
    capsys: pytest.CaptureFixture[str],
) -> None:
    settings = SessionSettings(material="hunt-crossley", seed=3)
    arm = make_robot("hunt-crossley")
    told = {"surface": arm.surface, "press_depth": arm.material.press_depth}
    places = [
        [operator.read(tick * 10_000_000) for tick in range(200)]
        for operator in (make_operator(settings), make_operator(settings, robot=arm), make_operator(settings, **told))
    ]
    assert places[0] == places[1] == places[2]
    assert max(places[0]) > arm.surface
    assert capsys.readouterr() == ("", "")
    make_operator(dataclasses.replace(settings, operator="browser"), robot=MirroredArm(arm))
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("operator: the robot does not say where its surface is")
