"""Write what `docs/wire.md` has of the package: its tables, and the test vectors beside it.

.venv/bin/python docs/write_wire.py
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from foretouch.export.wire import WireField, fields_of, in_words, summary_of
from foretouch.identification import SENSOR_SENTENCES
from foretouch.link import CHANNEL_NUMBERS
from foretouch.link.access import NAMED, key_to_send
from foretouch.messages import CHANNELS, LARGEST_MESSAGE, STATUS_SENTENCES, VERSION, encode
from foretouch.models import LAWS, ContactMapModel
from foretouch.models.contact_map import layout
from foretouch.models.contact_map.layout import FINE, GRIDS, HEADER, Map
from foretouch.models.contact_map.wire import shrunk

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "wire.md"
VECTORS = ROOT / "docs" / "wire-vectors.json"
BLOCK = re.compile(r"(?P<head><!-- wire: (?P<name>[a-z-]+) -->\n).*?(?=<!-- end -->)", re.DOTALL)
KINDS = tuple(channel.kind for channel in CHANNELS.values())
LARGEST_EXACT = 2**53  # beyond it, readers of JSON round


# Tables


def table(head: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> str:
    """A table of Markdown."""
    lines = [head, ("---",) * len(head), *(tuple(cell.replace("|", "\\|") for cell in row) for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def channels() -> str:
    """The keys, and what goes over each."""
    rows = (
        (
            f"`{key_to_send(channel.name)}`"
            + (f", `foretouch/{channel.name}/SENDER`" if channel.name in NAMED else ""),
            f"`{channel.kind.__name__}`",
            channel.sender,
            f"{channel.rate:g}" if channel.rate else "on an event",
            f"{CHANNEL_NUMBERS[channel.name]}",
        )
        for channel in CHANNELS.values()
    )
    return table(("Key", "Message", "Sender", "Rate [1/s]", "Number in a frame"), rows)


def limits_of(field: WireField) -> str:
    """What a field may be, in a few words."""
    if field.kind == "version":
        return f"{VERSION}"
    if field.choices:
        return "one of " + ", ".join(f"`{word}`" for word in field.choices)
    unit = {"text": "characters", "bytes": "bytes"}.get(field.kind, "elements")
    sizes = [f"at most {field.most} {unit}"] if field.most else []
    sizes += [f"each at most {field.longest} characters"] if field.longest else []
    return ", ".join([*sizes, *([f"`{field.rule}`" if field.kind == "text" else field.rule] if field.rule else [])])


def message(kind: type[msgspec.Struct]) -> str:
    """Fields of a message or a record."""
    rows = (
        (
            str(index),
            f"`{field.name}`",
            f"record `{field.record.__name__}` or nil" if field.record else field.kind.replace("version", "count"),
            limits_of(field),
            "" if field.required else in_words(field.missing),
            field.about,
        )
        for index, field in enumerate(fields_of(kind))
    )
    head = ("", "Field", "Type", "Limit", "If left out", "What it is")
    return f"{summary_of(kind)}\n\n" + table(head, rows)


def messages() -> str:
    """All messages, in the order of the channels, each behind the record in it."""
    text = ""
    for kind in KINDS:
        records = [field.record for field in fields_of(kind) if field.record is not None]
        text += "".join(f"### {one.__name__}\n\n{message(one)}\n" for one in (kind, *records))
    return text


def numbered(sentences: Mapping[Any, str]) -> str:
    """Numbers of an enumeration, and the sentence of each."""
    rows = ((str(int(one)), f"`{one.name}`", f"{text[0].upper()}{text[1:]}.") for one, text in sentences.items())
    return table(("Number", "Name", "What it means"), rows)


def laws() -> str:
    """Numbers that each law has in a model."""
    rows = (
        (
            f"`{name}`",
            ", ".join(f"`{one}`" for one in law.parameter_names),
            str(layout.MEMORY if law is ContactMapModel else 0),
        )
        for name, law in LAWS.items()
    )
    return table(("`law`", "`parameters`", "Numbers of `state`"), rows)


def header() -> str:
    """Numbers of a contact map before its knots, as the source says it of each."""
    source = (ROOT / "src/foretouch/models/contact_map/layout.py").read_text().partition("class Map(Record)")[2]
    about = dict(re.findall(r"^    (\w+): .*?  # (.+)$", source, re.MULTILINE))
    rows = []
    for name in Map.layout.names or ():
        dtype, offset = Map.layout.fields[name][:2]  # type: ignore[index]
        first, size = offset // 8, dtype.itemsize // 8
        if first < HEADER:
            numbers = f"{first}" if size == 1 else f"{first} to {first + size - 1}"
            rows.append((numbers, f"`{name}`", about[name]))
    return table(("Number", "Name", "What it is"), iter(rows))


def grids() -> str:
    """The two grids of a contact map."""
    rows = (
        (
            name,
            f"{grid.features}",
            f"{grid.knots}, {grid.spacing * 1e3:g} mm, {grid.below}",
            f"{grid.feature_knots}, {grid.feature_spacing * 1e3:g} mm, {grid.feature_below}",
            f"{2 * grid.features + grid.size}",
        )
        for name, grid in zip(("coarse", "fine"), GRIDS, strict=True)
    )
    splines = "number, distance, how many are outside"
    head = ("Grid", "Features", f"Splines: {splines}", f"Splines of a feature: {splines}", "All numbers")
    return table(head, rows)


def blocks() -> dict[str, str]:
    """Every block of the page by its name."""
    return {
        "channels": channels(),
        "messages": messages(),
        "statuses": numbered(STATUS_SENTENCES),
        "sensors": numbered(SENSOR_SENTENCES),
        "laws": laws(),
        "map-header": header(),
        "map-grids": grids(),
    }


def filled(page: str) -> str:
    """The page with its blocks as they have to be."""
    made = blocks()
    return BLOCK.sub(lambda found: f"{found['head']}\n{made[found['name']]}\n", page)


# Vectors


def full(field: WireField, index: int) -> Any:
    """A value of a field that differs from its neighbours'."""
    if field.record is not None:
        return field.record(*(full(one, 100 + number) for number, one in enumerate(fields_of(field.record))))
    if field.rule:
        return "" if field.kind == "text" else 0.5
    return {
        "version": VERSION,
        "count": 1000 + index,
        "number": 0.125 * index,
        "flag": index % 2 == 0,
        "text": field.choices[0] if field.choices else f"{field.name} \u00e9 \u20ac",
        "bytes": bytes((0, 1, index, 255)),
        "list of numbers": (1.5, -2.0, 0.25)[: field.most],
        "list of texts": ("material", field.name),
    }[field.kind]


