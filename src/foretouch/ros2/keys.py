"""Keys of topics, liveliness tokens and the quality of service in them, as `rmw_zenoh_cpp` writes them.

Source: "Topic and Service name mapping" and "Graph Cache" in its ``docs/design.md``, and its ``liveliness_utils.cpp``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from foretouch.errors import SettingError

BEST_EFFORT: Final = 2
"""Number of that reliability in ``rmw/types.h``; reliable is what a token says by saying nothing."""

USUAL_DEPTH: Final = 42
"""Depth that a token says by saying nothing (``rmw_zenoh_cpp``, ``qos.cpp``)."""


@dataclass(frozen=True)
class Qos:
    """A profile: volatile, the newest kept, without deadline or lifespan.

    Attributes:
        reliable: Whether it is reliable, and not best effort.
        depth: So many messages are kept.
    """

    reliable: bool
    depth: int

    @property
    def token(self) -> str:
        """Its part of a liveliness token.

        ``RELIABILITY:DURABILITY:HISTORY,DEPTH:DEADLINE_S,DEADLINE_NS:LIFESPAN_S,LIFESPAN_NS:LIVELINESS,LEASE_S,LEASE_NS``,
        each empty where it is the default of ``rmw_zenoh_cpp`` (its ``docs/design.md``, and ``qos_to_keyexpr`` of its
        ``liveliness_utils.cpp``).
        """
        reliability = "" if self.reliable else str(BEST_EFFORT)
        depth = "" if self.depth == USUAL_DEPTH else str(self.depth)
        return f"{reliability}::,{depth}:,:,:,,"


SENSOR_DATA: Final = Qos(reliable=False, depth=5)
"""``rmw_qos_profile_sensor_data``: best effort, 5 kept."""

DEFAULT: Final = Qos(reliable=True, depth=10)
"""``rmw_qos_profile_default``: reliable, 10 kept."""


LARGEST_DOMAIN: Final = 232
"""Largest ``ROS_DOMAIN_ID`` with any middleware."""

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_NAMESPACE = re.compile(r"/|(/[A-Za-z_][A-Za-z0-9_]*)+")


@dataclass(frozen=True)
class TopicType:
    """What a topic carries.

    Attributes:
        name: Of the message type, such as ``"geometry_msgs/msg/WrenchStamped"``.
        hash: `foretouch.ros2.topics` of its definition.
    """

    name: str
    hash: str


@dataclass(frozen=True)
class Node:
    """A node of the ROS 2 graph.

    Attributes:
        domain: ``ROS_DOMAIN_ID``, 0 to 232.
        namespace: ``"/"``, or such as ``"/robot1"``.
        name: Of the node.

    Raises:
        SettingError: One of them is none in ROS 2.
    """

    domain: int = 0
    namespace: str = "/"
    name: str = "foretouch"

    def __post_init__(self) -> None:
        if not 0 <= self.domain <= LARGEST_DOMAIN:
            raise SettingError("domain", self.domain, f"must be 0 to {LARGEST_DOMAIN}, as ROS_DOMAIN_ID")
        if not _NAMESPACE.fullmatch(self.namespace):
            rule = "must be /, or names of letters, digits and _ with a / before each, such as /robot1"
            raise SettingError("namespace", self.namespace, rule)
        if not _NAME.fullmatch(self.name):
            raise SettingError("node", self.name, "must be letters, digits and _, and not begin with a digit")

    def full_name(self, topic: str) -> str:
        """Name of a topic (``"/follower/wrench"``) in this node's namespace."""
        return self.namespace.rstrip("/") + topic

    def topic_key(self, topic: str, kind: TopicType) -> str:
        """Key under which messages of a topic go: ``DOMAIN/NAME/TYPE/HASH``."""
        return f"{self.domain}/{self.full_name(topic)[1:]}/{dds_type(kind.name)}/{kind.hash}"

    def token(self, session: str, number: int) -> str:
        """Liveliness token of the node itself.

        ``@ros2_lv/DOMAIN/SESSION/NODE/NODE/NN/ENCLAVE/NAMESPACE/NAME``; there is no enclave.

        Args:
            session: Zenoh identifier of the session.
            number: Of the node in the session.
        """
        return "/".join([self._begin(session, number), str(number), "NN", self._place])

    def publisher_token(self, session: str, numbers: tuple[int, int], topic: str, kind: TopicType, qos: Qos) -> str:
        """Liveliness token of a publisher.

        ``@ros2_lv/DOMAIN/SESSION/NODE/ENTITY/MP/ENCLAVE/NAMESPACE/NAME/TOPIC/TYPE/HASH/QOS``.

        Args:
            session: Zenoh identifier of the session.
            numbers: Of the node and of the publisher in the session.
            topic: Name without the namespace.
            kind: What it carries.
            qos: How.
        """
        node, entity = numbers
        what = [_mangled(self.full_name(topic)), dds_type(kind.name), kind.hash, qos.token]
        return "/".join([self._begin(session, node), str(entity), "MP", self._place, *what])

    def _begin(self, session: str, node: int) -> str:
        return f"@ros2_lv/{self.domain}/{session}/{node}"

    @property
    def _place(self) -> str:
        return f"%/{_mangled(self.namespace)}/{self.name}"


def dds_type(type_name: str) -> str:
    """Name of a message type in keys: ``geometry_msgs::msg::dds_::WrenchStamped_``."""
    *spaces, name = type_name.split("/")
    return "::".join([*spaces, "dds_", f"{name}_"])


def _mangled(name: str) -> str:
    """A name as one part of a key."""
    return name.replace("/", "%")
