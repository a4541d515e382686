"""The messages in C: structs, tables and declarations, made from the classes of `foretouch.messages`.

What is written by hand reads and writes msgpack by tables (``c/foretouch_wire.c``). All that it knows of a message, and
all that a reader of the header is told, comes from here, and here from the class: names, order, types, limits, what a
field is where it is left out, and its description.
"""

from __future__ import annotations

import inspect
import re
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from foretouch.export.structs import comment, snake
from foretouch.link import CHANNEL_NUMBERS
from foretouch.messages import CHANNELS, LARGEST_MESSAGE, VERSION, FollowerPacket, LeaderPacket, SmallImage

FEW = 36
"""A list of at most so many numbers stands in its struct; a longer one is looked at where it lies."""

LARGEST_COUNT = 2**63 - 1

_CHOICES = re.compile(r"\^\(([a-z|]+)\)\\Z")
_NUMBERS, _TEXTS = "list of numbers", "list of texts"
_KINDS = {
    "version": ("VERSION", ""),
    "count": ("COUNT", "uint64_t"),
    "number": ("NUMBER", "double"),
    "flag": ("BOOLEAN", "bool"),
    "text": ("STRING", "foretouch_text"),
    "bytes": ("CONTENT", "foretouch_bytes"),
    _NUMBERS: ("MANY_NUMBERS", "foretouch_numbers"),
    _TEXTS: ("STRINGS", "foretouch_texts"),
}


@dataclass(frozen=True, slots=True)
class WireField:
    """One field of a message on the wire.

    Attributes:
        name: Its name, the same in Python and C.
        kind: ``"version"``, ``"count"``, ``"number"``, ``"flag"``, ``"text"``, ``"bytes"``, ``"list of numbers"``,
            ``"list of texts"``, or ``"record"``.
        most: Most characters, bytes or elements; 0 where it has no size.
        longest: Most characters of each of several texts.
        choices: Texts that it may be; any where there are none.
        rule: What else it has to be, in words; what has such a rule is not read in C.
        record: Class of a record, which may be absent.
        required: Whether it has to be there.
        missing: What it is where it is left out.
        about: Its description, with its unit.
    """

    name: str
    kind: str
    most: int
    longest: int
    choices: tuple[str, ...]
    rule: str
    record: type[msgspec.Struct] | None
    required: bool
    missing: Any
    about: str

    @property
    def in_place(self) -> bool:
        """Whether it is a list of numbers that stands in its struct."""
        return self.kind == _NUMBERS and self.most <= FEW


PACKETS = LeaderPacket, FollowerPacket, SmallImage


def kinds() -> tuple[type[msgspec.Struct], ...]:
    """Messages that are written in C: those of all channels but the console's and packets, which Python alone reads."""
    return tuple(one.kind for one in CHANNELS.values() if one.sender != "console" and one.kind not in PACKETS)


def fields_of(kind: type[msgspec.Struct]) -> tuple[WireField, ...]:
    """Fields of a message or of a record in it, in the order of the wire.

    Raises:
        TypeError: A field is of a type that no message has had so far.
    """
    info = msgspec.inspect.type_info(kind)
    assert isinstance(info, msgspec.inspect.StructType)
    about = _descriptions(kind)
    return tuple(_field(field, about[field.name]) for field in info.fields)


def summary_of(kind: type[msgspec.Struct]) -> str:
    """What a message is, as its class says: what stands before the list of its attributes, in one line."""
    return " ".join((inspect.getdoc(kind) or "").partition("Attributes:")[0].split())


def _descriptions(kind: type) -> dict[str, str]:
    """Description of each field, from the docstrings of a class and of those that it extends."""
    found: dict[str, str] = {}
    for one in kind.__mro__:
        _, _, listed = inspect.cleandoc(one.__dict__.get("__doc__") or "").partition("Attributes:\n")
        for entry in re.split(r"\n(?=    \w)", "\n" + listed):
            name, colon, text = entry.strip().partition(":")
            if colon:
                found.setdefault(name, " ".join(text.split()))
    return found