def extreme(field: WireField, index: int) -> Any:
    """A value at a limit of a field, or one that is easily got wrong."""
    numbers = (math.nan, math.inf, -math.inf, -0.0, 5e-324, 1.7976931348623157e308, 0.1, -1e-300)
    counts = (2**63 - 1, 2**32, 2**32 - 1, 65536, 65535, 256, 255, 128, 127, 0)
    if field.record is not None:
        return field.record(*(extreme(one, number) for number, one in enumerate(fields_of(field.record))))
    if field.rule:
        return "" if field.kind == "text" else 0.0
    return {
        "version": VERSION,
        "count": counts[index % len(counts)],
        "number": numbers[index % len(numbers)],
        "flag": True,
        "text": field.choices[-1] if field.choices else ("\U0001f9e4" * 8, "\x1b\x00", "x" * 31)[index % 3],
        "bytes": bytes(256),
        "list of numbers": (numbers * 2)[: field.most],
        "list of texts": ("",) * 16,
    }[field.kind]


def as_json(value: Any) -> Any:
    """A value in JSON: bytes in hex, and as a text what JSON's numbers do not hold."""
    if isinstance(value, msgspec.Struct):
        return {name: as_json(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, tuple):
        return [as_json(one) for one in value]
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, float) and not math.isfinite(value):
        return in_words(value) if value > 0 or value != value else f"-{in_words(-value)}"
    return str(value) if type(value) is int and value > LARGEST_EXACT else value


def vectors() -> list[dict[str, Any]]:
    """What is read: every message with all that it may say, at limits, and with as little as it may say."""
    made = []
    for kind in KINDS:
        fields = fields_of(kind)
        rows: dict[str, tuple[Any, ...]] = {
            "every field": tuple(full(field, index) for index, field in enumerate(fields)),
            "extremes": tuple(extreme(field, index) for index, field in enumerate(fields)),
        }
        least = tuple(full(field, index) for index, field in enumerate(fields) if field.required)
        for what, values in rows.items():
            made.append(vector(what, kind(*values), encode(kind(*values))))
        made.append(vector("what may be left out is", kind(*least), msgspec.msgpack.encode(list(least))))
    other = CHANNELS["command"].kind(VERSION, 1, 2, 3.0, 4)
    numbers = bytes.fromhex(f"dd00000005 cf{VERSION:016x} d100 01 cd0002 03 d004".replace(" ", ""))
    made.append(vector("other forms of the same numbers", other, numbers))
    narrow = bytes.fromhex(f"95{VERSION:02x}0102 ca3fc00000 04".replace(" ", ""))
    made.append(vector("a number in 32 bits", CHANNELS["command"].kind(VERSION, 1, 2, 1.5, 4), narrow))
    return made


