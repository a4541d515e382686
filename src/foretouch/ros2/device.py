"""A haptic device behind a node on a ROS 2 graph: its pose comes in, and a wrench for the hand goes out.

Usual names are those of the nodes of Johns Hopkins University for Force Dimension, Geomagic Touch and the dVRK:
``measured_cp`` (PoseStamped) and ``body/servo_cf`` (WrenchStamped). There was no such device: **tested against a node
of another implementation alone**.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from typing import Any, ClassVar, Final

from foretouch.devices.felt import NO_FORCE, FeltAlongAxis, FeltInSpace, HandleLink
from foretouch.devices.spatial import NOWHERE
from foretouch.errors import printable
from foretouch.quantities.pose import Vector
from foretouch.recordings.formats.topics import PROBE, WRENCH, Stamped, StandardTopic, pack_stamped
from foretouch.ros2.graph import Graph
from foretouch.ros2.keys import NEWEST
from foretouch.ros2.newest import SILENT, GraphAddress, Newest, await_first

USUAL: Final = {"pose": "measured_cp", "wrench": "body/servo_cf", "frame": "", "in": "-z"}
"""Options of the address: names of both topics; the frame of the poses, without one that of the first; and where in is
along a line."""

WAYS_IN: Final = {sign + name: (axis, way) for axis, name in enumerate("xyz") for sign, way in (("", 1), ("-", -1))}
"""Axis and direction of each."""

WATCHED = 0.25  # Time for which poses are counted before the first is taken [s]
LAST = 0.02  # Time that the last wrench has to go out before the graph is left [s]


class GraphHandle(HandleLink):
    """The device on the graph.

    Its wrench has no torque, and the axes of its pose's frame. It is zero before the first `render` and where the pose
    has been silent for 20 ms. Where this process is killed, no wrench comes any more: how long the last one is given
    then is the node's affair.

    Args:
        graph: Node on the graph, connected.
        pose: Newest pose, which has been heard.
        wrench: Topic of the wrench.
        tell: Gets one line where poses come that are refused.
    """

    def __init__(
        self, graph: Graph, pose: Newest, wrench: StandardTopic, tell: Callable[[str], object] = lambda line: None
    ) -> None:
        self._graph, self._pose, self._wrench, self._tell = graph, pose, wrench, tell
        self._send(NO_FORCE)

    def place(self) -> Vector:
        """Where the hand is [m]; no numbers where the pose is silent, refused or none."""
        heard, problem = self._pose.heard, self._pose.problem
        if problem:
            self._tell(f"operator: {problem}: the hand gets no force and counts as not moved")
            self._tell = lambda line: None  # once
        if heard is None or problem or time.monotonic_ns() - heard.arrival_ns > 1e9 * SILENT:
            return NOWHERE
        x, y, z = heard.values[:3]
        return (x, y, z) if math.isfinite(x + y + z) else NOWHERE

    def push(self, force: Vector) -> bool:
        """Send a force for the hand [N], and say whether it was sent; a hand whose place is unknown gets none."""
        known = self.place() is not NOWHERE
        self._send(force if known else NO_FORCE)
        return known

    def close(self) -> None:
        """Leave the graph."""
        time.sleep(LAST)
        self._graph.close()

    def _send(self, force: Vector) -> None:
        frame = "" if self._pose.heard is None else self._pose.heard.frame
        message = Stamped(time.time_ns(), frame, (*force, *NO_FORCE))
        self._graph.publish(self._wrench, pack_stamped(self._wrench.type_name, message), NEWEST)


class RosDevice(FeltAlongAxis):
    """Along one axis of its pose's frame."""

    name: ClassVar[str] = "ros2"


class SpatialRosDevice(FeltInSpace):
    """In three dimensions, in the frame of its pose: the session's leader frame says where that is."""

    name: ClassVar[str] = "ros2"


def make_device(settings: Any, reach: Any) -> RosDevice | SpatialRosDevice:
    """The operator ``ros2@ROUTER,KEY=VALUE,...`` of the settings.

    Args:
        settings: Session settings; with a scene the device is one in space.
        reach: Not asked: the hand is a person's.

    Raises:
        SettingError: An address that is none; no pose within 3 s, or fewer than 50 a second; nobody who takes forces.
        InputError: No router.
        LinkError: The router's endpoint is malformed.
    """
    address = GraphAddress.read("operator", settings.operator, USUAL)
    frame, way = address.options["frame"], address.options["in"]
    if way not in WAYS_IN:
        raise address.refuse(f"in must be the way into the material in the pose's frame, one of {', '.join(WAYS_IN)}")
    pose, wrench = Newest(address.topic("pose", PROBE), (frame,) if frame else ()), address.topic("wrench", WRENCH)
    graph = address.open("foretouch_device")
    graph.subscribe(pose.topic, pose.take)
    rule = _missing(graph, pose, wrench)
    if rule:
        graph.close()
        raise address.refuse(f"{rule}, and see `ros2 topic info -v`")
    handle = GraphHandle(graph, pose, wrench, lambda line: sys.stderr.write(f"{printable(line)}\n"))
    if settings.scene:
        return SpatialRosDevice(handle, settings.device)
    axis, direction = WAYS_IN[way]
    return RosDevice(handle, settings.device, axis=axis, direction=direction)


def _missing(graph: Graph, pose: Newest, wrench: StandardTopic) -> str:
    """What the device's node does not do, and how to mend it; "" for nothing."""
    missing = await_first((pose,))
    if missing:
        return f"{missing}: start the device's node"
    before = pose.count
    time.sleep(WATCHED)
    rate = (pose.count - before) / WATCHED
    if rate < 1.0 / SILENT:  # between two of them it would be silent
        return f"{pose.topic.name} comes {rate:.0f} times a second: have the device's node send it at least 100 times"
    if not graph.is_heard(wrench):
        where = f"{wrench.name} ({wrench.type_name})"
        return f"nobody listens to {where}: name the topic from which the device's node takes forces as wrench=NAME"
    return ""
