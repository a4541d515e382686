"""A session on a live ROS 2 graph, without ROS 2: keys, tokens, attachments and type hashes of `rmw_zenoh_cpp`.

`Bridge` passes on what a session says, through a `Graph`; `type_hash` tells message definitions apart as ROS 2 does.
"""

from foretouch.ros2.bridge import BRIDGE_CHANNELS, Bridge, Pace, SessionClock, wall_offset_ns
from foretouch.ros2.graph import Graph, type_description, type_hash
from foretouch.ros2.keys import DEFAULT, SENSOR_DATA, Node, Qos, TopicType, attachment, dds_type, publisher_gid

__all__ = [
    "BRIDGE_CHANNELS",
    "DEFAULT",
    "SENSOR_DATA",
    "Bridge",
    "Graph",
    "Node",
    "Pace",
    "Qos",
    "SessionClock",
    "TopicType",
    "attachment",
    "dds_type",
    "publisher_gid",
    "type_description",
    "type_hash",
    "wall_offset_ns",
]
