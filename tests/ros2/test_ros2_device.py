"""A haptic device on a ROS 2 graph: a node of another implementation in a process of its own, through a real router."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
from ros2_node import OtherNode, other_node
from ros2_router import Router, router, wait_until

from foretouch.devices.device import LEAST_DAMPING
from foretouch.errors import InputError, SettingError
from foretouch.link import free_endpoint
from foretouch.ros2.device import RosDevice, SpatialRosDevice, make_device
from foretouch.session import SessionSettings

pytest.importorskip("zenoh_ros2_sdk")
pytestmark = pytest.mark.network

NODE, UP, NONE = "hand", [0.0, 0.0, 2.0], [0.0, 0.0, 0.0]


@contextmanager
def device_at(hub: Router, scene: str = "", told: str = "domain=5") -> Iterator[Any]:
    settings = SessionSettings().device
    made = make_device(SimpleNamespace(operator=f"ros2@{hub.endpoint},{told}", scene=scene, device=settings), None)
    try:
        yield made
    finally:
        made.close()


def reads(device: RosDevice, position: float) -> bool:
    """Whether the hand is there; rendering goes on meanwhile."""
    device.render(2.0)
    shown = device.read(time.monotonic_ns())
    return math.isnan(shown) if math.isnan(position) else abs(shown - position) < 1e-6


def test_down_is_in_and_a_force_pushes_up_in_the_frame_of_the_pose(hub: Router, node: OtherNode) -> None:
    with device_at(hub) as device:
        assert isinstance(device, RosDevice)
        assert (device.name, device.closed_loop, device.real_time) == ("ros2", True, True)
        wait_until(lambda: reads(device, 0.0))  # where the hand is now
        node.set(z=0.19)
        wait_until(lambda: reads(device, 0.01))
        assert device.render(2.0) == 2.0
        wait_until(lambda: (device.render(2.0), node.got() == UP)[1])
        said = node.says()["last"]
        assert (said["frame"], said["torque"]) == ("base", NONE)
        assert device.render(-1.0) == -1.0  # it can draw the hand in
        assert device.render(1e3) == device.specification.force_limit
        assert device.render(math.nan) == 0.0
        ours = {(token.split("/")[5], token.split("/")[9]) for token in hub.tokens if "/foretouch_device/%" in token}
        assert ours == {("MS", "%measured_cp"), ("MP", "%body%servo_cf")}


def test_a_silent_pose_is_no_number_and_no_force(hub: Router, node: OtherNode) -> None:
    with device_at(hub) as device:
        wait_until(lambda: reads(device, 0.0))
        for wrong in ({"pose": False}, {"frame": "tool"}, {"frozen": True}, {"z": math.nan}):
            node.set(**wrong)
            wait_until(lambda: reads(device, math.nan))
            assert device.render(2.0) == 0.0
            wait_until(lambda: (device.render(2.0), node.got() == NONE)[1])
            node.set(pose=True, frame="base", frozen=False, z=0.2)
            wait_until(lambda: reads(device, 0.0))
        assert device.render(2.0) == 2.0


def test_poses_that_are_refused_are_said_once(hub: Router, node: OtherNode, capsys: pytest.CaptureFixture[str]) -> None:
    with device_at(hub) as device:
        wait_until(lambda: reads(device, 0.0))
        for frame in ("tool", "base", "tool"):
            node.set(frame=frame)
            wait_until(lambda: reads(device, 0.0 if frame == "base" else math.nan))  # noqa: B023
    said = "operator: /measured_cp is in the frame 'tool', and not in 'base': the hand gets no force and counts as not"
    assert capsys.readouterr().err == f"{said} moved\n"


@pytest.mark.long
def test_where_router_or_node_is_gone_no_force_is_given_until_it_is_back() -> None:
    endpoint = free_endpoint()
    with router(endpoint) as hub:
        made = device_at(hub)
        with other_node("hand", endpoint) as node:
            device = made.__enter__()
            wait_until(lambda: (device.render(2.0), node.got() == UP)[1])
            node.process.kill()
            wait_until(lambda: reads(device, math.nan))
            assert device.render(2.0) == 0.0
        with other_node("hand", endpoint) as node:  # another process of the same name
            node.set(z=0.19)
            wait_until(lambda: reads(device, 0.01))
            wait_until(lambda: (device.render(2.0), node.got() == UP)[1])
            hub.close()
            wait_until(lambda: reads(device, math.nan))
            begun = time.monotonic()
            given = [device.render(2.0) for _ in range(100)]
            assert set(given) == {0.0}
            assert time.monotonic() - begun < 2.0  # no call waits for it
            assert node.got() == UP  # no zero reaches a node without a router
            with router(endpoint) as hub:
                wait_until(lambda: reads(device, 0.01))
                wait_until(lambda: (device.render(2.0), node.got() == UP)[1])
                made.__exit__(None, None, None)
                wait_until(lambda: node.got() == NONE, 2.0)


def test_the_force_ends_where_nobody_renders_and_at_the_end(hub: Router, node: OtherNode) -> None:
    with device_at(hub) as device:
        wait_until(lambda: node.got() == NONE)  # before anything was rendered
        wait_until(lambda: (device.render(2.0), node.got() == UP)[1])
        time.sleep(0.5)  # a loop that hangs
        assert node.got() == NONE
        wait_until(lambda: (device.render(2.0), node.got() == UP)[1])
    wait_until(lambda: node.got() == NONE, 2.0)
    heard = node.says()["heard"]
    wait_until(lambda: not any("foretouch_device" in token for token in hub.tokens))
    assert device.render(2.0) == 0.0
    assert device.read(time.monotonic_ns()) <= 0.0
    device.close()
    time.sleep(0.1)
    assert node.says()["heard"] == heard


def test_in_a_scene_it_is_in_the_frame_of_its_pose(hub: Router, node: OtherNode) -> None:
    with device_at(hub, "plane", "domain=5,frame=base") as device:
        assert isinstance(device, SpatialRosDevice)
        wait_until(lambda: device.read(time.monotonic_ns()) == pytest.approx((0.3, 0.1, 0.2)))

        def gets(force: tuple[float, float, float], expected: list[float]) -> bool:
            device.render(force)
            return bool(node.got() == pytest.approx(expected))

        wait_until(lambda: gets((1.0, -2.0, 0.5), [1.0, -2.0, 0.5]))
        limit = device.specification.force_limit
        wait_until(lambda: gets((0.0, -30.0, 40.0), [0.0, -0.6 * limit, 0.8 * limit]))
        wait_until(lambda: gets((0.0, math.nan, 1.0), NONE))
        node.set(pose=False)
        wait_until(lambda: all(map(math.isnan, device.read(time.monotonic_ns()))))


def test_the_damping_is_the_least_where_nobody_states_it(hub: Router, node: OtherNode) -> None:
    name = f"ros2@{hub.endpoint},domain=5"
    settings = SimpleNamespace(operator=name, scene="", device=SessionSettings(operator="force-dimension").device)
    device = make_device(settings, None)
    assert device.specification.damping == LEAST_DAMPING
    assert device.specification.pulls
    device.close()


def test_poses_that_come_too_seldom_are_refused(hub: Router, node: OtherNode) -> None:
    node.set(period=0.03)
    with pytest.raises(SettingError, match=r"/measured_cp comes [23]\d times a second: have the device's node send it"):
        make_device(SimpleNamespace(operator=f"ros2@{hub.endpoint},domain=5", scene="", device=None), None)


def test_a_wrench_that_nobody_takes_is_refused(hub: Router, node: OtherNode) -> None:
    told = f"ros2@{hub.endpoint},domain=5,wrench=servo_cf"
    with pytest.raises(SettingError, match=r"nobody listens to /servo_cf \(geometry_msgs/msg/WrenchStamped\): name"):
        make_device(SimpleNamespace(operator=told, scene="", device=None), None)


def test_in_is_along_any_axis_of_the_pose(hub: Router, node: OtherNode) -> None:
    with device_at(hub, told="domain=5,in=z") as device:
        wait_until(lambda: reads(device, 0.0))
        node.set(z=0.21)
        wait_until(lambda: reads(device, 0.01))
        wait_until(lambda: (device.render(2.0), node.got() == [0.0, 0.0, -2.0])[1])
    with device_at(hub, told="domain=5,in=-x") as device:
        wait_until(lambda: reads(device, 0.0))
        wait_until(lambda: (device.render(2.0), node.got() == [2.0, 0.0, 0.0])[1])


def test_what_is_missing_is_one_line(hub: Router, node: OtherNode) -> None:
    node.set(pose=False)
    for told, rule in (
        (
            f"ros2@{hub.endpoint},domain=6",
            r"nothing on /measured_cp \(geometry_msgs/msg/PoseStamped\) within 3 s: start",
        ),
        (f"ros2@{hub.endpoint},target=/a", "'target=/a' is not understood: .* of pose, wrench, frame, in, namespace"),
        (f"ros2@{free_endpoint()}", "no ROS 2 router at"),
        (f"ros2@{hub.endpoint},in=down", "in must be the way into the material in the pose's frame, one of x, -x, y"),
    ):
        with pytest.raises((InputError, SettingError), match=rule):
            make_device(SimpleNamespace(operator=told, scene="", device=SessionSettings().device), None)
