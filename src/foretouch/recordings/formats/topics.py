"""The topics of a session and their types, in its MCAP file and on ROS 2: our own, and standard ones beside them.

Our own carry every field of the messages. The standard ones have the same motion, force and images, for tools that know
only those. The contact model has a type of its own, `foretouch_msgs/msg/ContactModel`, with the law's numbers and their
names; a receiver needs no table of laws to read them. `/follower/model` beside it carries every field of `ModelUpdate`,
also those that only foretouch can use.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeAlias

from foretouch.messages import (
    CameraImage,
    Choice,
    Command,
    EmergencyStop,
    FieldUpdate,
    FixtureBelief,
    FollowerPacket,
    Handle,
    Hello,
    LeaderPacket,
    LeaderState,
    Message,
    ModelUpdate,
    Settings,
    SmallImage,
    Stop,
    Telemetry,
)
from foretouch.messages.states import FollowerRow, LeaderRow
from foretouch.models import LAWS
from foretouch.quantities import CAMERA, FIXTURE, TIP, WORLD
from foretouch.recordings.formats.cdr import HEADER, Layout, pack_fields, unpack_fields

COUNTS: Final = "foretouch_counts"  # name of the metadata record that holds the counters of the session's end
TRUNCATED: Final = {"truncated": 1}  # counter of a recording that ends before its session did


@dataclass(frozen=True)
class Topic:
    """One topic of our own messages."""

    name: str
    type_name: str
    layout: Layout
    frame: str = ""  # of its vectors and poses, of `foretouch.quantities.FRAMES`; empty where it has none
    former: str = ""


CONTACT_MODEL_TYPE: Final = "foretouch_msgs/msg/ContactModel"

FORMER: Final[dict[type[Message], str]] = {ModelUpdate: CONTACT_MODEL_TYPE}
"""Type names of former recordings; that name now belongs to the message of the same topic with only standard parts."""

TOPICS: Final[dict[type[Message], Topic]] = {
    kind: Topic(name, f"foretouch_msgs/msg/{type_name}", Layout(kind), frame, FORMER.get(kind, ""))
    for kind, name, type_name, frame in (
        (Telemetry, "/follower/state", "FollowerState", TIP),
        (LeaderState, "/leader/state", "LeaderState", TIP),
        (ModelUpdate, "/follower/model", "ModelUpdate", TIP),
        (Hello, "/session/hello", "Hello", ""),
        (Settings, "/session/settings", "Settings", ""),
        (Choice, "/session/choice", "Choice", ""),
        (Stop, "/session/stop", "Stop", ""),
        (EmergencyStop, "/session/emergency", "EmergencyStop", ""),
        (Handle, "/console/handle", "Handle", WORLD),
        (Command, "/leader/command", "Command", WORLD),
        (LeaderPacket, "/leader/packet", "Packet", ""),
        (FollowerPacket, "/follower/packet", "Packet", ""),
        (FollowerRow, "/follower/space", "FollowerSpace", WORLD),
        (LeaderRow, "/leader/space", "LeaderSpace", WORLD),
        (FieldUpdate, "/follower/field", "ScaleField", FIXTURE),
        (FixtureBelief, "/camera/fixture", "FixtureBelief", WORLD),
        (CameraImage, "/camera/image", "CameraImage", WORLD),
        (SmallImage, "/camera/small", "SmallImage", ""),
    )
}

CONTACT_MODEL_MSG: Final = """\
# A contact model as the follower learns it. All numbers are in SI units: metres, newtons, seconds.

# When the follower had it. frame_id is "tip", whose z points out of the surface, as the force does.
std_msgs/Header header

# Name of the contact law, such as "contact-map" or "hunt-crossley".
string law

# The law's numbers by name, in the law's own order, for depths in metres: the stiffness of "hunt-crossley" is in
# N/m^exponent, an exponent has no unit. No names where the sender does not know the law.
string[] names
float64[] values

# Standard error of each value, in its unit: NaN for one that is undetermined; empty where the estimator tells none.
float64[] standard_errors

# Where the undeformed surface is [m], along the probe's axis, in the coordinate of the joint of /follower/joint_states,
# which grows into the material: depth is that position less this one. In the frame "world" of a session along a line
# it lies at z of minus this. In a scene: how much deeper than its known shape the surface was felt, along its normal.
float64 surface

# Whether a force may be computed from it.
bool valid

# One sentence: why it may not, or what there is to know.
string reason

# Running number of the model; it counts from 1 in each process of the follower, and a gap is one that did not arrive.
uint64 sequence
"""
"""Definition in the ``.msg`` language, which describes each field; ``ros2/foretouch_msgs`` has the same text."""

_HEADER: Final = {"sec": "int32", "nanosec": "uint32", "frame_id": "string"}
_FIELDS: Final = [line.split() for line in CONTACT_MODEL_MSG.splitlines() if line and not line.startswith("#")]
_CONTACT_MODEL: Final = _HEADER | {name: ros_type for ros_type, name in _FIELDS[1:]}
_DIMENSIONS: Final = {"dimensions": "uint32", "label": "string", "size": "uint32", "stride": "uint32"}
_NUMBER_ARRAY: Final = _DIMENSIONS | {"data_offset": "uint32", "data": "float64[]"}


def parameter_names(law: str, count: int) -> tuple[str, ...]:
    """Names of a law's numbers in their order; empty where the law is not known, or has another number of them."""
    names = LAWS[law].parameter_names if law in LAWS else ()
    return names if len(names) == count else ()


