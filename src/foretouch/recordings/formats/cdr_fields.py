"""Numbers out of CDR bytes of any ROS 2 type, all messages of a topic at once.

Messages of one topic mostly differ in numbers only: texts and sequences keep their lengths. So the first is walked
through field by field, and its places serve all others that have the same lengths in the same places; what is left is
walked through again, until nothing is left.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Definitions = Mapping[str, tuple[Any, Sequence[tuple[str, Any]]]]
"""Type name to constants and fields, as `rosbags` parses them."""

BASE, NAME, ARRAY, SEQUENCE = 1, 2, 3, 4
"""What a field is, as `rosbags` counts."""

STAMP: Final = ("header.stamp.sec", "header.stamp.nanosec")
_CODES: Final = {
    "bool": "u1", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_ORIGIN = 4  # bytes of the encapsulation header, from behind which alignment counts
_LONGEST = 256  # messages within a sequence that are gone into
_MOST_LAYOUTS = 50
_MOST_FIELDS = 65_536  # of one message that are looked at: sequences of as many parts, each of as many fields
_DEEPEST = 32  # messages within messages: a type that contains itself has no end
_index = re.compile(r"(.*)\[([^\[\]]+)\]\Z")


class Places:
    """Where each number of one message stands.

    Args:
        data: CDR bytes of the message.
        definitions: Of its type and those within.
        type_name: Of its type.

    Attributes:
        numbers: Field name to dtype, offset, and count where it is an array.
        texts: Field name of a sequence of texts to the texts, each with its offset.
        lengths: Offsets of the uint32 that say how long texts and sequences are.
        problem: Why the rest of the message was not gone into, or empty.

    Raises:
        ValueError: The bytes are in no CDR that is known here.
    """

    def __init__(self, data: bytes, definitions: Definitions, type_name: str) -> None:
        if len(data) < _ORIGIN or data[0] != 0 or data[1] not in (0, 1):
            raise ValueError(f"encapsulation {data[:2].hex()} is not CDR of ROS 2 (0000 or 0001)")
        self._data, self._definitions, self._order = data, definitions, "<" if data[1] else ">"
        self._position, self._visited = _ORIGIN, 0
        self.numbers: dict[str, tuple[str, int, int | None]] = {}
        self.texts: dict[str, list[tuple[int, str]]] = {}
        self.lengths: list[int] = []
        self.problem = ""
        try:
            self._message(type_name, "")
        except (ValueError, struct.error, KeyError) as error:
            self.problem = f"no type {error}" if isinstance(error, KeyError) else str(error)

    def find(self, field: str) -> tuple[str, int] | None:
        """Dtype and offset of a field; of an array, ``name[2]``, or ``position[elbow]`` by the texts in ``name``."""
        whole = self.numbers.get(field)
        if whole is not None:
            return whole[:2] if whole[2] is None else None
        match = _index.match(field)
        if match is None or match[1] not in self.numbers:
            return None
        code, offset, count = self.numbers[match[1]]
        place = self._place(match[1], match[2])
        if place is None or count is None or not 0 <= place < count:
            return None
        return code, offset + place * np.dtype(code).itemsize

    def _place(self, name: str, index: str) -> int | None:
        if index.isdecimal():
            return int(index)
        texts = [text for _, text in self.texts.get(_names_beside(name), [])]
        return texts.index(index) if index in texts else None

    def fields(self, most: int = 32) -> Iterator[tuple[str, str, int]]:
        """Name, dtype and offset of each number, of arrays the first `most`."""
        for name, (code, offset, count) in self.numbers.items():
            if count is None:
                yield name, code, offset
                continue
            for place in range(min(count, most)):
                yield f"{name}[{place}]", code, offset + place * np.dtype(code).itemsize

    def same(self, table: NDArray[np.uint8], fields: Sequence[str], end: int) -> NDArray[np.bool_]:
        """Which rows of bytes have these places too, as far as bytes before `end` go."""
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
        if kind == BASE:
            self._base(detail[0], name)
        elif kind == NAME:
            self._message(detail, name + ".")
        else:
            element, count = detail
            self._many(element, self._length() if kind == SEQUENCE else int(count), name)

    def _base(self, base: str, name: str) -> None:
        if base == "string":
            self._text()
        else:
            self.numbers[name] = *self._skip(base, 1), None

    def _many(self, element: Any, count: int, name: str) -> None:
        if int(element[0]) == NAME:
            if count > _LONGEST:
                raise ValueError(f"{name} has {count} parts: only what stands before it is read")
            for place in range(count):
                self._message(element[1], f"{name}[{place}].")
        elif element[1][0] == "string":
            self.texts[name] = [self._text() for _ in range(min(count, len(self._data)))]
        elif count:
            self.numbers[name] = *self._skip(element[1][0], count), count

    def _skip(self, base: str, count: int) -> tuple[str, int]:
        if base not in _CODES:
            raise ValueError(f"{base} is not read")
        size = int(_CODES[base][1])
        offset = self._position + -(self._position - _ORIGIN) % size
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

    Raises:
        ValueError: Bytes that are in no CDR that is known here.
    """
    values = {field: np.zeros(len(raws)) for field in fields}
    present = np.zeros(len(raws), dtype=np.bool_)
    sizes = np.fromiter(map(len, raws), dtype=np.int64, count=len(raws))
    layouts = 0
    for size in np.unique(sizes):
        left = np.flatnonzero(sizes == size)
        table = np.frombuffer(b"".join([raws[place] for place in left.tolist()]), np.uint8).reshape(left.size, size)
        while left.size:
            places = Places(raws[int(left[0])], definitions, type_name)
            found = {field: places.find(field) for field in fields}
            whole = {field: place for field, place in found.items() if place is not None}
            end = max((offset + 8 for _, offset in whole.values()), default=int(size))
            layouts += 1
            if layouts > _MOST_LAYOUTS:  # each message is another: one by one, so that it stays linear
                same = np.arange(left.size) == 0
                rows, left, table = table[:1], left, table
            else:
                same = places.same(table, fields, end if len(whole) == len(found) else int(size))
                rows = table[same]
            if len(whole) == len(found):
                chosen = left[same]
                present[chosen] = True
                for field, (code, offset) in whole.items():
                    width = np.dtype(code).itemsize
                    values[field][chosen] = np.ascontiguousarray(rows[:, offset : offset + width]).view(code)[:, 0]
            if layouts > _MOST_LAYOUTS:
                left, table = left[1:], table[1:]
            else:
                left, table = left[~same], table[~same]
    return values, present


def _names_beside(name: str) -> str:
    """The field of texts that names the elements of an array beside it, as in a JointState."""
    return name.rpartition(".")[0] + ".name" if "." in name else "name"
