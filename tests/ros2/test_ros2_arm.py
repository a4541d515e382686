"""An arm on a ROS 2 graph: a node of another implementation in a process of its own, through a real router."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
from ros2_node import OtherNode
from ros2_router import Router, wait_until

from foretouch.errors import ForetouchError, InputError, SettingError
from foretouch.link import free_endpoint
from foretouch.robot.along_line import AlongLine
from foretouch.robot.drivers import DrivenArm, LostArmError
from foretouch.ros2.arm import make_arm

pytest.importorskip("zenoh_ros2_sdk")
pytestmark = pytest.mark.network

NODE, TOLD = "arm", "wrench=/ft/wrench,domain=5"


@contextmanager
def arm_at(hub: Router, told: str = TOLD, scene: str = "plane") -> Iterator[DrivenArm]:
    made = make_arm(SimpleNamespace(robot=f"ros2@{hub.endpoint},{told}", scene=scene))
    assert isinstance(made, DrivenArm)
    try:
        yield made
    finally:
        made.close()


def lowered(arm: DrivenArm, height: float) -> None:
    """Command a way down at 20 mm/s, in real time."""
    z = arm.read().place[2]
    while z > height:
        z = max(z - 4e-5, height)
        arm.exchange((0.3, 0.1, z))
        time.sleep(2e-3)


def shows(arm: DrivenArm, force: float) -> bool:
    """Whether the arm, held where it is told to be, comes to show a force, or none at all where that is NaN."""
    felt = arm.exchange(arm.commanded).force[2]
    return math.isnan(felt) if math.isnan(force) else abs(felt - force) < 0.1


def test_another_nodes_arm_is_pressed_and_told_what_a_controller_wants(hub: Router, node: OtherNode) -> None:
    with arm_at(hub) as arm:
        assert arm.read().place == pytest.approx((0.3, 0.1, 0.2))
        ours = [token.split("/") for token in hub.tokens if "foretouch_robot" in token]
        assert {(parts[5], parts[9]) for parts in ours if len(parts) > 9} == {
            ("MS", "%current_pose"),
            ("MS", "%ft%wrench"),
            ("MS", "%joint_states"),
        }  # who has commanded nothing offers no target: a controller may refuse two
        node.set(z=0.198)  # it is moved by hand, and begins from there
        wait_until(lambda: arm.read().place[2] == pytest.approx(0.198))
        arm.commanded = arm.read().place
        lowered(arm, 0.185)
        wait_until(lambda: shows(arm, 5.0))
        said = node.says()
        assert said["heard"] > 300
        target = said["last"]
        assert target["place"] == pytest.approx([0.3, 0.1, 0.185])
        assert target["turn"] == [0.0, 1.0, 0.0, 0.0]
        assert target["frame"] == "base"
        assert -1_000_000 < target["late"] < 2_000_000_000
        offered = [token for token in hub.tokens if "foretouch_robot" in token and "/MP/" in token]
        assert [(token.split("/")[9], token.rpartition("/")[2]) for token in offered] == [
            ("%target_pose", "::,1:,:,:,,")  # reliable, 1 kept
        ]
        wait_until(lambda: len(arm.exchange(arm.commanded).joints) == 7)
    wait_until(lambda: not any("foretouch_robot" in token for token in hub.tokens))


def test_a_silent_topic_is_a_silent_sensor_until_it_speaks_again(hub: Router, node: OtherNode) -> None:
    with arm_at(hub) as arm:
        lowered(arm, 0.187)
        wait_until(lambda: shows(arm, 3.0))
        for topic in ("wrench", "pose"):
            node.set(**{topic: False})
            wait_until(lambda: shows(arm, math.nan), 0.9)
            node.set(**{topic: True})
            wait_until(lambda: shows(arm, 3.0))
        node.set(frozen=True)  # it says the same measurement again and again
        wait_until(lambda: shows(arm, math.nan), 0.9)
        node.set(frozen=False, stamped=False)  # and here nobody stamps: what comes is new
        wait_until(lambda: shows(arm, 3.0))
        node.set(extra=math.nan)
        wait_until(lambda: shows(arm, math.nan))
        node.set(extra=1.0)
        wait_until(lambda: shows(arm, 4.0))


@pytest.mark.long
def test_a_node_that_dies_in_a_press_ends_the_session_with_one_line(hub: Router, node: OtherNode) -> None:
    with arm_at(hub) as arm:
        lowered(arm, 0.187)
        wait_until(lambda: shows(arm, 3.0))
        node.process.kill()
        node.process.wait(5.0)
        died = time.monotonic()
        with pytest.raises(LostArmError, match="arm on ROS 2 at /target_pose: it has said nothing for 1 s"):
            wait_until(lambda: shows(arm, 1e9), 5.0)
        assert time.monotonic() - died < 2.0


def test_a_wrench_in_the_tools_frame_is_refused_whenever_it_comes(hub: Router, node: OtherNode) -> None:
    with arm_at(hub) as arm:
        wait_until(lambda: shows(arm, 0.0))
        node.set(wrench_frame="tool0")
        wait_until(lambda: shows(arm, math.nan))
        assert arm.says == "/ft/wrench is in the frame 'tool0', and not in 'base' or 'base_link'"
        with pytest.raises(LostArmError, match=r"for 1 s \(/ft/wrench is in the frame 'tool0'"):
            wait_until(lambda: shows(arm, 1e9), 5.0)
    with pytest.raises(
        InputError, match=r"in the frame 'tool0', and not in 'base' or 'base_link': have it .*frame=NAME"
    ):
        make_arm(SimpleNamespace(robot=f"ros2@{hub.endpoint},{TOLD}", scene="plane"))
    with arm_at(hub, f"{TOLD},frame=base+tool0,sign=-1") as arm:  # whoever names it says that its axes are the base's
        node.set(extra=2.0)
        wait_until(lambda: shows(arm, -2.0))


@pytest.mark.long
def test_a_process_that_forgets_to_close_ends_all_the_same(hub: Router, node: OtherNode) -> None:
    made = f"kept = make_arm(SimpleNamespace(robot='ros2@{hub.endpoint},{TOLD}', scene=''))"
    lines = ("from types import SimpleNamespace", "from foretouch.ros2.arm import make_arm", made, "print('made')")
    ended = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, timeout=30)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "made\n", "")


def test_along_a_line_it_begins_where_the_tip_is(hub: Router, node: OtherNode) -> None:
    made = make_arm(SimpleNamespace(robot=f"ros2@{hub.endpoint},{TOLD},reach=0.05", scene=""))
    assert isinstance(made, AlongLine)
    assert made.read().position == 0.0
    assert made.specification.workspace == pytest.approx((-0.05, 0.05))
    made.close()


def test_what_is_missing_is_named(hub: Router, node: OtherNode) -> None:
    with pytest.raises(InputError, match=r"nothing on /wrench \(geometry_msgs/msg/WrenchStamped\) within 3 s: start"):
        make_arm(SimpleNamespace(robot=f"ros2@{hub.endpoint},domain=5", scene=""))


def test_without_a_router_it_is_one_line() -> None:
    with pytest.raises(InputError, match=r"no ROS 2 router at tcp/127.0.0.1:[0-9]+: start one"):
        make_arm(SimpleNamespace(robot=f"ros2@{free_endpoint()}", scene=""))


@pytest.mark.parametrize(
    ("told", "rule"),
    [
        ("ros2@tcp/127.0.0.1:7447,wrnch=/ft", "'wrnch=/ft' is not understood: write it as ros2@ROUTER,KEY=VALUE"),
        ("ros2@tcp/127.0.0.1:7447,tcp/127.0.0.1:7448", "is not understood"),
        ("ros2@wrench=/a,wrench=/b", "'wrench=/b' is not understood"),
        ("ros2@wrench=/ft/*", "wrench must be the name of a topic, such as /follower/wrench, and is '/ft/[*]'"),
        ("ros2@rate=fast", "rate must be a number, and is 'fast'"),
        ("ros2@rate=50", "must lie between 200 and 1000"),
        ("ros2@reach=nan", "must be finite"),
        ("ros2@sign=2", "sign must be 1 where the wrench is what acts on the probe"),
        ("ros2@frame=", "frame must be a name"),
        ("ros2@insecure=maybe", "insecure must be yes or no"),
        ("ros2@tcp/192.0.2.1:7447", "tcp/192.0.2.1:7447 is off this machine, .*: add insecure=yes"),
        ("ros2@tls/127.0.0.1:7447", "keys for a ROS 2 graph are not read here"),
        ("ros2@localhost", "write it as tcp/HOST:PORT"),
        ("ros2@domain=500", "domain = 500: must be 0 to 232, as ROS_DOMAIN_ID"),
        ("ros2@domain=five", r"the domain \(ROS_DOMAIN_ID\) must be a number, and is 'five'"),
        ("ros2@namespace=robot1", "namespace = 'robot1': must be /"),
    ],
)
def test_an_address_that_is_none_is_one_line(told: str, rule: str) -> None:
    with pytest.raises(ForetouchError, match=rule) as error:
        make_arm(SimpleNamespace(robot=told, scene=""))
    assert "\n" not in str(error.value)


def test_the_domain_of_the_environment_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    with pytest.raises(SettingError, match="must be a number, and is 'many'"):
        make_arm(SimpleNamespace(robot="ros2", scene=""))