def _field(field: msgspec.inspect.Field, about: str) -> WireField:
    found, types = field.type, msgspec.inspect
    record, most, longest, rule = None, 0, 0, ""
    choices: tuple[str, ...] = ()
    if isinstance(found, types.IntType) and (found.ge, found.le) == (0, LARGEST_COUNT):
        kind = "version" if field.name == "version" else "count"
    elif isinstance(found, types.FloatType):
        kind, rule = "number", "" if found.le is None else f"{found.ge} to {found.le}"
    elif isinstance(found, types.BoolType):
        kind = "flag"
    elif isinstance(found, types.StrType):
        kind, most, (choices, rule) = "text", found.max_length or 0, _pattern(found.pattern)
    elif isinstance(found, types.BytesType):
        kind, most = "bytes", found.max_length or 0
    elif isinstance(found, types.VarTupleType) and isinstance(found.item_type, types.FloatType):
        kind, most = _NUMBERS, found.max_length or 0
    elif isinstance(found, types.VarTupleType) and isinstance(found.item_type, types.StrType):
        kind, most, longest = _TEXTS, found.max_length or 0, found.item_type.max_length or 0
    elif isinstance(found, types.UnionType):
        (record,) = (one.cls for one in found.types if isinstance(one, types.StructType))
        kind = "record"
    else:
        raise TypeError(f"{field.name}: the wire has no field of type {found}")
    return WireField(field.name, kind, most, longest, choices, rule, record, field.required, field.default, about)


def _pattern(pattern: str | None) -> tuple[tuple[str, ...], str]:
    """Texts that a pattern allows, or the pattern itself where it is no list of words."""
    words = _CHOICES.fullmatch(pattern or "")
    return (tuple(words[1].split("|")), "") if words else ((), pattern or "")


def room_of(kind: type[msgspec.Struct]) -> int:
    """Size that no message of a kind exceeds [bytes]."""
    return min(LARGEST_MESSAGE, 3 + sum(map(_room, fields_of(kind))))


def _room(field: WireField) -> int:
    if field.record is not None:
        return room_of(field.record)
    longest = max(field.most, *map(len, ("", *field.choices)))
    each = {"flag": 1, "text": 3 + 4 * longest, "bytes": 3 + longest, _NUMBERS: 3 + 9 * longest}
    return each.get(field.kind, 3 + field.most * (3 + 4 * field.longest) if field.kind == _TEXTS else 9)


def sources() -> dict[str, str]:
    """Every file of the messages in C, by its path in a package."""
    written = Path(__file__).parent / "c"
    return {
        "include/foretouch_wire.h": (written / "foretouch_wire.h").read_text(),
        "include/foretouch_messages.h": header(),
        "src/foretouch_wire.c": (written / "foretouch_wire.c").read_text(),
        "src/foretouch_messages.inc": tables(),
    }


_MADE = "/* Made by foretouch.export.wire from the classes of foretouch.messages: change it there. */\n\n"


def header() -> str:
    """Constants, structs and functions of all messages."""
    parts = [
        _MADE + "#ifndef FORETOUCH_MESSAGES_H\n#define FORETOUCH_MESSAGES_H\n\n#ifdef __cplusplus\n"
        'extern "C" {\n#endif\n',
        comment("Version of the schema, with which each message begins.")
        + f"\n#define FORETOUCH_WIRE_VERSION {VERSION}\n",
        comment("Largest message that is sent or read [bytes].")
        + f"\n#define FORETOUCH_LARGEST_MESSAGE {LARGEST_MESSAGE}\n",
        _channels(),
        *map(_struct, _with_records(kinds())),
        *map(_functions, kinds()),
        "#ifdef __cplusplus\n}\n#endif\n\n#endif\n",
    ]
    return "\n".join(parts)


def _channels() -> str:
    numbers = ",\n".join(f"    FORETOUCH_CHANNEL_{name.upper()} = {number}" for name, number in CHANNEL_NUMBERS.items())
    text = "Number of each channel in a frame of `foretouch gate`."
    return comment(text) + f"\ntypedef enum {{\n{numbers}\n}} foretouch_channel;\n"


def _with_records(every: Iterable[type[msgspec.Struct]]) -> Iterator[type[msgspec.Struct]]:
    """Each message, behind the records in it."""
    for kind in every:
        yield from (field.record for field in fields_of(kind) if field.record is not None)
        yield kind


def _struct(kind: type[msgspec.Struct]) -> str:
    members = [_member(field) for field in fields_of(kind) if field.kind != "version"]
    return comment(summary_of(kind)) + "\ntypedef struct {\n" + "".join(members) + f"}} foretouch_{snake(kind)};\n"


