"""What a session's MCAP file holds: the topics, their types, and the two standard ROS 2 types beside our own.

Our own types carry every field of the messages; the reader here uses nothing else. The standard types carry the same
motion and force for tools that know only those.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from foretouch.messages import (
    Choice,
    Command,
    EmergencyStop,
    Handle,
    Hello,
    LeaderState,
    Message,
    ModelUpdate,
    Settings,
    Stop,
    Telemetry,
)
from foretouch.recordings.cdr import HEADER, Layout

__all__ = [
    "COUNTS",
    "FOLLOWER_JOINTS",
    "LEADER_JOINTS",
    "STANDARD",
    "TOPICS",
    "TRUNCATED",
    "WRENCH",
    "StandardTopic",
    "Topic",
    "joint_state",
    "wrench",
]

COUNTS: Final = "foretouch_counts"
"""Name of the metadata record that holds the counters of the session's end."""

TRUNCATED: Final = {"truncated": 1}
"""Counter of a recording that ends before its session did."""


@dataclass(frozen=True)
class Topic:
    """One topic of our own messages."""

    name: str
    type_name: str
    layout: Layout


TOPICS: Final[dict[type[Message], Topic]] = {
    kind: Topic(name, f"foretouch_msgs/msg/{type_name}", Layout(kind))
    for kind, name, type_name in (
        (Telemetry, "/follower/state", "FollowerState"),
        (LeaderState, "/leader/state", "LeaderState"),
        (ModelUpdate, "/follower/model", "ContactModel"),
        (Hello, "/session/hello", "Hello"),
        (Settings, "/session/settings", "Settings"),
        (Choice, "/session/choice", "Choice"),
        (Stop, "/session/stop", "Stop"),
        (EmergencyStop, "/session/emergency", "EmergencyStop"),
        (Handle, "/console/handle", "Handle"),
        (Command, "/leader/command", "Command"),
    )
}


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
_JOINT_STATE_SCHEMA = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_HEADER_SCHEMA}"""
_WRENCH_SCHEMA = f"""std_msgs/Header header
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

WRENCH: Final = StandardTopic("/follower/wrench", "geometry_msgs/msg/WrenchStamped", _WRENCH_SCHEMA)
FOLLOWER_JOINTS: Final = StandardTopic("/follower/joint_states", "sensor_msgs/msg/JointState", _JOINT_STATE_SCHEMA)
LEADER_JOINTS: Final = StandardTopic("/leader/joint_states", "sensor_msgs/msg/JointState", _JOINT_STATE_SCHEMA)
STANDARD: Final = (WRENCH, FOLLOWER_JOINTS, LEADER_JOINTS)


def _text(value: str) -> bytes:
    """A CDR string, length first, with zeros behind it up to the next multiple of 4 bytes."""
    data = value.encode() + b"\0"
    return struct.pack("<I", len(data)) + data + bytes(-len(data) % 4)


# The frame and the joint have fixed names of fixed length, so that everything between the numbers is constant.
# Behind the encapsulation header: stamp 8 bytes, frame_id 12 bytes ("probe" and NUL, padded), and so on.
_FRAME = _text("probe")
_JOINT = _FRAME + struct.pack("<I", 1) + _text("probe") + struct.pack("<I", 1)  # frame_id, one name, one position
_ONE = struct.pack("<II", 1, 0)  # count 1, padded to the next multiple of 8
_wrench = struct.Struct(f"<4siI{len(_FRAME)}s4x6d")
_joint_state = struct.Struct(f"<4siI{len(_JOINT)}sd8sd8sd")
LARGEST_SECOND = 2**31 - 1


def _stamp(time_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds; a clock beyond what ROS 2 can say stays at the largest second."""
    second, nanosecond = divmod(time_ns, 1_000_000_000)
    return min(second, LARGEST_SECOND), nanosecond


def wrench(time_ns: int, force: float) -> bytes:
    """CDR bytes of a WrenchStamped with ``force`` [N] along z and nothing else."""
    return _wrench.pack(HEADER, *_stamp(time_ns), _FRAME, 0.0, 0.0, force, 0.0, 0.0, 0.0)


def joint_state(time_ns: int, position: float, velocity: float, force: float) -> bytes:
    """CDR bytes of a JointState of one joint: position [m], velocity [m/s], effort [N]."""
    return _joint_state.pack(HEADER, *_stamp(time_ns), _JOINT, position, _ONE, velocity, _ONE, force)
