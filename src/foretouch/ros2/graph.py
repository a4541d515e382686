"""A node on a live ROS 2 graph, without ROS 2: over Zenoh, as `rmw_zenoh_cpp` is there; and the topics it offers.

Topics are those of a recording, stamped anew. By the hash of its type ROS 2 tells definitions apart. A definition
becomes a ``type_description_interfaces/msg/TypeDescription``, default values and comments left out; the hash is the
SHA-256 of its JSON text, with ``RIHS01_`` before it. Source: REP-2011 ("Evolving message types"), REP-2016 ("Type
descriptions and hashes"), and ``rosidl_generator_type_description`` of ROS 2, whose JSON this is to the byte.
"""

from __future__ import annotations

import atexit
import functools
import hashlib
import json
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from foretouch.errors import LinkError
from foretouch.link import check_endpoint, is_encrypted
from foretouch.link.zenoh_link import zenoh_config, zenoh_module
from foretouch.messages import Message, Telemetry
from foretouch.recordings.formats.topics import BESIDE, FIXTURE_POSE, MODEL, NUMBERS, PROBE, StandardTopic, probe
from foretouch.ros2.keys import DEFAULT, SENSOR_DATA, Node, Qos, TopicType, attachment, publisher_gid

NESTED: Final = 1
"""Number of a field whose type is another message; see ``FieldType.msg`` of ``type_description_interfaces``."""

_INTEGERS: Final = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
_OTHERS: Final = {"float32": 10, "float64": 11, "bool": 15, "byte": 16, "string": 17, "wstring": 18}
TYPE_NUMBERS: Final = {name: number for number, name in enumerate(_INTEGERS, 2)} | _OTHERS
"""Number of each type that is no message, by its name in the ``.msg`` language."""

ARRAY, SEQUENCE = 48, 144
"""Numbers added to that of the element: for a field of fixed length, and for one of any."""

EMPTY: Final = ["uint8", "structure_needs_at_least_one_member"]
"""The one field of a message that has none: rosidl puts it there."""

_TYPE = re.compile(r"(?P<element>[A-Za-z][A-Za-z0-9_/]*)(?P<many>\[(?P<length>\d*)\])?")
_SEPARATOR = re.compile(r"^=+$", re.MULTILINE)


def type_hash(type_name: str, schema: str) -> str:
    """Hash of a message type.

    Args:
        type_name: Such as ``"geometry_msgs/msg/WrenchStamped"``.
        schema: As `type_description`.

    Returns:
        ``RIHS01_`` and 64 hexadecimal digits.

    Raises:
        ValueError: As `type_description`.
    """
    text = json.dumps(type_description(type_name, schema), separators=(", ", ": "))
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


def type_description(type_name: str, schema: str) -> dict[str, Any]:
    """The text that is hashed: the type and all that it refers to, these in the order of their names.

    Args:
        type_name: Such as ``"geometry_msgs/msg/WrenchStamped"``.
        schema: Its definition in the ``.msg`` language and behind it, each after a line of ``=`` and ``MSG: NAME``,
            that of every message in it, as MCAP and rosbag2 keep it.

    Raises:
        ValueError: A field is of a type that is not in `schema`, or that has no counterpart here (bounded ones).
    """
    first, *others = _SEPARATOR.split(schema)
    definitions = {type_name: first}
    for other in others:
        title, _, text = other.strip().partition("\n")
        definitions[_full_name(title.removeprefix("MSG:").strip(), type_name)] = text
    fields = {name: _fields(name, text, definitions) for name, text in definitions.items()}
    return {
        "type_description": {"type_name": type_name, "fields": fields[type_name]},
        "referenced_type_descriptions": [
            {"type_name": name, "fields": fields[name]} for name in sorted(_referenced(type_name, fields))
        ],
    }


def _full_name(name: str, beside: str) -> str:
    """Name with package and ``msg``; a bare one is of the package of the type beside it."""
    words = name.split("/")
    package = beside.split("/")[0] if len(words) == 1 else words[0]
    return f"{package}/msg/{words[-1]}"


def _fields(owner: str, text: str, definitions: dict[str, str]) -> list[dict[str, Any]]:
    lines = [line.split("#")[0].split() for line in text.splitlines()]
    # without constants: TYPE NAME=VALUE, spaces or not
    members = [words[:2] for words in lines if words and not ("=" in words[1] or words[2:3] == ["="])]
    return [_field(owner, ros_type, name, definitions) for ros_type, name in members or [EMPTY]]


