"""The standard ROS 2 types beside our own: the same motion, force and images, for tools that know only those."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

from foretouch.messages import (
    CameraImage,
    FixtureBelief,
    FollowerSpace,
    LeaderState,
    Message,
    ModelUpdate,
    Telemetry,
)
from foretouch.recordings.cdr import HEADER
from foretouch.recordings.contact_model_msg import CONTACT_MODEL_MSG, CONTACT_MODEL_TYPE, contact_model, number_array

__all__ = ["BESIDE", "STANDARD", "StandardTopic"]


@dataclass(frozen=True)
class StandardTopic:
    """One topic of a standard ROS 2 type."""

    name: str
    type_name: str
    schema: str


_SEPARATOR = "=" * 80
_HEADER_SCHEMA = f"""{_SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINT_STATE_SCHEMA = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_HEADER_SCHEMA}"""
WRENCH_SCHEMA = f"""std_msgs/Header header
geometry_msgs/Wrench wrench
{_HEADER_SCHEMA}{_SEPARATOR}
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
{_SEPARATOR}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
POSE_SCHEMA = f"""std_msgs/Header header
geometry_msgs/Pose pose
{_HEADER_SCHEMA}{_SEPARATOR}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{_SEPARATOR}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{_SEPARATOR}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
_IMAGE_SCHEMA = f"""std_msgs/Header header
string format
uint8[] data
{_HEADER_SCHEMA}"""
_MODEL_SCHEMA = f"{CONTACT_MODEL_MSG}{_HEADER_SCHEMA}"
_ARRAY_SCHEMA = f"""std_msgs/MultiArrayLayout layout
float64[] data
{_SEPARATOR}
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
{_SEPARATOR}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
"""

WRENCH: Final = StandardTopic("/follower/wrench", "geometry_msgs/msg/WrenchStamped", WRENCH_SCHEMA)
FOLLOWER_JOINTS: Final = StandardTopic("/follower/joint_states", "sensor_msgs/msg/JointState", JOINT_STATE_SCHEMA)
LEADER_JOINTS: Final = StandardTopic("/leader/joint_states", "sensor_msgs/msg/JointState", JOINT_STATE_SCHEMA)
PROBE: Final = StandardTopic("/follower/probe", "geometry_msgs/msg/PoseStamped", POSE_SCHEMA)
FIXTURE: Final = StandardTopic("/camera/fixture/pose", "geometry_msgs/msg/PoseStamped", POSE_SCHEMA)
IMAGE: Final = StandardTopic("/camera/image/compressed", "sensor_msgs/msg/CompressedImage", _IMAGE_SCHEMA)
MODEL: Final = StandardTopic("/follower/contact_model", CONTACT_MODEL_TYPE, _MODEL_SCHEMA)
NUMBERS: Final = StandardTopic("/follower/contact_model/values", "std_msgs/msg/Float64MultiArray", _ARRAY_SCHEMA)
STANDARD: Final = (WRENCH, FOLLOWER_JOINTS, LEADER_JOINTS, PROBE, FIXTURE, IMAGE, MODEL, NUMBERS)


def _text(value: str) -> bytes:
    """A CDR string, length first, with zeros behind it up to the next multiple of 4 bytes."""
    data = value.encode() + b"\0"
    return struct.pack("<I", len(data)) + data + bytes(-len(data) % 4)


# Frames and the joint have fixed names of fixed length, so that everything between the numbers is constant.
# Behind the encapsulation header: stamp 8 bytes, frame_id 12 bytes ("probe" or "world" and NUL, padded), and so on.
_FRAME, _WORLD = _text("probe"), _text("world")
_JOINT = _FRAME + struct.pack("<I", 1) + _text("probe") + struct.pack("<I", 1)  # frame_id, one name, one position
_ONE = struct.pack("<II", 1, 0)  # count 1, padded to the next multiple of 8
_NONE_AND_ONE = struct.pack("<II", 0, 1)  # no velocity, one effort
_JPEG = _text("camera") + _text("jpeg")
_wrench = struct.Struct(f"<4siI{len(_FRAME)}s4x6d")
_joint_state = struct.Struct(f"<4siI{len(_JOINT)}sd8sd8sd")
_joint_at_rest = struct.Struct(f"<4siI{len(_JOINT)}sd8sd")
_pose = struct.Struct(f"<4siI{len(_WORLD)}s4x7d")
_image = struct.Struct(f"<4siI{len(_JPEG)}sI")
LARGEST_SECOND = 2**31 - 1


def _stamp(time_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds; a clock beyond what ROS 2 can say stays at the largest second."""
    second, nanosecond = divmod(time_ns, 1_000_000_000)
    return min(second, LARGEST_SECOND), nanosecond