def contact_model(update: ModelUpdate, stamp: tuple[int, int], frame: str) -> bytes:
    """CDR bytes of a ContactModel."""
    names = parameter_names(update.law, len(update.parameters))
    numbers = (names, update.parameters, update.standard_errors)
    return pack_fields(
        _CONTACT_MODEL,
        (*stamp, frame, update.law, *numbers, update.surface, update.valid, update.reason, update.sequence),
    )


def number_array(update: ModelUpdate) -> bytes:
    """CDR bytes of a Float64MultiArray of the law's numbers; its one dimension is labelled with their names."""
    label, count = ",".join(parameter_names(update.law, len(update.parameters))), len(update.parameters)
    return pack_fields(_NUMBER_ARRAY, (1, label, count, count, 0, update.parameters))


@dataclass(frozen=True)
class StandardTopic:
    """One topic of a standard ROS 2 type."""

    name: str
    type_name: str
    schema: str
    frame: str  # as of `Topic`; the same as in its headers, where it has such


_PARTS: Final = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride\n",
}
"""Definitions of the standard types within others."""


def _parts_of(fields: str) -> Iterator[str]:
    for part in re.findall(r"^\w+/\w+", fields, re.MULTILINE):
        yield part
        yield from _parts_of(_PARTS[part])


def _schema(fields: str) -> str:
    """Definition of a type with those of the types within it."""
    return fields + "".join(f"{'=' * 80}\nMSG: {part}\n{_PARTS[part]}" for part in dict.fromkeys(_parts_of(fields)))


_HEAD = "std_msgs/Header header\n"
JOINT_STATE_SCHEMA = _schema(f"{_HEAD}string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n")
WRENCH_SCHEMA = _schema(f"{_HEAD}geometry_msgs/Wrench wrench\n")
POSE_SCHEMA = _schema(f"{_HEAD}geometry_msgs/Pose pose\n")
_IMAGE_SCHEMA = _schema(f"{_HEAD}string format\nuint8[] data\n")
_MODEL_SCHEMA = _schema(CONTACT_MODEL_MSG)
_ARRAY_SCHEMA = _schema("std_msgs/MultiArrayLayout layout\nfloat64[] data\n")
WRENCH: Final = StandardTopic("/follower/wrench", "geometry_msgs/msg/WrenchStamped", WRENCH_SCHEMA, TIP)
FOLLOWER_JOINTS: Final = StandardTopic("/follower/joint_states", "sensor_msgs/msg/JointState", JOINT_STATE_SCHEMA, TIP)
LEADER_JOINTS: Final = StandardTopic("/leader/joint_states", "sensor_msgs/msg/JointState", JOINT_STATE_SCHEMA, TIP)
PROBE: Final = StandardTopic("/follower/probe", "geometry_msgs/msg/PoseStamped", POSE_SCHEMA, WORLD)
FIXTURE_POSE: Final = StandardTopic("/camera/fixture/pose", "geometry_msgs/msg/PoseStamped", POSE_SCHEMA, WORLD)
IMAGE: Final = StandardTopic("/camera/image/compressed", "sensor_msgs/msg/CompressedImage", _IMAGE_SCHEMA, CAMERA)
MODEL: Final = StandardTopic("/follower/contact_model", CONTACT_MODEL_TYPE, _MODEL_SCHEMA, TIP)
NUMBERS: Final = StandardTopic("/follower/contact_model/values", "std_msgs/msg/Float64MultiArray", _ARRAY_SCHEMA, TIP)
STANDARD: Final = (WRENCH, FOLLOWER_JOINTS, LEADER_JOINTS, PROBE, FIXTURE_POSE, IMAGE, MODEL, NUMBERS)

_STAMPED: Final = {
    WRENCH.type_name: _HEADER | dict.fromkeys(("fx", "fy", "fz", "tx", "ty", "tz"), "float64"),
    PROBE.type_name: _HEADER | dict.fromkeys(("x", "y", "z", "qx", "qy", "qz", "qw"), "float64"),
    FOLLOWER_JOINTS.type_name: _HEADER
    | {"name": "string[]", "position": "float64[]", "velocity": "float64[]", "effort": "float64[]"},
}
"""Fields of the types that others send, too, in any frame."""


class Stamped(NamedTuple):
    """A message of one of these types.

    Attributes:
        time_ns: Its stamp [ns since 1970]; 0 where nobody stamped it.
        frame: Its ``frame_id``.
        values: What follows, number by number: force [N] and torque [N m] of a wrench; place [m] and quaternion
            (x, y, z, w) of a pose; names, positions, velocities and efforts of joints.
    """

    time_ns: int
    frame: str
    values: tuple[Any, ...]


