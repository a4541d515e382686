"""What `ros2 topic echo` does, by another implementation, in a process of its own: zenoh_ros2_sdk.

Usage: echo.py ROUTER_PORT NAMESPACE FILE; writes a line of JSON for each message: topic, when it came, what it says.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
import time
from typing import TextIO

from zenoh_ros2_sdk import ROS2Subscriber
from zenoh_ros2_sdk.utils import compute_type_hash_from_msg

from foretouch.recordings.formats.topics import STANDARD

LOCK = threading.Lock()


def schemas_inside(schema: str) -> tuple[str, dict[str, str]]:
    """The definition of the type itself, and those of the types in it, which the SDK would look for on the network."""
    first, *others = schema.split("=" * 80 + "\n")
    parts = [other.partition("\n") for other in others]
    return first, {"/msg/".join(title.removeprefix("MSG: ").split("/")): text for title, _, text in parts}


def stamped(message: object) -> dict[str, object]:
    """The numbers of a message that a test asks for."""
    header = getattr(message, "header", None)
    content: dict[str, object] = {"type": type(message).__name__}
    if header is not None:
        content |= {"stamp": header.stamp.sec * 10**9 + header.stamp.nanosec, "frame": header.frame_id}
    if hasattr(message, "wrench"):
        content["force"] = [message.wrench.force.x, message.wrench.force.y, message.wrench.force.z]
    if hasattr(message, "pose"):
        content["place"] = [message.pose.position.x, message.pose.position.y, message.pose.position.z]
    if hasattr(message, "effort"):
        content |= {name: list(getattr(message, name)) for name in ("name", "position", "velocity", "effort")}
    if hasattr(message, "law"):
        content |= {"law": message.law, "valid": bool(message.valid), "values": list(message.values)}
        content["names"] = list(message.names)
    if hasattr(message, "layout"):
        content |= {"label": message.layout.dim[0].label, "data": list(message.data)}
    return content


def main(port: int, namespace: str, file: TextIO) -> None:
    """Listen to all topics until somebody ends the process."""

    def note(topic: str, message: object) -> None:
        line = json.dumps([topic, time.time_ns(), stamped(message)])
        with LOCK:
            file.write(line + "\n")
            file.flush()

    kept = []
    for topic in STANDARD:
        first, inside = schemas_inside(topic.schema)
        kept.append(
            ROS2Subscriber(
                namespace + topic.name,
                topic.type_name,
                lambda message, name=topic.name: note(name, message),
                msg_definition=topic.schema,
                domain_id=5,
                router_port=port,
                type_hash=compute_type_hash_from_msg(topic.type_name, first, inside),
            )
        )
    sys.stdout.write("listening\n")
    sys.stdout.flush()
    signal.pause()


if __name__ == "__main__":
    with open(sys.argv[3], "w") as heard:
        main(int(sys.argv[1]), sys.argv[2], heard)
