"""A haptic device behind a node on a ROS 2 graph: its pose comes in, and a wrench for the hand goes out.

Usual names are those of the Collaborative Robotics Toolkit (CRTK), as the drivers of Johns Hopkins University for Force
Dimension, Geomagic Touch and the dVRK have them: ``measured_cp`` (PoseStamped) and ``servo_cf`` (WrenchStamped). There
was no such device: **tested against a node of another implementation alone**.
"""

from __future__ import annotations

import dataclasses
import math
import threading
import time
from typing import Any, ClassVar, Final

from foretouch.devices import AnyDevice, Device, DeviceSpecification, SpatialDevice, limit_force
from foretouch.quantities.pose import Vector
from foretouch.recordings.formats.topics import PROBE, WRENCH, Stamped, StandardTopic, pack_stamped
from foretouch.ros2.graph import Graph
from foretouch.ros2.keys import NEWEST
from foretouch.ros2.newest import SILENT, GraphAddress, Newest, await_first

USUAL: Final = {"pose": "measured_cp", "wrench": "servo_cf", "frame": ""}
"""Options of the address: names of both topics, and the frame of the poses, without one that of the first."""

PATIENCE = 0.05  # Time without a `render` after which a thread of its own sends a wrench of zero [s]
LAST = 0.02  # Time that the last wrench has to go out before the graph is left [s]

NO_PLACE: Vector = (math.nan, math.nan, math.nan)
NO_FORCE: Vector = (0.0, 0.0, 0.0)


class _Handle(AnyDevice):
    """The device on the graph.

    Its wrench has no torque, and the axes of its pose's frame. It is zero before the first `render`, where the pose has
    been silent for 20 ms, where nothing has been rendered for 50 ms, by a thread of its own, and at `close`. Where this
    process is killed, no wrench comes any more: how long the last one is given then is the node's affair.

    Args:
        graph: Node on the graph, connected; closed with the device.
        pose: Newest pose, which has been heard.
        wrench: Topic of the wrench.
        specification: What the device is; its damping and delay say how stiff it may be rendered.
    """

    name: ClassVar[str] = "ros2"
    closed_loop: ClassVar[bool] = True
    real_time: ClassVar[bool] = True

    def __init__(self, graph: Graph, pose: Newest, wrench: StandardTopic, specification: DeviceSpecification) -> None:
        self._graph, self._pose, self._wrench = graph, pose, wrench
        self._specification = dataclasses.replace(specification, watchdog=2.0 * PATIENCE, pulls=True)
        self._closed, self._rendered = False, 0
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._send(NO_FORCE)
        self._watch = threading.Thread(target=self._watch_renders, name="ros2 device watchdog", daemon=True)
        self._watch.start()

    @property
    def specification(self) -> DeviceSpecification:
        """Specification of the device: the settings', for nobody on the graph states one."""
        return self._specification

    def close(self) -> None:
        """A wrench of zero, and the graph is left; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        self._ended.set()
        self._watch.join(1.0)
        self._send(NO_FORCE)
        time.sleep(LAST)
        self._graph.close()

    def _place(self) -> Vector:
        """Where the hand is [m]; no numbers where the pose is silent, refused or none."""
        heard = self._pose.heard
        if heard is None or self._pose.problem or time.monotonic_ns() - heard.arrival_ns > 1e9 * SILENT:
            return NO_PLACE
        x, y, z = heard.values[:3]
        return (x, y, z) if math.isfinite(x + y + z) else NO_PLACE

    def _push(self, force: Vector) -> Vector:
        """Give the hand a force [N]; what it gets."""
        self._rendered += 1
        if self._closed:
            return NO_FORCE
        given = NO_FORCE if self._place() is NO_PLACE else force
        self._send(given)
        return given

    def _send(self, force: Vector) -> None:
        frame = "" if self._pose.heard is None else self._pose.heard.frame
        message = Stamped(time.time_ns(), frame, (*force, *NO_FORCE))
        with self._lock:
            self._graph.publish(self._wrench, pack_stamped(self._wrench.type_name, message), NEWEST)

    def _watch_renders(self) -> None:
        """Send a wrench of zero where `render` is no longer called."""
        before = 0
        while not self._ended.wait(PATIENCE):
            if self._rendered == before:
                self._send(NO_FORCE)
            before = self._rendered


class RosDevice(_Handle, Device):
    """Along the vertical: down is in, and 0 is where the hand was at the first `read`."""

    def __init__(self, graph: Graph, pose: Newest, wrench: StandardTopic, specification: DeviceSpecification) -> None:
        super().__init__(graph, pose, wrench, specification)
        self._origin, self._position = math.nan, 0.0

    def read(self, now_ns: int) -> float:
        """Position of the hand [m]; no number where the pose is silent, so that no force is held on a guess."""
        if self._closed:
            return self._position
        height = self._place()[2]
        if math.isnan(height):
            return math.nan
        if math.isnan(self._origin):
            self._origin = height
        self._position = self._origin - height
        return self._position

    def render(self, force: float) -> float:
        """Give the hand a force [N], and return the force that was sent."""
        return self._push((0.0, 0.0, limit_force(force, self._specification.force_limit, pulls=True)))[2]


class SpatialRosDevice(_Handle, SpatialDevice):
    """In three dimensions, in the frame of its pose: the session's leader frame says where that is."""

    def __init__(self, graph: Graph, pose: Newest, wrench: StandardTopic, specification: DeviceSpecification) -> None:
        super().__init__(graph, pose, wrench, specification)
        self._last: Vector = NO_PLACE

    def read(self, now_ns: int) -> Vector:
        """Place of the hand [m]; no numbers where the pose is silent."""
        if self._closed:
            return self._last
        place = self._place()
        if place is not NO_PLACE:
            self._last = place
        return place

    def render(self, force: Vector) -> None:
        """Give the hand a force [N], no larger than the limit; what is no number is none."""
        size, limit = math.hypot(*force), self._specification.force_limit
        if not size < math.inf:
            force = NO_FORCE
        elif size > limit:
            x, y, z = force
            force = x * limit / size, y * limit / size, z * limit / size
        self._push(force)


def make_device(settings: Any, reach: Any) -> RosDevice | SpatialRosDevice:
    """The operator ``ros2@ROUTER,KEY=VALUE,...`` of the settings.

    Args:
        settings: Session settings; with a scene the device is one in space.
        reach: Not asked: the hand is a person's.

    Raises:
        SettingError: An address that is none, or no pose within 3 s.
        InputError: No router.
        LinkError: The router's endpoint is malformed.
    """
    address = GraphAddress.read("operator", settings.operator, USUAL)
    frame = address.options["frame"]
    pose, wrench = Newest(address.topic("pose", PROBE), (frame,) if frame else ()), address.topic("wrench", WRENCH)
    graph = address.open("foretouch_device")
    graph.subscribe(pose.topic, pose.take)
    missing = await_first((pose,))
    if missing:
        graph.close()
        raise address.refuse(f"{missing}: start the device's node, and see `ros2 topic info -v`")
    made = SpatialRosDevice if settings.scene else RosDevice
    return made(graph, pose, wrench, settings.device)
