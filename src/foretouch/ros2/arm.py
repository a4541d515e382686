"""An arm behind a controller on a ROS 2 graph, which takes the pose that its tip is to have.

As the Cartesian controllers of ``crisp_controllers`` do, whose names and QoS are the usual ones here: they take
``target_pose``, reliable with 1 kept, and follow it with torques; its ``pose_broadcaster`` says ``current_pose``, 250
times a second (``cartesian_controller.cpp`` and ``pose_broadcaster.yaml`` in its sources). The wrench comes from
elsewhere. There was no such arm: **tested against a node of another implementation alone**.
"""

from __future__ import annotations

import math
import time
from typing import Any, Final

from foretouch.errors import InputError
from foretouch.recordings.formats.topics import FOLLOWER_JOINTS, PROBE, WRENCH, Stamped, StandardTopic, pack_stamped
from foretouch.robot.drivers import ArmLink, ArmState, arm_robot
from foretouch.robot.robot import AnyRobot, RobotSpecification, Vector
from foretouch.ros2.graph import Graph, type_of
from foretouch.ros2.keys import NEWEST
from foretouch.ros2.newest import SILENT, GraphAddress, Heard, Newest, await_first

USUAL: Final = {
    "target": "target_pose",
    "pose": "current_pose",
    "wrench": "wrench",
    "joints": "joint_states",
    "frame": "base+base_link",
    "sign": "1",
    "rate": "500",
    "reach": "0.2",
    "force": "15",
    "mass": "4",
}
"""Options of the address: names of the four topics; what ``frame_id`` may be; 1 where the wrench says what acts on the
probe, -1 where it says what the arm exerts; commands a second; how far from where it begins the tip is commanded along
each axis [m]; the contact force that the arm stands in the end [N]; and the mass that moves with its tip [kg]."""

NO_UNIT = 0.01  # A quaternion whose size differs by more from 1 is none
JOINTS_KEPT = 0.5  # Joints that were not heard for so long are not known [s]

OFF_BASE = (
    "have it published in the arm's base frame (for a wrench, force_torque_sensor_broadcaster has a transformer), or "
    "give that frame's name as frame=NAME if its axes are those of the base"
)


class RosArm(ArmLink):
    """The driver: it sends targets, and listens to pose, wrench and joints.

    A state is as old as its wrench; where the pose is missing beside it for 20 ms, as old as the pose, so that an arm
    that has lost either is silent. The orientation that is held is that of the newest pose when the first target is
    sent: who has only watched until then, and turned the tool meanwhile, does not see it turned back at a blow.

    Args:
        graph: Node on the graph, connected; closed with the arm.
        heard: Newest pose, wrench and joints.
        target: Topic of the targets.
        sign: 1 or -1, as of `USUAL`.
        specification: Of the arm.
        reach: How far from where it begins the tip is commanded along each axis [m].

    Raises:
        InputError: No pose or no wrench within 3 s, or one in another frame.
    """

    def __init__(
        self,
        graph: Graph,
        heard: tuple[Newest, Newest, Newest],
        target: StandardTopic,
        sign: float,
        specification: RobotSpecification,
        reach: float,
    ) -> None:
        self.name, self.specification = f"arm on ROS 2 at {target.name}", specification
        self._graph, self._target, self._sign = graph, target, sign
        self._pose, self._wrench, self._joints = heard
        for topic in heard:
            graph.subscribe(topic.topic, topic.take)
        type_of(target)  # computed now, and not in the first tick that commands
        missing = await_first(heard[:2])
        if missing:
            graph.close()
            remedy = OFF_BASE if self._pose.problem or self._wrench.problem else "start what publishes it"
            raise InputError(f"{self.name}: {missing}: {remedy}, and see `ros2 topic info -v`")
        pose = _trusted(self._pose)
        self._orientation: tuple[float, ...] = ()
        self._frame = pose.frame
        x, y, z = pose.values[:3]
        self.reach = (x - reach, y - reach, z - reach), (x + reach, y + reach, z + reach)

    def state(self) -> ArmState | None:
        """The newest state.

        Raises:
            InputError: The newest pose or wrench is in another frame, or no message at all.
        """
        pose, wrench = _trusted(self._pose), _trusted(self._wrench)
        together = wrench.arrival_ns - pose.arrival_ns < 1e9 * SILENT
        x, y, z = pose.values[:3]
        fx, fy, fz = (self._sign * value for value in wrench.values[:3])
        measured_ns = wrench.arrival_ns if together else pose.arrival_ns
        return ArmState(measured_ns, (x, y, z), (fx, fy, fz), self._known_joints())

    def command(self, place: Vector) -> None:
        """Send where the tip should be, with its orientation as it was when commands began.

        Raises:
            InputError: The orientation is none when they are to begin.
        """
        if not self._orientation:
            self._orientation = _orientation(self._pose)
        target = Stamped(time.time_ns(), self._frame, (*place, *self._orientation))
        self._graph.publish(self._target, pack_stamped(self._target.type_name, target), NEWEST)

    def close(self) -> None:
        """Send nothing any more: the controller stays at the last target."""
        self._graph.close()

    def _known_joints(self) -> tuple[float, ...]:
        joints = self._joints.heard
        if joints is None or time.monotonic_ns() - joints.arrival_ns > 1e9 * JOINTS_KEPT:
            return ()
        positions: tuple[float, ...] = joints.values[1]
        return positions if all(map(math.isfinite, positions)) else ()