def _field(owner: str, ros_type: str, name: str, definitions: dict[str, str]) -> dict[str, Any]:
    match = _TYPE.fullmatch(ros_type)
    if match is None:
        raise ValueError(f"{owner}.{name}: cannot describe the type {ros_type!r}")
    number, nested = TYPE_NUMBERS.get(match["element"]), ""
    if number is None:
        number, nested = NESTED, _full_name(match["element"], owner)
        if nested not in definitions:
            raise ValueError(f"{owner}.{name}: the definition of {nested} is not there")
    capacity = int(match["length"] or 0)
    if match["many"]:
        number += ARRAY if capacity else SEQUENCE
    described = {"type_id": number, "capacity": capacity, "string_capacity": 0, "nested_type_name": nested}
    return {"name": name, "type": described}


def _referenced(type_name: str, fields: dict[str, list[dict[str, Any]]]) -> set[str]:
    """Every message inside a message, at any depth."""
    names: set[str] = set()
    waiting = [type_name]
    while waiting:
        inside = {field["type"]["nested_type_name"] for field in fields[waiting.pop()]} - {""} - names
        names |= inside
        waiting += inside
    return names


KEPT: Final = (MODEL.name, NUMBERS.name, FIXTURE_POSE.name)
"""Topics whose last message must not be missed: reliable. The others are streams of samples, as sensor data."""


@functools.cache
def type_of(topic: StandardTopic) -> TopicType:
    """Type of a topic with the hash of its definition."""
    return TopicType(topic.type_name, type_hash(topic.type_name, topic.schema))


def as_ros(message: Message, stamp_ns: int) -> tuple[tuple[StandardTopic, bytes], ...]:
    """The topics that say what a message says; none where it has no counterpart, or its sensors are not trusted."""
    make = BESIDE.get(type(message))
    if make is None or (isinstance(message, Telemetry) and message.validity):
        return ()
    stamped = msgspec.structs.replace(message, time_ns=stamp_ns)
    topics: tuple[tuple[StandardTopic, bytes], ...] = make(stamped)
    return (*topics, (PROBE, probe(stamped))) if isinstance(stamped, Telemetry) else topics


SETTINGS: Final = {
    "mode": "client",
    "connect/timeout_ms": 1000,  # of one attempt to reach the router
    "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2},
    "transport/link/protocols": ["tcp"],
}
DROPPED_AFTER: Final = "transport/link/tx/queue/congestion_control/drop/wait_before_drop"  # [us]
NODE_NUMBER = 0  # Number of the node in its session; publishers and subscriptions have the numbers behind it
LARGEST_HEARD = 65_536  # Bytes of a message that is taken; what is heard here has a few hundred


@dataclass
class _Publisher:
    """One topic that is offered: what sends it, its liveliness token, its identifier and how many went out."""

    publisher: Any
    token: Any
    gid: bytes
    sent: int = 0