def wrench(time_ns: int, force: float) -> bytes:
    """CDR bytes of a WrenchStamped with ``force`` [N] along z and nothing else."""
    return _wrench.pack(HEADER, *_stamp(time_ns), _FRAME, 0.0, 0.0, force, 0.0, 0.0, 0.0)


def joint_state(time_ns: int, position: float, velocity: float | None, force: float) -> bytes:
    """CDR bytes of a JointState of one joint: position [m], velocity [m/s] or none, effort [N]."""
    if velocity is None:
        return _joint_at_rest.pack(HEADER, *_stamp(time_ns), _JOINT, position, _NONE_AND_ONE, force)
    return _joint_state.pack(HEADER, *_stamp(time_ns), _JOINT, position, _ONE, velocity, _ONE, force)


def pose(time_ns: int, place: Sequence[float], turn: Sequence[float] = (0.0, 0.0, 0.0)) -> bytes:
    """CDR bytes of a PoseStamped in the world: a place [m] and a rotation vector [rad]."""
    return _pose.pack(HEADER, *_stamp(time_ns), _WORLD, *place, *quaternion(turn))


def pose_on_a_line(time_ns: int, position: float) -> bytes:
    """CDR bytes of the probe's pose in a session along a line, at a position [m].

    z of the world points out of the surface, as the force does: deeper is down.
    """
    return pose(time_ns, (0.0, 0.0, -position))


def quaternion(turn: Sequence[float]) -> tuple[float, float, float, float]:
    r"""The quaternion (x, y, z, w) of a rotation vector [rad].

    .. math:: q = \left(\frac{\sin(\theta / 2)}{\theta} v, \cos(\theta / 2)\right), \quad \theta = \lVert v \rVert
    """
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    share = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return share * turn[0], share * turn[1], share * turn[2], math.cos(0.5 * angle)


def compressed_image(time_ns: int, jpeg: bytes) -> bytes:
    """CDR bytes of a CompressedImage."""
    return _image.pack(HEADER, *_stamp(time_ns), _JPEG, len(jpeg)) + jpeg


Packed: TypeAlias = tuple[tuple[StandardTopic, bytes], ...]


def _of_telemetry(said: Message) -> Packed:
    assert isinstance(said, Telemetry)
    joints = joint_state(said.time_ns, said.position, said.velocity, said.force)
    return (WRENCH, wrench(said.time_ns, said.force)), (FOLLOWER_JOINTS, joints)


def _of_leader(said: Message) -> Packed:
    assert isinstance(said, LeaderState)
    return ((LEADER_JOINTS, joint_state(said.time_ns, said.position, said.velocity, said.rendered_force)),)


def _of_model(said: Message) -> Packed:
    assert isinstance(said, ModelUpdate)
    return (MODEL, contact_model(said, _stamp(said.time_ns), "probe")), (NUMBERS, number_array(said))


def _of_space(said: Message) -> Packed:
    assert isinstance(said, FollowerSpace)
    return ((PROBE, pose(said.time_ns, (said.place_x, said.place_y, said.place_z))),)


def _of_belief(said: Message) -> Packed:
    assert isinstance(said, FixtureBelief)
    return ((FIXTURE, pose(said.time_ns, said.pose[:3], said.pose[3:])),) if len(said.pose) == 6 else ()


def _of_image(said: Message) -> Packed:
    assert isinstance(said, CameraImage)
    return ((IMAGE, compressed_image(said.time_ns, said.jpeg)),) if said.jpeg else ()


BESIDE: Final[dict[type[Message], Callable[[Message], Packed]]] = {
    Telemetry: _of_telemetry,
    LeaderState: _of_leader,
    ModelUpdate: _of_model,
    FollowerSpace: _of_space,
    FixtureBelief: _of_belief,
    CameraImage: _of_image,
}
"""What is written beside a message, topic by topic; an image that the stream dropped has nothing beside it."""
