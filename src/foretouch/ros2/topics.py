"""What a session's messages are on the ROS 2 graph: the topics that stand beside them in a recording, stamped anew."""

from __future__ import annotations

from typing import Final

import msgspec

from foretouch.messages import Message, Telemetry
from foretouch.recordings.standard_topics import BESIDE, FIXTURE, MODEL, NUMBERS, PROBE, StandardTopic, pose_on_a_line
from foretouch.ros2.keys import TopicType
from foretouch.ros2.qos import DEFAULT, SENSOR_DATA, Qos
from foretouch.ros2.type_hash import type_hash

__all__ = ["as_ros", "probe_on_a_line", "qos_of", "type_of"]

KEPT: Final = (MODEL.name, NUMBERS.name, FIXTURE.name)
"""Topics of which nobody wants to miss what came last: reliable. The others are streams of samples."""

_TYPES: Final[dict[str, TopicType]] = {}


def qos_of(topic: StandardTopic) -> Qos:
    """How a topic is offered: models and the fixture's pose reliably, samples as sensor data."""
    return DEFAULT if topic.name in KEPT else SENSOR_DATA


def type_of(topic: StandardTopic) -> TopicType:
    """Type of a topic with the hash of its definition, computed once."""
    if topic.type_name not in _TYPES:
        _TYPES[topic.type_name] = TopicType(topic.type_name, type_hash(topic.type_name, topic.schema))
    return _TYPES[topic.type_name]


def as_ros(message: Message, stamp_ns: int) -> tuple[tuple[StandardTopic, bytes], ...]:
    """The topics that say what a message says, with their CDR bytes.

    Args:
        message: Of a session.
        stamp_ns: For the headers: nanoseconds since 1970.

    Returns:
        Empty for a kind of message that has no counterpart, and for samples of sensors that are not to be trusted.
    """
    make = BESIDE.get(type(message))
    if make is None or (isinstance(message, Telemetry) and message.validity):
        return ()
    return make(msgspec.structs.replace(message, time_ns=stamp_ns))


def probe_on_a_line(telemetry: Telemetry, stamp_ns: int) -> tuple[tuple[StandardTopic, bytes], ...]:
    """Where the probe of a session along a line is: z of the world points out of the surface, as the force does.

    Args:
        telemetry: Of the follower.
        stamp_ns: Nanoseconds since 1970.
    """
    return () if telemetry.validity else ((PROBE, pose_on_a_line(stamp_ns, telemetry.position)),)
