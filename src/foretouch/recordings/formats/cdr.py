"""Messages as ROS 2 messages: schema text and CDR bytes, both derived from the fields of the message class.

CDR as ROS 2 uses it ("XCDR version 1", OMG DDSI-RTPS 10.2): four bytes of encapsulation header (here: little endian),
then the fields in order, each number aligned to its own size counted from behind that header; a string is its length
with the closing NUL as uint32, the UTF-8 bytes and the NUL; a sequence is its length as uint32 and the elements; bytes
are a sequence of uint8.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from foretouch.messages import Message

HEADER = b"\x00\x01\x00\x00"
"""Encapsulation header: CDR, little endian, no options."""

BYTES = "uint8[]"
_NUMBERS = {"bool": "?", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float64": "d"}
_DTYPES = {"i": "i4", "I": "u4", "q": "i8", "Q": "u8", "d": "f8"}
_SCALARS: dict[type[msgspec.inspect.Type], str] = {
    msgspec.inspect.BoolType: "bool",
    msgspec.inspect.IntType: "int64",
    msgspec.inspect.FloatType: "float64",
    msgspec.inspect.StrType: "string",
}


class Layout:
    """How one class of messages looks as a ROS 2 message.

    Attributes:
        kind: The message class.
        schema: Definition of the message in the ``.msg`` language, one line a field.
        missing: Fields that are not in the bytes, with the value that they then have.
        dtype: The CDR bytes of one message as a structured dtype, header included, where all messages of the class
            have one size; None where they hold text or sequences.

    Raises:
        TypeError: A field has a type that has no counterpart here.
    """

    def __init__(self, kind: type[Message]) -> None:
        self._set(kind, _ros_types(kind))
        self.missing: dict[str, Any] = {}

    def _set(self, kind: type[Message], types: dict[str, str]) -> None:
        self.kind, self._types = kind, types
        self.schema = "".join(f"{ros_type} {name}\n" for name, ros_type in self._types.items())
        self.dtype: np.dtype[np.void] | None = None
        if all(ros_type in _NUMBERS for ros_type in self._types.values()):
            self.dtype, self._struct = _fixed(self._types)

    def pack(self, message: Message) -> bytes:
        """CDR bytes of a message of this class."""
        if self.dtype is not None:
            return self._struct.pack(HEADER, *msgspec.structs.astuple(message))
        return pack_fields(self._types, msgspec.structs.astuple(message))

    def of_schema(self, schema: str) -> Layout | None:
        """How messages of this class look in a file that says so itself, or None where that is another class.

        A field that the file has not must have a default; one that only the file has is not looked at.
        """
        if schema == self.schema:
            return self
        theirs, defaults = _parsed(schema), _defaults(self.kind)
        missing = self._types.keys() - theirs.keys()
        other_types = any(theirs.get(name, ros_type) != ros_type for name, ros_type in self._types.items())
        if other_types or not missing <= defaults.keys():
            return None
        other = Layout(self.kind)
        other._set(self.kind, theirs)
        other.missing = {name: defaults[name] for name in missing}
        return None if (other.dtype is None) != (self.dtype is None) else other

    def unpack(self, data: bytes) -> Message:
        """Message from its CDR bytes.

        Raises:
            ValueError: The bytes are no such message.
        """
        try:
            values = dict(zip(self._types, _unpack(self._types, data), strict=True))
        except (struct.error, IndexError, UnicodeDecodeError) as error:
            raise ValueError(f"not a {self.kind.__name__}: {error}") from None
        return self.kind(**{name: values[name] for name in self.kind.__struct_fields__ if name in values})


def _ros_types(kind: type[Message]) -> dict[str, str]:
    """Field name to ROS 2 type."""
    described = msgspec.inspect.type_info(kind)
    assert isinstance(described, msgspec.inspect.StructType)
    return {field.name: _ros_type(kind, field) for field in described.fields}


def _parsed(schema: str) -> dict[str, str]:
    """Field name to ROS 2 type of a ``.msg`` definition; empty where it holds what is not known here."""
    scalars = (*_NUMBERS, "string")
    known = {*scalars, *(f"{scalar}[]" for scalar in scalars), BYTES}
    lines = [line.split() for line in schema.splitlines()]
    if not all(len(words) == 2 and words[0] in known for words in lines):
        return {}
    return {name: ros_type for ros_type, name in lines}


def _defaults(kind: type[Message]) -> dict[str, Any]:
    """The fields that have a default, with it."""
    described = msgspec.inspect.type_info(kind)
    assert isinstance(described, msgspec.inspect.StructType)
    return {field.name: field.default for field in described.fields if field.default is not msgspec.NODEFAULT}


def _ros_type(kind: type[Message], field: msgspec.inspect.Field) -> str:
    element, suffix = field.type, ""
    if isinstance(element, msgspec.inspect.BytesType):
        return BYTES
    if isinstance(element, msgspec.inspect.VarTupleType):
        element, suffix = element.item_type, "[]"
    ros_type = _SCALARS.get(type(element))
    if ros_type is None:
        raise TypeError(f"{kind.__name__}.{field.name} has a type without a ROS 2 counterpart: {element}")
    return ros_type + suffix


def _fixed(types: dict[str, str]) -> tuple[np.dtype[np.void], struct.Struct]:
    """Dtype and struct of a message that holds numbers only; both with the padding that alignment asks for."""
    formats, offsets, layout = [], [], "<4s"
    for ros_type in types.values():
        code = _NUMBERS[ros_type]
        size = struct.calcsize("<" + code)
        offset = struct.calcsize(layout)
        padding = -(offset - len(HEADER)) % size
        layout += f"{padding}x{code}" if padding else code
        formats.append("<" + _DTYPES[code] if size > 1 else "?")
        offsets.append(offset + padding)
    columns = {"names": list(types), "formats": formats, "offsets": offsets, "itemsize": struct.calcsize(layout)}
    return np.dtype(columns), struct.Struct(layout)  # type: ignore[call-overload]  # the stubs know no dict of lists


def pack_fields(types: Mapping[str, str], values: Sequence[Any]) -> bytes:
    """CDR bytes of a message, header included.

    Args:
        types: Field name to ROS 2 type, in order: numbers, strings, and sequences of either. Of a message within the
            message the fields, one by one: CDR puts nothing around them.
        values: As many.

    Raises:
        struct.error: A value does not fit its type.
    """
    out = bytearray(HEADER)

    def number(code: str, value: Any) -> None:
        out.extend(bytes(-(len(out) - len(HEADER)) % struct.calcsize("<" + code)))
        out.extend(struct.pack("<" + code, value))

    def put(ros_type: str, value: Any) -> None:
        if ros_type == "string":
            text = value.encode()
            number("I", len(text) + 1)
            out.extend(text + b"\0")
        else:
            number(_NUMBERS[ros_type], value)

    for ros_type, value in zip(types.values(), values, strict=True):
        if ros_type == BYTES:
            number("I", len(value))
            out.extend(value)
        elif ros_type.endswith("[]"):
            number("I", len(value))
            for item in value:
                put(ros_type[:-2], item)
        else:
            put(ros_type, value)
    return bytes(out)


def _unpack(types: dict[str, str], data: bytes) -> list[Any]:
    position = len(HEADER)

    def number(code: str) -> Any:
        nonlocal position
        size = struct.calcsize("<" + code)
        position += -(position - len(HEADER)) % size
        position += size
        return struct.unpack_from("<" + code, data, position - size)[0]

    def take(ros_type: str) -> Any:
        nonlocal position
        if ros_type not in ("string", BYTES):
            return number(_NUMBERS[ros_type])
        length = number("I")
        position += length
        if position > len(data):
            raise IndexError("text beyond its end")
        content = data[position - length : position]
        return content if ros_type == BYTES else content[:-1].decode()

    return [
        tuple(take(ros_type[:-2]) for _ in range(number("I")))
        if ros_type.endswith("[]") and ros_type != BYTES
        else take(ros_type)
        for ros_type in types.values()
    ]
