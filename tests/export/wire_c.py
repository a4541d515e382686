"""The messages in C, built with sanitizers, and what Python makes of the same bytes."""

from __future__ import annotations

import io
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from packages import sanitizes

from foretouch.errors import DecodeError, PeerVersionError
from foretouch.export.structs import snake
from foretouch.export.wire import WireField, fields_of, kinds, sources
from foretouch.messages import LARGEST_MESSAGE, Message, as_printed, decode, encode

HERE = Path(__file__).parent
COMPILERS = tuple(filter(sanitizes, ("gcc", "clang")))
STRICT = ("-std=c11", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow", "-Wcast-qual")
CROSS, EMULATOR = "aarch64-linux-gnu-gcc", "qemu-aarch64"
SANITIZED = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
OK, NO_MESSAGE, OTHER_VERSION, TOO_LARGE = range(4)

Case = tuple[type[Message], bytes]
Program = tuple[str, ...]
"""Words that start a program."""


class Answer(NamedTuple):
    """What became of the bytes of one case.

    Attributes:
        status: As `foretouch_status`.
        again: The message encoded again; empty where it is refused, or larger than what is sent.
        fields: Values of all fields, as `wire_cases.c` says them.
    """

    status: int
    again: bytes = b""
    fields: bytes = b""


def write_sources(folder: Path) -> None:
    """The codec, as it is exported, in one folder."""
    for path, text in sources().items():
        (folder / Path(path).name).write_text(text)


def build(compiler: str, folder: Path) -> Program:
    """The program of `wire_cases.c`: with sanitizers, or for another processor, emulated."""
    write_sources(folder)
    (folder / "wire_fields.inc").write_text(_says())
    program = folder / f"wire_cases_{compiler}"
    files = [str(HERE / "wire_cases.c"), str(folder / "foretouch_wire.c")]
    flags = ("-O2", "-static") if compiler == CROSS else SANITIZED
    subprocess.run([compiler, *STRICT, *flags, f"-I{folder}", *files, "-o", str(program)], check=True)
    return (EMULATOR, str(program)) if compiler == CROSS else (str(program),)


def _says() -> str:
    """A function in C for each message and record, which says its fields by their names."""
    records = [field.record for kind in kinds() for field in fields_of(kind) if field.record is not None]
    text = "".join(f"static void say_{snake(kind)}(foretouch_{snake(kind)} *message);\n" for kind in records)
    for kind in (*records, *kinds()):
        if kind not in records:
            text += f"TRY({snake(kind)}, {snake(kind).upper()})\n"
        lines = "".join(f"    {_say(field)}\n" for field in fields_of(kind) if field.kind != "version")
        text += f"static void say_{snake(kind)}(foretouch_{snake(kind)} *message)\n{{\n{lines}}}\n"
    names = ", ".join(f"try_{snake(kind)}" for kind in kinds())
    return f"{text}static void (*const tries[])(const uint8_t *, size_t) = {{{names}}};\n"


def _say(field: WireField) -> str:
    value = f"message->{field.name}"
    if field.record is not None:
        return (
            f"say_count(message->has_{field.name}); if (message->has_{field.name}) say_{snake(field.record)}(&{value});"
        )
    if field.in_place:
        return f"say_count({value}_count); say({value}, {value}_count * sizeof(double));"
    return {
        "count": f"say_count({value});",
        "flag": f"say_count({value});",
        "number": f"say_number({value});",
        "text": f"say_bytes({value}.text, {value}.size);",
        "bytes": f"say_bytes({value}.bytes, {value}.size);",
        "list of numbers": f"say_numbers(&{value});",
        "list of texts": f"say_texts(&{value});",
    }[field.kind]


def said(value: Any) -> bytes:
    """A value as `wire_cases.c` says it."""
    if isinstance(value, str | bytes):
        data = value.encode() if isinstance(value, str) else value
        return struct.pack("=Q", len(data)) + data
    if isinstance(value, tuple):
        return struct.pack("=Q", len(value)) + b"".join(map(said, value))
    if isinstance(value, msgspec.Struct):
        values = msgspec.structs.astuple(value)
        return b"".join(map(said, values[1:])) if isinstance(value, Message) else said(1) + b"".join(map(said, values))
    return struct.pack("=d", value) if isinstance(value, float) else struct.pack("=Q", value or 0)


def in_python(case: Case) -> Answer:
    """What Python makes of it; where it reads it, the texts are as they came, as they are in C."""
    kind, data = case
    try:
        message = decode(data, kind)
    except PeerVersionError:
        return Answer(OTHER_VERSION)
    except DecodeError:
        return Answer(TOO_LARGE if len(data) > LARGEST_MESSAGE else NO_MESSAGE)
    raw = msgspec.msgpack.decode(data, type=kind)
    again = encode(raw)
    assert encode(as_printed(raw)) == encode(message)
    return Answer(OK, again if len(again) <= LARGEST_MESSAGE else b"", said(raw))


def in_c(program: Program, cases: Sequence[Case]) -> list[Answer]:
    """What the program makes of each."""
    numbers = {kind: number for number, kind in enumerate(kinds())}
    asked = b"".join(struct.pack("=IB", len(data), numbers[kind]) + data for kind, data in cases)
    done = subprocess.run(program, input=asked, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode(errors="replace")[-4000:]
    output = io.BytesIO(done.stdout)
    answers = [_answer(output) for _ in cases]
    assert output.read() == b""
    return answers


def _answer(output: io.BytesIO) -> Answer:
    status = output.read(1)[0]
    if status != OK:
        return Answer(status)
    again, fields = struct.unpack("=2I", output.read(8))
    return Answer(status, output.read(again), output.read(fields))