def _trusted(topic: Newest) -> Heard:
    if topic.problem or topic.heard is None:
        raise InputError(topic.problem)
    return topic.heard


def _orientation(topic: Newest) -> tuple[float, ...]:
    """Quaternion of the newest pose."""
    values = _trusted(topic).values
    if not abs(math.hypot(*values[3:]) - 1.0) < NO_UNIT:
        raise InputError(f"{topic.topic.name} says no orientation, but a quaternion of {values[3:]}")
    return values[3:]


def make_arm(settings: Any) -> AnyRobot[Any, Any]:
    """The robot ``ros2@ROUTER,KEY=VALUE,...`` of the settings.

    Raises:
        SettingError: An address that is none.
        InputError: No router, no pose or no wrench.
        LinkError: The router's endpoint is malformed.
    """
    address = GraphAddress.read("robot", settings.robot, USUAL)
    frames = tuple(filter(None, address.options["frame"].split("+")))
    pose, wrench = Newest(address.topic("pose", PROBE), frames), Newest(address.topic("wrench", WRENCH), frames)
    joints = Newest(address.topic("joints", FOLLOWER_JOINTS))
    if address.options["sign"] not in ("1", "-1"):
        raise address.refuse("sign must be 1 where the wrench is what acts on the probe, or -1 where the arm exerts it")
    if not frames:
        raise address.refuse("frame must be a name that the headers have, or several: frame=base+fr3_link0")
    reach, target = address.number("reach", above=0.0, at_most=1.0), address.topic("target", PROBE)
    specification = RobotSpecification(
        sample_period=1.0 / address.number("rate", at_least=200.0, at_most=1000.0),
        force_limit=address.number("force", above=0.0, at_most=1000.0),
        encoder_resolution=1e-6,
        encoder_noise=1e-5,
        tool_mass=0.0,
        gravity=0.0,
        sensor_noise=0.1,
        accelerometer_noise=0.0,
        sensor_bandwidth=100.0,
        workspace=(-reach, reach),
        moved_mass=address.number("mass", above=0.0, at_most=200.0),
    )
    sign = float(address.options["sign"])
    link = RosArm(address.open("foretouch_robot"), (pose, wrench, joints), target, sign, specification, reach)
    return arm_robot(link, in_space=bool(settings.scene))