def _member(field: WireField) -> str:
    left_out = "" if field.required else f" If left out: {in_words(field.missing)}."
    about = comment(field.about + left_out, "    ") + "\n"
    if field.record is not None:
        return f"{about}    foretouch_{snake(field.record)} {field.name};\n    bool has_{field.name};\n"
    if field.in_place:
        return f"{about}    double {field.name}[{field.most}];\n    uint32_t {field.name}_count;\n"
    return f"{about}    {_KINDS[field.kind][1]} {field.name};\n"


def in_words(value: object) -> str:
    """What a field is where it is left out, in words of every language."""
    if value is None or value in ((), "", b""):
        return "none" if value is None else "empty"
    if isinstance(value, float):
        return {"nan": "NaN", "inf": "infinity"}.get(repr(value), repr(value))
    return str(value).lower()


def _functions(kind: type[msgspec.Struct]) -> str:
    name = snake(kind)
    return (
        f"#define FORETOUCH_{name.upper()}_ROOM {room_of(kind)}\n"
        f"void foretouch_{name}_init(foretouch_{name} *message);\n"
        f"foretouch_status foretouch_{name}_decode(const uint8_t *bytes, size_t size, foretouch_{name} *message);\n"
        f"size_t foretouch_{name}_encode(const foretouch_{name} *message, uint8_t *bytes, size_t room);\n"
    )


def tables() -> str:
    """Tables and functions of all messages, the end of ``foretouch_wire.c``."""
    parts = [*map(_table, _with_records(kinds())), *map(_bodies, kinds())]
    return _MADE + "\n".join(parts)


def _table(kind: type[msgspec.Struct]) -> str:
    name, fields = snake(kind), fields_of(kind)
    rows = "".join(f"    {{{_row(name, field)}}},\n" for field in fields)
    choices = "".join(_choices(name, field) for field in fields if field.choices)
    required = sum(field.required for field in fields)
    return (
        f"{choices}static const struct field {name}_fields[] = {{\n{rows}}};\n"
        f"static const struct record {name}_record = {{\n"
        f"    {name}_fields, {len(fields)}, {required}, sizeof(foretouch_{name})\n}};\n"
    )


def _choices(name: str, field: WireField) -> str:
    words = "".join(f'    {{"{word}", {len(word)}}},\n' for word in field.choices)
    return f"static const foretouch_text {name}_{field.name}[] = {{\n{words}}};\n"


def _row(name: str, field: WireField) -> str:
    if field.rule:
        raise TypeError(f"{name}: {field.name} has a rule that C does not know: {field.rule}")
    offset = "0" if field.kind == "version" else f"offsetof(foretouch_{name}, {field.name})"
    beside, kind, longest, more = "0", _KINDS.get(field.kind, ("RECORD",))[0], field.longest, "NULL, NULL"
    if field.record is not None:
        beside, more = f"offsetof(foretouch_{name}, has_{field.name})", f"&{snake(field.record)}_record, NULL"
    elif field.in_place:
        kind, beside = "FEW_NUMBERS", f"offsetof(foretouch_{name}, {field.name}_count)"
    elif field.choices:
        kind, longest, more = "CHOICE", len(field.choices), f"NULL, {name}_{field.name}"
    most = max(field.most, *map(len, ("", *field.choices)))
    return f"{kind}, {offset}, {beside}, {most}, {longest}, {_bits(field)}, {more}"


def _bits(field: WireField) -> str:
    """What a field is where it is left out, as the 64 bits of its number."""
    if field.required or field.kind not in ("count", "number", "flag"):
        return "0"
    if field.kind == "number":
        return f"UINT64_C(0x{struct.unpack('<Q', struct.pack('<d', field.missing))[0]:016x})"
    return str(int(field.missing))


def _bodies(kind: type[msgspec.Struct]) -> str:
    name = snake(kind)
    return f"""\
void foretouch_{name}_init(foretouch_{name} *message)
{{
    set_all_missing(&{name}_record, message);
}}

foretouch_status foretouch_{name}_decode(const uint8_t *bytes, size_t size, foretouch_{name} *message)
{{
    return decode(&{name}_record, bytes, size, message);
}}

size_t foretouch_{name}_encode(const foretouch_{name} *message, uint8_t *bytes, size_t room)
{{
    return encode(&{name}_record, message, bytes, room);
}}
"""
