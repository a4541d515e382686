"""Data that `rmw_zenoh_cpp` writes beside the messages: keys of topics, liveliness tokens, attachments.

Source of keys and tokens: "Topic and Service name mapping" and "Graph Cache" in its ``docs/design.md``, and its
``liveliness_utils.cpp``. With every message go its number, when it was sent, and its publisher's identifier, which is
the XXH3 hash, 128 bits, of the publisher's liveliness token, so that a reader of the token knows the identifier that
comes with the messages. Source of the hash: ``doc/xxhash_spec.md`` of https://github.com/Cyan4973/xxHash, with seed 0
and the default secret. Publishers' tokens are longer than 128 bytes (the type's hash alone has 71), so that the two
forms for longer input are all there is here.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Final

from foretouch.errors import SettingError

BEST_EFFORT: Final = 2  # Number of that reliability in ``rmw/types.h``; a token without one means reliable
USUAL_DEPTH: Final = 42  # Depth that a token without one means (``rmw_zenoh_cpp``, ``qos.cpp``)


@dataclass(frozen=True)
class Qos:
    """A profile: volatile, the newest kept, without deadline or lifespan.

    Attributes:
        reliable: Whether it is reliable, and not best effort.
        depth: Number of messages that are kept.
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

NEWEST: Final = Qos(reliable=True, depth=1)
"""What commands: reliable, so that every subscription takes it, and only the newest kept."""


LARGEST_DOMAIN: Final = 232  # Largest ``ROS_DOMAIN_ID`` with any middleware

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_NAMESPACE = re.compile(r"/|(/[A-Za-z_][A-Za-z0-9_]*)+")


@dataclass(frozen=True)
class TopicType:
    """The message type of a topic.

    Attributes:
        name: Name of the message type, such as ``"geometry_msgs/msg/WrenchStamped"``.
        hash: `foretouch.ros2.graph` of its definition.
    """

    name: str
    hash: str


@dataclass(frozen=True)
class Node:
    """A node of the ROS 2 graph.

    Attributes:
        domain: ``ROS_DOMAIN_ID``, 0 to 232.
        namespace: ``"/"``, or such as ``"/robot1"``.
        name: Name of the node.

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
            number: Number of the node in the session.
        """
        return self._entity(session, number, number, "NN")

    def publisher_token(self, session: str, numbers: tuple[int, int], topic: str, kind: TopicType, qos: Qos) -> str:
        """Liveliness token of a publisher.

        ``@ros2_lv/DOMAIN/SESSION/NODE/ENTITY/MP/ENCLAVE/NAMESPACE/NAME/TOPIC/TYPE/HASH/QOS``.

        Args:
            session: Zenoh identifier of the session.
            numbers: Numbers of the node and of the publisher in the session.
            topic: Name without the namespace.
            kind: The type that it carries.
            qos: How.
        """
        return self._endpoint(self._entity(session, *numbers, "MP"), topic, kind, qos)

    def subscription_token(self, session: str, numbers: tuple[int, int], topic: str, kind: TopicType, qos: Qos) -> str:
        """Liveliness token of a subscription: that of a publisher with ``MS`` in place of ``MP``.

        Args:
            session: Zenoh identifier of the session.
            numbers: Numbers of the node and of the subscription in the session.
            topic: Name without the namespace.
            kind: The type that it takes.
            qos: How.
        """
        return self._endpoint(self._entity(session, *numbers, "MS"), topic, kind, qos)

    def subscriptions(self, topic: str, kind: TopicType) -> str:
        """Pattern of the tokens of all subscriptions, of any node, to a topic (without the namespace) of that type."""
        what = [self.full_name(topic).replace("/", "%"), dds_type(kind.name), kind.hash]
        return "/".join(["@ros2_lv", str(self.domain), *"***", "MS", *"***", *what, "*"])

    def _endpoint(self, entity: str, topic: str, kind: TopicType, qos: Qos) -> str:
        what = [self.full_name(topic).replace("/", "%"), dds_type(kind.name), kind.hash, qos.token]
        return "/".join([entity, *what])

    def _entity(self, session: str, node: int, number: int, kind: str) -> str:
        namespace = self.namespace.replace("/", "%")
        return f"@ros2_lv/{self.domain}/{session}/{node}/{number}/{kind}/%/{namespace}/{self.name}"


def dds_type(type_name: str) -> str:
    """Name of a message type in keys: ``geometry_msgs::msg::dds_::WrenchStamped_``."""
    *spaces, name = type_name.split("/")
    return "::".join([*spaces, "dds_", f"{name}_"])


SHORTEST: Final = 129  # Bytes of the shortest text that has an identifier here

LONGEST_MIDDLE: Final = 240
STRIPE, LANES, SECRET_STEP = 64, 8, 8

PRIME32_1, PRIME32_2, PRIME32_3 = 0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D
PRIME64_1, PRIME64_2, PRIME64_3 = 0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9
PRIME64_4, PRIME64_5 = 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5
PRIME_MX1: Final = 0x165667919E3779F9

SECRET: Final = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671f"
    "cb79e64eccc0e578825ad07dccff7221b8084674f743248ee03590e6813a264c"
    "3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364"
    "eac5ac8334d3ebc3c581a0fffa1363eb170ddd51b7f0da49d316552629d4689e"
    "2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
)

_WHOLE = (1 << 64) - 1
_HALF = (1 << 32) - 1
_two = struct.Struct("<2Q")
_eight = struct.Struct("<8Q")