def pack_stamped(type_name: str, message: Stamped) -> bytes:
    """CDR bytes of a message of WrenchStamped, PoseStamped or JointState."""
    return pack_fields(_STAMPED[type_name], (*_stamp(message.time_ns), message.frame, *message.values))


def unpack_stamped(type_name: str, data: bytes) -> Stamped:
    """A message of these types, of its bytes.

    Raises:
        ValueError: They are no such message, or not in little-endian CDR, in which all common machines send.
    """
    if data[: len(HEADER)] != HEADER:
        raise ValueError(f"begins with {data[: len(HEADER)].hex()} and not with {HEADER.hex()}, as CDR does here")
    second, nanosecond, frame, *values = unpack_fields(_STAMPED[type_name], data)
    return Stamped(second * 1_000_000_000 + nanosecond, frame, tuple(values))


def _text(value: str) -> bytes:
    """A CDR string, length first, with zeros behind it up to the next multiple of 4 bytes."""
    data = value.encode() + b"\0"
    return struct.pack("<I", len(data)) + data + bytes(-len(data) % 4)


def _before_numbers(*parts: bytes) -> bytes:
    """What stands between a stamp of 8 bytes and numbers of 8, which begin at a multiple of 8 behind the head."""
    content = b"".join(parts)
    return content + bytes(-len(content) % 8)


# Frames and the joint have fixed names, so that everything between the numbers is constant.
_FRAME, _WORLD = _before_numbers(_text(TIP)), _before_numbers(_text(WORLD))
_ONE_NAME = struct.pack("<I", 1) + _text("probe")
_JOINT = _before_numbers(_text(TIP), _ONE_NAME, struct.pack("<I", 1))  # frame_id, one name, one position
_ONE = struct.pack("<II", 1, 0)  # count 1, padded to the next multiple of 8
_NONE_AND_ONE = struct.pack("<II", 0, 1)  # no velocity, one effort
_wrench = struct.Struct(f"<4siI{len(_FRAME)}s6d")
_joint_state = struct.Struct(f"<4siI{len(_JOINT)}sd8sd8sd")
_joint_at_rest = struct.Struct(f"<4siI{len(_JOINT)}sd8sd")
_pose = struct.Struct(f"<4siI{len(_WORLD)}s7d")
LARGEST_SECOND = 2**31 - 1


def _stamp(time_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds; a clock beyond the range of ROS 2 stays at the largest second."""
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
    """CDR bytes of a PoseStamped in the world: a position [m] and a rotation vector [rad]."""
    return _pose.pack(HEADER, *_stamp(time_ns), _WORLD, *place, *quaternion(turn))


def probe(message: Telemetry) -> bytes:
    """CDR bytes of the probe's pose; along a line z of the world points out of the surface, as the force does."""
    space = message.space
    place = (0.0, 0.0, -message.position) if space is None else (space.place_x, space.place_y, space.place_z)
    return pose(message.time_ns, place)


def quaternion(turn: Sequence[float]) -> tuple[float, float, float, float]:
    r"""The quaternion (x, y, z, w) of a rotation vector [rad].

    .. math:: q = \left(\frac{\sin(\theta / 2)}{\theta} v, \cos(\theta / 2)\right), \quad \theta = \lVert v \rVert
    """
    angle = math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2)
    fraction = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    return fraction * turn[0], fraction * turn[1], fraction * turn[2], math.cos(0.5 * angle)


def compressed_image(time_ns: int, jpeg: bytes) -> bytes:
    """CDR bytes of a CompressedImage."""
    return pack_fields(_HEADER | {"format": "string", "data": "uint8[]"}, (*_stamp(time_ns), CAMERA, "jpeg", jpeg))


Packed: TypeAlias = tuple[tuple[StandardTopic, bytes], ...]

BESIDE: Final[dict[type[Message], Callable[[Any], Packed]]] = {
    Telemetry: lambda message: (
        (WRENCH, wrench(message.time_ns, message.force)),
        (FOLLOWER_JOINTS, joint_state(message.time_ns, message.position, message.velocity, message.force)),
    ),
    LeaderState: lambda message: (
        (LEADER_JOINTS, joint_state(message.time_ns, message.position, message.velocity, message.rendered_force)),
    ),
    ModelUpdate: lambda message: (
        (MODEL, contact_model(message, _stamp(message.time_ns), TIP)),
        (NUMBERS, number_array(message)),
    ),
    FixtureBelief: lambda message: (
        ((FIXTURE_POSE, pose(message.time_ns, message.pose[:3], message.pose[3:])),) if len(message.pose) == 6 else ()
    ),
    CameraImage: lambda message: ((IMAGE, compressed_image(message.time_ns, message.jpeg)),) if message.jpeg else (),
}
"""What is written beside a message, topic by topic; an image that the stream dropped has nothing beside it."""
