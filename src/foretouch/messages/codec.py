"""Messages to bytes and back (msgpack, strict, no pickle), and the table of what is sent, one row a channel."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec

from foretouch.errors import DecodeError, PeerVersionError, printable
from foretouch.messages import schema, states
from foretouch.messages.schema import SPEAKERS, VERSION, Message


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel of a session.

    Attributes:
        name: Last part of the network key.
        kind: The message class it carries.
        sender: ``"leader"``, ``"follower"``, ``"camera"``, ``"console"`` or ``"any"``.
        rate: Messages a second, 0 where they come on an event.
    """

    name: str
    kind: type[Message]
    sender: str
    rate: float


CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel("command", schema.Command, "leader", 1000.0),
        Channel("model", schema.ModelUpdate, "follower", 50.0),
        Channel("telemetry", states.Telemetry, "follower", 1000.0),
        Channel("leader", states.LeaderState, "leader", 1000.0),
        Channel("field", states.FieldUpdate, "follower", 5.0),
        Channel("fixture", states.FixtureBelief, "camera", 30.0),
        Channel("image", states.CameraImage, "camera", 30.0),
        Channel("handle", schema.Handle, "console", 0.0),
        Channel("settings", schema.Settings, "console", 0.0),
        Channel("choice", schema.Choice, "console", 0.0),
        Channel("stop", schema.Stop, "any", 0.0),
        Channel("emergency", schema.EmergencyStop, "any", 0.0),
        Channel("hello", schema.Hello, "any", 2.0),
        Channel("forth", schema.LeaderPacket, "leader", 1000.0),
        Channel("back", schema.FollowerPacket, "follower", 1000.0),
        Channel("small", schema.SmallImage, "camera", 1.0),
    )
}
"""Every channel of a session by name."""


M = TypeVar("M", bound=Message)

_encoder = msgspec.msgpack.Encoder()
_decoder = functools.cache(msgspec.msgpack.Decoder)

LARGEST_MESSAGE = 48_000
"""Largest message [bytes]: longer ones are neither sent nor read.

The low-latency transport sends a message as one batch or drops it without a word, and a batch is the largest multiple
of half the connection's segment below 64 kB: 49,152 bytes on loopback, more on any Ethernet. What is left is for its
header.
"""


def encode(message: Message) -> bytes:
    """Message as msgpack bytes."""
    return _encoder.encode(message)


def decode(data: bytes, kind: type[M]) -> M:
    """Message of the kind that a channel carries, from msgpack bytes; what is not printable in its texts is escaped.

    Raises:
        PeerVersionError: The bytes are a message of another schema version.
        DecodeError: They are anything else that is not such a message; the text says what.
    """
    if len(data) > LARGEST_MESSAGE:
        raise DecodeError(f"{len(data)} bytes, at most {LARGEST_MESSAGE} are read")
    try:
        message: M = _decoder(kind).decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        fields = _fields_of(data)
        if fields and type(fields[0]) is int and fields[0] != VERSION:  # any schema begins with its version
            raise PeerVersionError(fields[0], VERSION) from None
        raise DecodeError(f"not a {kind.__name__}: {error}") from None
    if message.version != VERSION:
        raise PeerVersionError(message.version, VERSION)
    return as_printed(message)


def as_printed(message: M) -> M:
    """The same message with what is not printable in its texts escaped (`foretouch.errors.printable`).

    Texts are for people, who see them in terminals, consoles and reports; a peer or a file could do more than be read.
    """
    changed: dict[str, Any] = {}
    for name in _text_fields(type(message)):
        value = getattr(message, name)
        if isinstance(value, str):
            if not value.isprintable():
                changed[name] = printable(value)
        elif not all(map(str.isprintable, value)):
            changed[name] = tuple(map(printable, value))
    return msgspec.structs.replace(message, **changed) if changed else message


@functools.cache
def _text_fields(kind: type[Message]) -> tuple[str, ...]:
    types = {field.name: msgspec.inspect.type_info(field.type) for field in msgspec.structs.fields(kind)}
    elements = {name: getattr(found, "item_type", found) for name, found in types.items()}
    return tuple(name for name, found in elements.items() if isinstance(found, msgspec.inspect.StrType))


def foreign_speaker(data: bytes) -> str:
    """The role of `SPEAKERS` that sent a hello in another version; "" where the bytes are no such hello."""
    fields = _fields_of(data)
    role = fields[3] if len(fields) > 3 else ""
    return role if isinstance(role, str) and role in SPEAKERS else ""


def _fields_of(data: bytes) -> list[Any]:
    """The fields of a message of any schema; none where the bytes are no array."""
    try:
        fields = msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return []
    return fields if isinstance(fields, list) else []
