"""A node of another implementation, in a process of its own: zenoh_ros2_sdk. A small simulated arm, or a hand's device.

Usage: other_node.py arm|hand ROUTER_PORT. It publishes 500 times a second if it can, and reads lines: `NAME VALUE`
sets one of `Now`, and `say` is answered by a line of JSON with what it has heard.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from echo import schemas_inside
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber
from zenoh_ros2_sdk.utils import compute_type_hash_from_msg

from foretouch.recordings.formats.topics import FOLLOWER_JOINTS, PROBE, WRENCH, StandardTopic

DOMAIN, PERIOD, STIFFNESS, FOLLOWS = 5, 0.002, 1000.0, 40.0  # [-], [s], [N/m], [1/s]
FLOOR, BEGINS = 0.19, 0.2  # Height of the floor, and where the tip is at first [m]
NONE = np.empty(0)
LYING = (0.0, 1.0, 0.0, 0.0)  # The tool looks down


@dataclass
class Now:
    """What the node says now."""

    pose: bool = True
    wrench: bool = True
    frame: str = "base"
    wrench_frame: str = "base"
    z: float = BEGINS
    extra: float = 0.0  # force besides that of the floor [N]
    stamped: bool = True
    frozen: bool = False  # the stamp stays as it is
    period: float = PERIOD  # between what it publishes [s]
    heard: int = 0
    last: dict[str, Any] | None = None


def options(topic: StandardTopic, name: str, port: int) -> dict[str, Any]:
    """What the SDK needs for a topic of a type."""
    first, inside = schemas_inside(topic.schema)
    return {
        "topic": name,
        "msg_type": topic.type_name,
        "msg_definition": topic.schema,
        "domain_id": DOMAIN,
        "router_port": port,
        "type_hash": compute_type_hash_from_msg(topic.type_name, first, inside),
    }


class Messages:
    """Makes messages of the SDK's own classes."""

    def __init__(self, publisher: ROS2Publisher) -> None:
        self._types = publisher.session_mgr.store.types

    def of(self, name: str, **fields: Any) -> Any:
        return self._types[name](**fields)

    def header(self, now: Now, frame: str, stamp_ns: int) -> Any:
        second, nanosecond = divmod(stamp_ns if now.stamped else 0, 10**9)
        stamp = self.of("builtin_interfaces/msg/Time", sec=second, nanosec=nanosecond)
        return self.of("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def pose(self, z: float) -> Any:
        x, y, z_, w = LYING
        orientation = self.of("geometry_msgs/msg/Quaternion", x=x, y=y, z=z_, w=w)
        return self.of(
            "geometry_msgs/msg/Pose",
            position=self.of("geometry_msgs/msg/Point", x=0.3, y=0.1, z=z),
            orientation=orientation,
        )

    def wrench(self, force: float) -> Any:
        vector = "geometry_msgs/msg/Vector3"
        pushed, none = self.of(vector, x=0.0, y=0.0, z=force), self.of(vector, x=0.0, y=0.0, z=0.0)
        return self.of("geometry_msgs/msg/Wrench", force=pushed, torque=none)


def listen(now: Now) -> None:
    """Obey the lines that come in, until there are no more."""
    for line in sys.stdin:
        name, _, value = line.strip().partition(" ")
        if name == "say":
            sys.stdout.write(json.dumps(dataclasses.asdict(now)) + "\n")
            sys.stdout.flush()
            continue
        kind = type(getattr(now, name))
        setattr(now, name, value == "yes" if kind is bool else kind(value))


def noted(message: Any) -> dict[str, Any]:
    """The numbers of a target or a wrench."""
    stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
    content: dict[str, Any] = {"frame": message.header.frame_id, "late": time.time_ns() - stamp}
    if hasattr(message, "pose"):
        place, turn = message.pose.position, message.pose.orientation
        return content | {"place": [place.x, place.y, place.z], "turn": [turn.x, turn.y, turn.z, turn.w]}
    force, torque = message.wrench.force, message.wrench.torque
    return content | {"force": [force.x, force.y, force.z], "torque": [torque.x, torque.y, torque.z]}


def main(what: str, port: int) -> None:
    """Publish until the input ends."""
    now, arm = Now(), what == "arm"

    def take(message: Any) -> None:
        now.last = noted(message)
        now.heard += 1

    wanted = options(PROBE, "/target_pose", port) if arm else options(WRENCH, "/body/servo_cf", port)
    pose = ROS2Publisher(**options(PROBE, "/current_pose" if arm else "/measured_cp", port))
    joints = ROS2Publisher(**options(FOLLOWER_JOINTS, "/joint_states", port)) if arm else None
    wrench = ROS2Publisher(**options(WRENCH, "/ft/wrench", port)) if arm else None
    kept = ROS2Subscriber(callback=take, **wanted)
    make, stamp_ns, due = Messages(pose), time.time_ns(), time.monotonic()
    listener = threading.Thread(target=listen, args=(now,), daemon=True)
    listener.start()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    while listener.is_alive():
        stamp_ns = stamp_ns if now.frozen else time.time_ns()
        if arm and now.last is not None:
            now.z += FOLLOWS * PERIOD * (now.last["place"][2] - now.z)
        if now.pose:
            pose.publish(header=make.header(now, now.frame, stamp_ns), pose=make.pose(now.z))
        if now.wrench and wrench is not None and joints is not None:
            force = STIFFNESS * max(FLOOR - now.z, 0.0) + now.extra
            wrench.publish(header=make.header(now, now.wrench_frame, stamp_ns), wrench=make.wrench(force))
            header, names = make.header(now, "", stamp_ns), [f"joint{number}" for number in range(7)]
            joints.publish(header=header, name=names, position=0.1 * np.arange(7.0), velocity=NONE, effort=NONE)
        due = max(due + now.period, time.monotonic())
        time.sleep(max(due - time.monotonic(), 0.0))
    kept.close()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
