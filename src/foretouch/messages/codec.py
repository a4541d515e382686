"""Messages to bytes and back: msgpack, strict, no pickle."""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec

from foretouch.errors import DecodeError, PeerVersionError
from foretouch.messages.schema import VERSION, Message

__all__ = ["decode", "encode"]

M = TypeVar("M", bound=Message)

_encoder = msgspec.msgpack.Encoder()
_decoders: dict[type[Message], msgspec.msgpack.Decoder[Any]] = {}
LARGEST_MESSAGE = 65_536
"""Longer byte strings [bytes] are refused unread."""


def encode(message: Message) -> bytes:
    """Message as msgpack bytes."""
    return _encoder.encode(message)


def decode(data: bytes, kind: type[M]) -> M:
    """Message of one kind from msgpack bytes.

    Args:
        data: What arrived.
        kind: The message class that its channel carries.

    Raises:
        PeerVersionError: The bytes are a message of another schema version.
        DecodeError: They are anything else that is not such a message; the text says what.
    """
    if len(data) > LARGEST_MESSAGE:
        raise DecodeError(f"{len(data)} bytes, at most {LARGEST_MESSAGE} are read")
    decoder = _decoders.get(kind)
    if decoder is None:
        decoder = _decoders[kind] = msgspec.msgpack.Decoder(kind)
    try:
        message: M = decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        theirs = _version_of(data)
        if theirs is not None and theirs != VERSION:
            raise PeerVersionError(theirs, VERSION) from None
        raise DecodeError(f"not a {kind.__name__}: {error}") from None
    if message.version != VERSION:
        raise PeerVersionError(message.version, VERSION)
    return message


def _version_of(data: bytes) -> int | None:
    """The version that a message of any schema begins with, or None where there is none to read."""
    try:
        fields = msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    if isinstance(fields, list) and fields and type(fields[0]) is int:
        return fields[0]
    return None
