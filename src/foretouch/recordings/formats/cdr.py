"""CDR: messages of ours as ROS 2 messages, and numbers out of the messages of others.

The schema text and the bytes of ours are both derived from the fields of the message class. Of others, all messages of
a topic are read at once: they mostly differ in numbers only, and texts and sequences keep their lengths. So the first
is walked through field by field, and its offsets serve all others that have the same lengths at the same offsets; the
rest is walked through again, until nothing is left.

CDR as ROS 2 uses it ("XCDR version 1", OMG DDSI-RTPS 10.2): four bytes of encapsulation header (here: little endian),
then the fields in order, each number aligned to its size counted from behind that header; a string is its length
with the closing NUL as uint32, the UTF-8 bytes and the NUL; a sequence is its length as uint32 and the elements; bytes
are a sequence of uint8.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from operator import attrgetter
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.messages import Message

HEADER = b"\x00\x01\x00\x00"  # encapsulation header: CDR, little endian, no options

BYTES = "uint8[]"
_NUMBERS = {"bool": "?", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float64": "d"}
_CODES: Final = {
    "bool": "u1", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_SCALARS: dict[type[msgspec.inspect.Type], str] = {
    msgspec.inspect.BoolType: "bool",
    msgspec.inspect.IntType: "int64",
    msgspec.inspect.FloatType: "float64",
    msgspec.inspect.StrType: "string",
}


class Layout:
    """How one class of messages looks as a ROS 2 message; a TypeError for a field of a type without a counterpart.

    What a message says in space is one of its own: `foretouch.messages.in_space`.
    ``missing`` has the values of those of its fields that are not in the bytes. Where all messages of the class have
    one size, ``dtype`` is the structured dtype of their bytes, header included, else None.
    """

    def __init__(self, kind: type[Message], types: dict[str, str] | None = None) -> None:
        self.kind, self.missing = kind, dict[str, Any]()
        self._types = {field.name: _ros_type(kind, field) for field in _fields(kind)} if types is None else types
        self.schema = "".join(f"{ros_type} {name}\n" for name, ros_type in self._types.items())
        self._values = attrgetter(*self._types)
        self.dtype: np.dtype[np.void] | None = None
        if all(ros_type in _NUMBERS for ros_type in self._types.values()):
            self.dtype, self._struct = _fixed(self._types)

    def pack(self, message: Message) -> bytes:
        """CDR bytes of a message of this class."""
        if self.dtype is not None:
            return self._struct.pack(HEADER, *self._values(message))
        return pack_fields(self._types, self._values(message))

    def of_schema(self, schema: str) -> Layout | None:
        """Layout of messages of this class in a file with its own schema, or None where that is another class.

        A field that the file has not must have a default; one that only the file has is not looked at.
        """
        if schema == self.schema:
            return self
        theirs = _parsed(schema)
        defaults = {one.name: one.default for one in _fields(self.kind) if one.default is not msgspec.NODEFAULT}
        missing = self._types.keys() - theirs.keys()
        other_types = any(theirs.get(name, ros_type) != ros_type for name, ros_type in self._types.items())
        if other_types or not missing <= defaults.keys():
            return None
        other = Layout(self.kind, theirs)
        other.missing = {name: defaults[name] for name in missing}
        return None if (other.dtype is None) != (self.dtype is None) else other

    def unpack(self, data: bytes) -> Message:
        """Message from its CDR bytes."""
        try:
            values = dict(zip(self._types, unpack_fields(self._types, data), strict=True))
        except ValueError as error:
            raise ValueError(f"not a {self.kind.__name__}: {error}") from None
        return self.kind(**{name: values[name] for name in self.kind.__struct_fields__ if name in values})


def _fields(kind: type[Message]) -> tuple[msgspec.inspect.Field, ...]:
    described = msgspec.inspect.type_info(kind)
    assert isinstance(described, msgspec.inspect.StructType)
    return tuple(field for field in described.fields if field.name != "space")


def _parsed(schema: str) -> dict[str, str]:
    """Field name to ROS 2 type of a ``.msg`` definition; empty where it holds what is not known here."""
    scalars = (*_NUMBERS, "string")
    known = {*scalars, *(f"{scalar}[]" for scalar in scalars), BYTES}
    lines = [line.split() for line in schema.splitlines()]
    whole = all(len(words) == 2 and words[0] in known for words in lines)
    return {name: ros_type for ros_type, name in lines} if whole else {}


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
        formats.append("<" + _CODES[ros_type] if size > 1 else "?")
        offsets.append(offset + padding)
    columns = {"names": list(types), "formats": formats, "offsets": offsets, "itemsize": struct.calcsize(layout)}
    return np.dtype(columns), struct.Struct(layout)  # type: ignore[call-overload]  # the stubs know no dict of lists


def pack_fields(types: Mapping[str, str], values: Sequence[Any]) -> bytes:
    """CDR bytes of a message, header included, by ROS 2 types in order; those of one within it one by one."""
    out = bytearray(HEADER)

    def number(code: str, value: Any) -> None:
        out.extend(bytes(-(len(out) - len(HEADER)) % struct.calcsize("<" + code)))
        out.extend(struct.pack("<" + code, value))

    def put(ros_type: str, value: Any) -> None:
        if ros_type in ("string", BYTES):
            content = value if ros_type == BYTES else value.encode() + b"\0"
            number("I", len(content))
            out.extend(content)
        elif ros_type.endswith("[]"):
            number("I", len(value))
            for item in value:
                put(ros_type[:-2], item)
        else:
            number(_NUMBERS[ros_type], value)

    for ros_type, value in zip(types.values(), values, strict=True):
        put(ros_type, value)
    return bytes(out)


def unpack_fields(types: Mapping[str, str], data: bytes) -> list[Any]:
    """Values of a message's fields, by ROS 2 types in order as for `pack_fields`; sequences as tuples.

    Raises:
        ValueError: The bytes end before the fields do, or hold a text that is none.
    """
    try:
        return _unpacked(types, data)
    except (struct.error, IndexError) as error:
        raise ValueError(str(error)) from None


def _unpacked(types: Mapping[str, str], data: bytes) -> list[Any]:
    position = len(HEADER)

    def number(code: str) -> Any:
        nonlocal position
        size = struct.calcsize("<" + code)
        position += -(position - len(HEADER)) % size
        position += size
        return struct.unpack_from("<" + code, data, position - size)[0]

    def take(ros_type: str) -> Any:
        nonlocal position
        if ros_type in _NUMBERS:
            return number(_NUMBERS[ros_type])
        if ros_type not in ("string", BYTES):
            return tuple(take(ros_type[:-2]) for _ in range(number("I")))
        length = number("I")
        position += length
        if position > len(data):
            raise IndexError("text beyond its end")
        content = data[position - length : position]
        return content if ros_type == BYTES else content[:-1].decode()

    return [take(ros_type) for ros_type in types.values()]


Array = NDArray[np.float64]
Definitions = Mapping[str, tuple[Any, Sequence[tuple[str, Any]]]]
"""Type name to constants and fields, as `rosbags` parses them."""

BASE, NAME, ARRAY, SEQUENCE = 1, 2, 3, 4  # what a field is, as `rosbags` counts

STAMP: Final = ("header.stamp.sec", "header.stamp.nanosec")
_LONGEST = 256  # messages within a sequence that are gone into
_MOST_LAYOUTS = 50
_MOST_FIELDS = 65_536  # of one message that are looked at: sequences of as many parts, each of as many fields
_DEEPEST = 32  # messages within messages: a type that contains itself has no end
_index = re.compile(r"(.*)\[([^\[\]]+)\]\Z")


class Places:
    """Offset of each number of one message; a ValueError where its bytes are in no CDR that is known here."""

    def __init__(self, data: bytes, definitions: Definitions, type_name: str) -> None:
        if len(data) < len(HEADER) or data[0] != 0 or data[1] not in (0, 1):
            raise ValueError(f"encapsulation {data[:2].hex()} is not CDR of ROS 2 (0000 or 0001)")
        self._data, self._definitions, self._order = data, definitions, "<" if data[1] else ">"
        self._position, self._visited = len(HEADER), 0
        self.numbers: dict[str, tuple[str, int, int | None]] = {}  # dtype, offset, and count where it is an array
        self.texts: dict[str, list[tuple[int, str]]] = {}  # of a sequence of texts, each with its offset
        self.lengths: list[int] = []  # offsets of the uint32 with the lengths of texts and sequences
        self.problem = ""  # why the rest of the message was not gone into
        try:
            self._message(type_name, "")
        except (ValueError, struct.error, KeyError) as error:
            self.problem = f"no type {error}" if isinstance(error, KeyError) else str(error)

    def find(self, field: str) -> tuple[str, int] | None:
        """Dtype and offset of a field; of an array, ``name[2]``, or ``position[elbow]`` by the texts in ``name``."""
        if field in self.numbers:
            code, offset, count = self.numbers[field]
            return (code, offset) if count is None else None
        match = _index.match(field)
        if match is None or match[1] not in self.numbers:
            return None
        code, offset, count = self.numbers[match[1]]
        texts = [text for _, text in self.texts.get(_names_beside(match[1]), [])]
        position = int(match[2]) if match[2].isdecimal() else texts.index(match[2]) if match[2] in texts else -1
        if count is None or not 0 <= position < count:
            return None
        return code, offset + position * np.dtype(code).itemsize

    def fields(self, most: int = 32) -> Iterator[tuple[str, str, int]]:
        """Name, dtype and offset of each number, of arrays the first `most`."""
        for name, (code, offset, count) in self.numbers.items():
            if count is None:
                yield name, code, offset
            for position in range(min(count or 0, most)):
                yield f"{name}[{position}]", code, offset + position * np.dtype(code).itemsize

    def same(self, table: NDArray[np.uint8], fields: Sequence[str], end: int) -> NDArray[np.bool_]:
        """Flags of the rows of bytes that have these offsets too, as far as bytes before `end` go."""
        spans = [(0, 2), *((offset, offset + 4) for offset in self.lengths if offset < end)]
        for field in fields:
            match = _index.match(field)
            if match is not None and not match[2].isdecimal():  # found by its name: then names must be the same
                names = self.texts.get(_names_beside(match[1]), [])
                spans += [(offset, offset + len(text.encode())) for offset, text in names]
        same = np.ones(len(table), dtype=np.bool_)
        for start, stop in spans:
            same &= (table[:, start:stop] == np.frombuffer(self._data[start:stop], np.uint8)).all(axis=1)
        return same

    # --- walking ------------------------------------------------------------------------------------------------------

    def _message(self, type_name: str, prefix: str) -> None:
        if prefix.count(".") > _DEEPEST:
            raise ValueError(f"{type_name} is nested deeper than {_DEEPEST} messages, perhaps within itself")
        self._visited += 1
        for name, description in self._definitions[type_name][1]:
            self._field(description, prefix + name)

    def _field(self, description: Any, name: str) -> None:
        self._visited += 1
        if self._visited > _MOST_FIELDS:
            raise ValueError(f"{name} comes after {_MOST_FIELDS} others: only what stands before it is read")
        kind, detail = int(description[0]), description[1]
        if kind == BASE and detail[0] == "string":
            self._text()
        elif kind == BASE:
            self.numbers[name] = *self._skip(detail[0], 1), None
        elif kind == NAME:
            self._message(detail, name + ".")
        else:
            element, count = detail
            self._many(element, self._length() if kind == SEQUENCE else int(count), name)

    def _many(self, element: Any, count: int, name: str) -> None:
        if int(element[0]) == NAME:
            if count > _LONGEST:
                raise ValueError(f"{name} has {count} parts: only what stands before it is read")
            for index in range(count):
                self._message(element[1], f"{name}[{index}].")
        elif element[1][0] == "string":
            self.texts[name] = [self._text() for _ in range(min(count, len(self._data)))]
        elif count:
            self.numbers[name] = *self._skip(element[1][0], count), count

    def _skip(self, base: str, count: int) -> tuple[str, int]:
        if base not in _CODES:
            raise ValueError(f"{base} is not read")
        size = int(_CODES[base][1])
        offset = self._position + -(self._position - len(HEADER)) % size
        self._position = offset + count * size
        if self._position > len(self._data):
            raise ValueError("a message ends before its fields do")
        return self._order + _CODES[base], offset

    def _length(self) -> int:
        _, offset = self._skip("uint32", 1)
        self.lengths.append(offset)
        return int(struct.unpack_from(self._order + "I", self._data, offset)[0])

    def _text(self) -> tuple[int, str]:
        length = self._length()
        _, offset = self._skip("uint8", length)
        return offset, self._data[offset : offset + max(length - 1, 0)].decode(errors="replace")


def extract(
    raws: Sequence[bytes], definitions: Definitions, type_name: str, fields: Sequence[str]
) -> tuple[dict[str, Array], NDArray[np.bool_]]:
    """Fields of all messages.

    Returns:
        Field name to numbers, shape (n,), 0 where a message has not all of the fields; and which have, shape (n,).
    """
    values = {field: np.zeros(len(raws)) for field in fields}
    present = np.zeros(len(raws), dtype=np.bool_)
    sizes = np.fromiter(map(len, raws), dtype=np.int64, count=len(raws))
    layouts = 0
    for size in np.unique(sizes):
        left = np.flatnonzero(sizes == size)
        table = np.frombuffer(b"".join([raws[index] for index in left.tolist()]), np.uint8).reshape(left.size, size)
        while left.size:
            positions = Places(raws[int(left[0])], definitions, type_name)
            whole = {field: index for field in fields if (index := positions.find(field)) is not None}
            end = max((offset + 8 for _, offset in whole.values()), default=int(size))
            complete = whole.keys() == set(fields)
            layouts += 1
            same: Any = slice(1)  # where each message is another: one by one, so that it stays linear
            others: Any = slice(1, None)
            if layouts <= _MOST_LAYOUTS:
                same = positions.same(table, fields, end if complete else int(size))
                others = ~same
            if complete:
                chosen, rows = left[same], table[same]
                present[chosen] = True
                for field, (code, offset) in whole.items():
                    width = np.dtype(code).itemsize
                    values[field][chosen] = np.ascontiguousarray(rows[:, offset : offset + width]).view(code)[:, 0]
            left, table = left[others], table[others]
    return values, present


def _names_beside(name: str) -> str:
    """The field of texts that names the elements of an array beside it, as in a JointState."""
    return name.rpartition(".")[0] + ".name" if "." in name else "name"
