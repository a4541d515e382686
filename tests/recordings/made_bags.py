"""Bags and presses for tests, written by `rosbags`: real files of another implementation."""

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
BEGIN = 1_700_000_000 * 10**9
LEVER = 0.075
JOINT, WRENCH = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"
MAP = """
[position]
topic = "/joint_states"
field = "position[0]"
unit = "rad"
scale = 0.075

[force]
topic = "/ft"
field = "wrench.force.z"
unit = "N"
"""


def press(seconds=1.0, rate=1000):
    """Time [s], position [m] and force [N] of presses on a Hunt-Crossley material."""
    time = np.arange(0, round(seconds * rate)) / rate
    position = 0.010 + 0.006 * np.sin(2.0 * np.pi * 1.8 * time - 1.5)
    depth = np.maximum(position - 0.010, 0.0)
    return time, position, np.maximum(depth**1.4 * (3000.0 + 1500.0 * np.gradient(position, time)), 0.0) + 0.5


def header(ns, frame="tool"):
    stamp = TYPES["builtin_interfaces/msg/Time"](sec=int(ns // 10**9), nanosec=int(ns % 10**9))
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


POSE = "geometry_msgs/msg/PoseStamped"


def pose(ns, x=0.0, y=0.0, z=0.0):
    point, turn = TYPES["geometry_msgs/msg/Point"](x, y, z), TYPES["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    return TYPES[POSE](header(ns), TYPES["geometry_msgs/msg/Pose"](point, turn))


def joint(ns, positions, names=("lever",), velocities=(), frame="tool"):
    arrays = (np.array(values, dtype=np.float64) for values in (positions, velocities, ()))
    return TYPES[JOINT](header(ns, frame), list(names), *arrays)


def wrench(ns, force, frame="tool"):
    vector = TYPES["geometry_msgs/msg/Vector3"]
    content = TYPES["geometry_msgs/msg/Wrench"](force=vector(0.0, 0.0, float(force)), torque=vector(0.0, 0.0, 0.0))
    return TYPES[WRENCH](header(ns, frame), content)


def write_bag(path, messages, *, plugin=StoragePlugin.SQLITE3, topics=(), order="little"):
    """A bag of (topic, type, log time [ns], message), and of topics without messages."""
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic, kind in topics:
            connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
        for topic, kind, log_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            data = STORE.serialize_cdr(message, kind, little_endian=order == "little")
            writer.write(connections[topic], log_ns, data)
    return path


def press_messages(seconds=1.0, *, every=1, stamps_off=0, late=0):
    """A press as joint states (of a lever, in rad) and wrenches; every n-th joint state, its stamps off by some ns."""
    time, position, force = press(seconds)
    for tick in range(time.size):
        ns = BEGIN + tick * 10**6
        if tick % every == 0:
            yield "/joint_states", JOINT, ns + late, joint(ns + stamps_off, [position[tick] / LEVER])
        yield "/ft", WRENCH, ns + late, wrench(ns, force[tick])


def copy_of(path, target, **options):
    """The same messages by the MCAP library itself, as another recorder writes them."""
    with path.open("rb") as source, target.open("wb") as file:
        reader, writer = make_reader(source), McapWriter(file, **options)
        writer.start()
        channels = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    return target
