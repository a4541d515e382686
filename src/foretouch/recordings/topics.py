"""What a session's MCAP file holds of our own: the topics and their types, which carry every field of the messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from foretouch.messages import (
    CameraImage,
    Choice,
    Command,
    EmergencyStop,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    Handle,
    Hello,
    LeaderSpace,
    LeaderState,
    Message,
    ModelUpdate,
    Settings,
    Stop,
    Telemetry,
)
from foretouch.recordings.cdr import Layout

__all__ = ["COUNTS", "TOPICS", "TRUNCATED", "Topic"]

COUNTS: Final = "foretouch_counts"
"""Name of the metadata record that holds the counters of the session's end."""

TRUNCATED: Final = {"truncated": 1}
"""Counter of a recording that ends before its session did."""


@dataclass(frozen=True)
class Topic:
    """One topic of our own messages.

    Attributes:
        name: Of the topic.
        type_name: Of the ROS 2 type.
        layout: Schema and bytes.
        former: What the type was called in recordings that were made before; they are read too.
    """

    name: str
    type_name: str
    layout: Layout
    former: str = ""


FORMER: Final[dict[type[Message], str]] = {ModelUpdate: "foretouch_msgs/msg/ContactModel"}
"""Type names of former recordings; that name now belongs to the message of the same topic with only standard parts."""

TOPICS: Final[dict[type[Message], Topic]] = {
    kind: Topic(name, f"foretouch_msgs/msg/{type_name}", Layout(kind), FORMER.get(kind, ""))
    for kind, name, type_name in (
        (Telemetry, "/follower/state", "FollowerState"),
        (LeaderState, "/leader/state", "LeaderState"),
        (ModelUpdate, "/follower/model", "ModelUpdate"),
        (Hello, "/session/hello", "Hello"),
        (Settings, "/session/settings", "Settings"),
        (Choice, "/session/choice", "Choice"),
        (Stop, "/session/stop", "Stop"),
        (EmergencyStop, "/session/emergency", "EmergencyStop"),
        (Handle, "/console/handle", "Handle"),
        (Command, "/leader/command", "Command"),
        (FollowerSpace, "/follower/space", "FollowerSpace"),
        (LeaderSpace, "/leader/space", "LeaderSpace"),
        (FieldUpdate, "/follower/field", "MaterialField"),
        (FixtureBelief, "/camera/fixture", "FixtureBelief"),
        (CameraImage, "/camera/image", "CameraImage"),
    )
}