def publisher_gid(token: str) -> bytes:
    """Identifier of the publisher with this liveliness token, 16 bytes: low half, high half, each little endian.

    Raises:
        ValueError: The token is shorter than `SHORTEST`, and none of a publisher.
    """
    data = token.encode()
    if len(data) < SHORTEST:
        raise ValueError(f"a publisher's liveliness token has at least {SHORTEST} bytes, and not {len(data)}")
    return _two.pack(*(_middle(data) if len(data) <= LONGEST_MIDDLE else _long(data)))


def _folded(one: int, other: int) -> int:
    """The 128-bit product of two 64-bit numbers, its halves combined."""
    product = one * other
    return (product ^ (product >> 64)) & _WHOLE


def _avalanche(value: int) -> int:
    value = ((value ^ (value >> 37)) * PRIME_MX1) & _WHOLE
    return value ^ (value >> 32)


def _mixed(data: bytes, offset: int, secret: int) -> int:
    """16 bytes of the input with 16 of the secret."""
    low, high = _two.unpack_from(data, offset)
    key_low, key_high = _two.unpack_from(SECRET, secret)
    return _folded(low ^ key_low, high ^ key_high)


def _pair(data: bytes, first: int, second: int, secret: int, state: tuple[int, int]) -> tuple[int, int]:
    """Both halves after 32 bytes of the input, 16 at either offset."""
    low = (state[0] + _mixed(data, first, secret)) & _WHOLE
    high = (state[1] + _mixed(data, second, secret + 16)) & _WHOLE
    return low ^ (sum(_two.unpack_from(data, second)) & _WHOLE), high ^ (sum(_two.unpack_from(data, first)) & _WHOLE)


def _middle(data: bytes) -> tuple[int, int]:
    """Hash of 129 to 240 bytes."""
    length = len(data)
    state = (length * PRIME64_1) & _WHOLE, 0
    for block in range(4):
        state = _pair(data, 32 * block, 32 * block + 16, 32 * block, state)
    state = _avalanche(state[0]), _avalanche(state[1])
    for block in range(4, length // 32):
        state = _pair(data, 32 * block, 32 * block + 16, 3 + 32 * (block - 4), state)
    low, high = _pair(data, length - 16, length - 32, 136 - 17 - 16, state)
    mixed = (low * PRIME64_1 + high * PRIME64_4 + length * PRIME64_2) & _WHOLE
    return _avalanche((low + high) & _WHOLE), -_avalanche(mixed) & _WHOLE


def _accumulate(lanes: list[int], data: bytes, offset: int, secret: int) -> None:
    """Take a stripe of 64 bytes into the eight lanes."""
    values, keys = _eight.unpack_from(data, offset), _eight.unpack_from(SECRET, secret)
    for lane, (value, key) in enumerate(zip(values, keys, strict=True)):
        keyed = value ^ key
        lanes[lane ^ 1] = (lanes[lane ^ 1] + value) & _WHOLE
        lanes[lane] = (lanes[lane] + (keyed & _HALF) * (keyed >> 32)) & _WHOLE


def _merged(lanes: list[int], secret: int, start: int) -> int:
    keys = _eight.unpack_from(SECRET, secret)
    mixed = [lane ^ key for lane, key in zip(lanes, keys, strict=True)]
    return _avalanche((start + sum(_folded(mixed[i], mixed[i + 1]) for i in range(0, LANES, 2))) & _WHOLE)


def _long(data: bytes) -> tuple[int, int]:
    """Hash of more than 240 bytes."""
    lanes = [PRIME32_3, PRIME64_1, PRIME64_2, PRIME64_3, PRIME64_4, PRIME32_2, PRIME64_5, PRIME32_1]
    length = len(data)
    in_block = (len(SECRET) - STRIPE) // SECRET_STEP
    for stripe in range((length - 1) // STRIPE):
        _accumulate(lanes, data, STRIPE * stripe, SECRET_STEP * (stripe % in_block))
        if stripe % in_block == in_block - 1:
            keys = _eight.unpack_from(SECRET, len(SECRET) - STRIPE)
            lanes = [((lane ^ (lane >> 47) ^ key) * PRIME32_1) & _WHOLE for lane, key in zip(lanes, keys, strict=True)]
    _accumulate(lanes, data, length - STRIPE, len(SECRET) - STRIPE - 7)
    low = _merged(lanes, 11, length * PRIME64_1)
    return low, _merged(lanes, len(SECRET) - STRIPE - 11, ~(length * PRIME64_2) & _WHOLE)


_LAYOUT = struct.Struct("<qqB16s")


def attachment(number: int, sent_ns: int, gid: bytes) -> bytes:
    """The 33 bytes of an attachment, as Zenoh's serialiser makes them of two integers and an array.

    Little endian: the number (int64), the time (int64), the length of what follows (16, one byte), the identifier; see
    "Publishers" in ``docs/design.md`` of `rmw_zenoh_cpp`. So it is since its 0.2.4 (Jazzy) and 0.6.0 (Kilted, Rolling);
    before, names stood between the numbers. A message without an attachment is dropped there.

    Args:
        number: Number of the message at its publisher, from 1.
        sent_ns: Nanoseconds since 1970 when it was sent.
        gid: Identifier of the publisher, 16 bytes.
    """
    return _LAYOUT.pack(number, sent_ns, len(gid), gid)