def vector(what: str, message: Any, data: bytes) -> dict[str, Any]:
    """One that is read; where its bytes are not those that are written, these too."""
    one = {"message": type(message).__name__, "what": what, "bytes": data.hex(), "fields": as_json(message)}
    return one if encode(message) == data else one | {"written": encode(message).hex()}


def refusals() -> list[dict[str, str]]:
    """What is refused, all as a `Command` or a `Hello`, and why."""
    begin, hello = [VERSION, 1, 2], [VERSION, 1, 2, "leader", [], []]
    least = msgspec.msgpack.encode([*begin, 0.5, 4])
    text = msgspec.msgpack.encode([*begin, 0.5, 4, False])
    cases: list[tuple[str, str, bytes | list[Any]]] = [
        ("Command", "no bytes", b""),
        ("Command", "cut off", least[:-1]),
        ("Command", "something behind it", least + b"\x00"),
        ("Command", "no list", msgspec.msgpack.encode({"version": VERSION})),
        ("Command", "too few fields", [*begin, 0.5]),
        ("Command", "too many fields", [*begin, 0.5, 4, False, "", 0, [], 0, 0, 0]),
        ("Command", "a number for a count", [*begin, 0.5, 4.0]),
        ("Command", "a negative count", [*begin, 0.5, -1]),
        ("Command", "a count beyond 2^63 - 1", [*begin, 0.5, 2**63]),
        ("Command", "a text for a number", [*begin, "0.5", 4]),
        ("Command", "nil for a number", [*begin, None, 4]),
        ("Command", "a count for a flag", [*begin, 0.5, 4, 1]),
        ("Command", "bytes for a text", [*begin, 0.5, 4, False, b"name"]),
        ("Command", "too long a text", [*begin, 0.5, 4, False, "x" * 65]),
        ("Command", "an overlong form in a text", b"\x97" + text[1:] + b"\xa2\xc0\x80"),
        ("Command", "half of a surrogate pair in a text", b"\x97" + text[1:] + b"\xa3\xed\xa0\x80"),
        ("Command", "too many elements", [*begin, 0.5, 4, False, "", 0, [0.0] * 4]),
        ("Command", "a list that claims 2^32 - 1 elements", b"\xdd\xff\xff\xff\xff" + least[1:]),
        ("Command", "the byte that msgpack never uses", least[:-1] + b"\xc1"),
        ("Hello", "a role that there is not", [*hello[:3], "pilot", [], []]),
        ("Hello", "too long a name", [*hello[:4], ["n" * 65], ["v"]]),
        ("Command", "another version", [VERSION + 1, 1, 2, 0.5, 4]),
        ("Command", "another version, with fields that this one has not", [VERSION + 1, 1, 2, {"x": [0.5]}]),
    ]
    return [
        {
            "message": kind,
            "what": what,
            "bytes": (data if isinstance(data, bytes) else msgspec.msgpack.encode(data)).hex(),
            "status": "other version" if what.startswith("another version") else "no message",
        }
        for kind, what, data in cases
    ]


def contact_maps() -> list[dict[str, Any]]:
    """Two packed maps: one of the coarse grid alone, and one with the fine grid."""
    made = []
    for fine in (False, True):
        maps = Map.new(lowest=-0.0015, reached=0.0042, felt=3.0, touch_force=0.25, law_speed=0.05, hold=-0.5, catch=0.5)
        learnt = maps[0]
        learnt.uncertainty[:], learnt.shares[:] = (0.01, 0.001), (0.25, 0.5, 0.25) if fine else (0.25, 0.75, 0.0)
        learnt.place = 0.001 if fine else 0.0
        learnt.coarse.weights[:] = 0.5 * np.arange(learnt.coarse.weights.size)
        learnt.fine.weights[:] = 0.25 * np.arange(FINE.size)
        learnt.coarse.ranges[:], learnt.fine.ranges[:] = (-1.0, 1.0), (-2.0, 2.0)
        content, kept, good = shrunk(maps)
        assert good
        numbers = kept.view(np.float64).tolist()
        there = {str(index): number for index, number in enumerate(numbers) if number != 0.0}
        made.append({"what": f"with{'' if fine else 'out'} the fine grid", "bytes": content.hex(), "numbers": there})
    return made


def everything() -> str:
    """The file of vectors."""
    parts = {"read": vectors(), "refused": refusals(), "contact_maps": contact_maps()}
    lists = [f'"{name}": [\n' + ",\n".join(map(json.dumps, rows)) + "\n]" for name, rows in parts.items()]
    lines = [f'"version": {VERSION}', f'"largest_message": {LARGEST_MESSAGE}', *lists]
    return "{\n" + ",\n".join(lines) + "\n}\n"


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text()))
    VECTORS.write_text(everything())