class Graph:
    """A node with its publishers and subscriptions, on a Zenoh router where the ROS 2 graph meets.

    It is a client of the router: it listens on no port, and what it sends and hears goes through the router. A topic is
    offered from its first message on. Where the router goes away, Zenoh looks for it in the background, and offers and
    listens to everything again once it is back.

    Args:
        router: Endpoint, such as ``"tcp/127.0.0.1:7447"``.
        node: Name of the node.
        insecure: Allow a router off this machine without encryption.
        patience: Time that a message may wait for room on its way out before it is dropped [s].

    Attributes:
        unsent: Messages that were not sent, because there was no router or the network refused them.

    Raises:
        LinkError: The endpoint is malformed or not allowed.
        MissingExtraError: eclipse-zenoh is not installed.
    """

    def __init__(self, router: str, node: Node, *, insecure: bool = False, patience: float = 1e-3) -> None:
        self._zenoh = zenoh_module()
        check_endpoint(router, insecure=insecure)
        if is_encrypted(router):
            raise LinkError(f"router {router!r}: write it as tcp/HOST:PORT; keys for a ROS 2 graph are not read here")
        self._node = node
        self._session: Any = None
        self._token: Any = None
        self._settings = SETTINGS | {"connect/endpoints": [router], DROPPED_AFTER: round(1e6 * patience)}
        self._publishers: dict[str, _Publisher] = {}
        self._subscriptions: list[tuple[Any, Any]] = []  # each with its liveliness token
        self.unsent = 0

    @property
    def connected(self) -> bool:
        """Whether the router is there."""
        return self._session is not None and bool(self._session.info.routers_zid())

    @property
    def sent(self) -> dict[str, int]:
        """Messages sent, by full name of the topic."""
        return {self._node.full_name(name): publisher.sent for name, publisher in self._publishers.items()}

    def connect(self) -> bool:
        """Look for the router, for at most a second if it was never there; whether it is."""
        if self._session is None:
            try:
                self._session = self._zenoh.open(zenoh_config(self._settings))
            except self._zenoh.ZError:
                return False
            atexit.register(self.close)
            token = self._node.token(self._id, NODE_NUMBER)
            self._token = self._session.liveliness().declare_token(token)
        return self.connected

    def publish(self, topic: StandardTopic, data: bytes, qos: Qos | None = None) -> None:
        """Send a message; never waits beyond the patience and never raises.

        Args:
            topic: Topic to publish on.
            data: CDR bytes of the message.
            qos: How the topic is offered with its first message; without it as the session's topics are.
        """
        if self._session is None:
            self.unsent += 1
            return
        try:
            there = self._publishers.get(topic.name)
            if there is None:
                there = self._publishers[topic.name] = self._offer(topic, qos)
            there.publisher.put(data, attachment=attachment(there.sent + 1, time.time_ns(), there.gid))
        except self._zenoh.ZError:
            self.unsent += 1
        else:
            there.sent += 1

    def subscribe(self, topic: StandardTopic, take: Callable[[bytes], None], qos: Qos = SENSOR_DATA) -> None:
        """Listen to a topic, once connected.

        Args:
            topic: Topic to listen to.
            take: Gets the CDR bytes of each message, on a thread of Zenoh's; it must not raise.
            qos: How, for those who look at the graph; best effort takes what any publisher sends.
        """
        kind = type_of(topic)
        token = self._node.subscription_token(self._id, self._numbers(), topic.name, kind, qos)

        def receive(sample: Any) -> None:
            if len(sample.payload) <= LARGEST_HEARD:
                take(sample.payload.to_bytes())

        # On Zenoh's own thread: in one of Python's, which is the default, a process that forgets to close never ends.
        handler = self._zenoh.handlers.Callback(receive, indirect=False)
        subscriber = self._session.declare_subscriber(self._node.topic_key(topic.name, kind), handler)
        self._subscriptions.append((subscriber, self._session.liveliness().declare_token(token)))

    def is_heard(self, topic: StandardTopic) -> bool:
        """Whether somebody listens to a topic of that type, once connected; it waits for the answer, at most 1 s."""
        pattern = self._node.subscriptions(topic.name, type_of(topic))
        return any(reply.ok for reply in self._session.liveliness().get(pattern, timeout=1.0))

    def close(self) -> None:
        """Leave the graph: topics and node are gone from it at once."""
        if self._session is not None:
            self._session.close()
            self._session = None
            atexit.unregister(self.close)

    @property
    def _id(self) -> str:
        return str(self._session.info.zid())

    def _numbers(self) -> tuple[int, int]:
        """Numbers of the node and of what it offers or listens to next."""
        return NODE_NUMBER, NODE_NUMBER + 1 + len(self._publishers) + len(self._subscriptions)

    def _offer(self, topic: StandardTopic, qos: Qos | None) -> _Publisher:
        kind, qos = type_of(topic), qos or (DEFAULT if topic.name in KEPT else SENSOR_DATA)
        reliability = self._zenoh.Reliability.RELIABLE if qos.reliable else self._zenoh.Reliability.BEST_EFFORT
        token = self._node.publisher_token(self._id, self._numbers(), topic.name, kind, qos)
        publisher = self._session.declare_publisher(
            self._node.topic_key(topic.name, kind),
            congestion_control=self._zenoh.CongestionControl.DROP,
            reliability=reliability,
        )
        return _Publisher(publisher, self._session.liveliness().declare_token(token), publisher_gid(token))
