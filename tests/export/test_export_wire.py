"""Messages in C: the same bytes as in Python, the same refusals, and no step outside of what was given."""

from __future__ import annotations

import math
import random
import struct
import subprocess
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from packages import needs
from wire_c import (
    COMPILERS,
    CROSS,
    EMULATOR,
    NO_MESSAGE,
    OK,
    OTHER_VERSION,
    SANITIZED,
    STRICT,
    TOO_LARGE,
    Answer,
    Case,
    Program,
    build,
    in_c,
    in_python,
    write_sources,
)

from foretouch.export.structs import snake
from foretouch.export.wire import WireField, fields_of, kinds, room_of
from foretouch.messages import LARGEST_MESSAGE, VERSION, Command, Hello, Message, ModelUpdate, decode, encode

KINDS = kinds()
COUNTS = (0, 1, 127, 128, 255, 256, 65535, 65536, 2**32 - 1, 2**32, 2**53 + 1, 2**63 - 1)
NUMBERS = (0.0, -0.0, 1.0, -1.5, 5e-324, 1.7e308, math.inf, -math.inf, math.nan, 0.012)
CHARACTERS = ("", "x", "x" * 31, "x" * 32, "\x00", "\x1b[2J", "\u00e9" * 200, "\u20ac", "\U0001f9e4" * 64, "\U0010ffff")
HEADS = tuple(bytes([code]) + b"\xff" * size for code, size in zip(
    (0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xd9, 0xda, 0xdb, 0xdc, 0xdd, 0xde, 0xdf),
    (1, 2, 4, 1, 2, 4, 1, 2, 4, 2, 4, 2, 4), strict=True,
))  # fmt: skip
"""Bytes, extensions, texts, lists and maps that claim to be as long as each can."""

pytestmark = pytest.mark.skipif(not COMPILERS, reason="needs gcc or clang")


@pytest.fixture(scope="module", params=COMPILERS)
def program(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Program:
    return build(request.param, tmp_path_factory.mktemp(request.param))


def value_of(field: WireField, number: random.Random) -> Any:
    """Any value that a field may have."""
    if field.record is not None:
        return None if number.random() < 0.3 else made(field.record, number)
    if field.choices:
        return number.choice(field.choices)
    many = number.choice(
        (0, 1, 2, min(field.most, 15), min(field.most, 16), field.most if number.random() < 0.05 else 3)
    )
    if field.kind == "list of numbers":
        return tuple(number.choice(NUMBERS) for _ in range(min(many, field.most)))
    if field.kind == "list of texts":
        return tuple(number.choice(CHARACTERS)[: field.longest] for _ in range(min(many, field.most)))
    return {
        "version": lambda: VERSION,
        "count": lambda: number.choice(COUNTS) if number.random() < 0.7 else number.getrandbits(63),
        "number": lambda: number.choice(NUMBERS) if number.random() < 0.5 else number.gauss(0.0, 1.0),
        "flag": lambda: number.random() < 0.5,
        "text": lambda: number.choice(CHARACTERS)[: field.most],
        "bytes": lambda: number.randbytes(number.choice((0, 1, 255, 256, 300))),
    }[field.kind]()


def made(kind: type[msgspec.Struct], number: random.Random) -> Any:
    return kind(*(value_of(field, number) for field in fields_of(kind)))


def agree(program: Program, cases: Iterable[Case]) -> Counter[int]:
    """Both say the same of each case; how often which status came."""
    listed = list(cases)
    counted: Counter[int] = Counter()
    for case, here, there in zip(listed, map(in_python, listed), in_c(program, listed), strict=True):
        counted[here.status] += 1
        assert here == there or is_odd(case, here, there), (case, here, there)
    return counted


def is_odd(case: Case, here: Answer, there: Answer) -> bool:
    """Whether only Python's reader of anything refuses what is of another version: what the page of the format names.

    Both refuse the message; they differ in what they call it.
    """
    if (here.status, there.status) != (NO_MESSAGE, OTHER_VERSION):
        return False
    try:
        msgspec.msgpack.decode(case[1])
    except RecursionError:
        return True
    except msgspec.DecodeError as error:
        return "keys must be hashable" in str(error) or "Invalid MessagePack timestamp" in str(error)
    return False


def any_value(field: WireField) -> st.SearchStrategy[Any]:
    """Whatever a field may be."""
    if field.record is not None:
        return st.none() | any_message(field.record)
    if field.choices:
        return st.sampled_from(field.choices)
    return {
        "version": st.just(VERSION),
        "count": st.integers(0, 2**63 - 1) | st.sampled_from(COUNTS),
        "number": st.floats(),
        "flag": st.booleans(),
        "text": st.text(max_size=field.most),
        "bytes": st.binary(max_size=min(field.most, 400)),
        "list of numbers": st.lists(st.floats(), max_size=min(field.most, 20)).map(tuple),
        "list of texts": st.lists(st.text(max_size=field.longest), max_size=20).map(tuple),
    }[field.kind]


def any_message(kind: type[msgspec.Struct]) -> st.SearchStrategy[Any]:
    return st.builds(kind, **{field.name: any_value(field) for field in fields_of(kind)})


@pytest.mark.parametrize("kind", KINDS, ids=snake)
@pytest.mark.first
def test_every_message_is_written_as_python_writes_it(program: Program, kind: type[Message]) -> None:
    @settings(max_examples=10)
    @given(st.lists(any_message(kind), min_size=1, max_size=8))
    def try_some(messages: list[Message]) -> None:
        assert agree(program, [(kind, encode(message)) for message in messages])[OK] == len(messages)

    try_some()


@pytest.mark.first
def test_every_message_at_its_extremes_is_written_as_python_writes_it(program: Program) -> None:
    number = random.Random(4)
    cases = [
        (kind, data) for kind in KINDS for _ in range(100) if len(data := encode(made(kind, number))) <= LARGEST_MESSAGE
    ]
    for (_, data), answer in zip(cases, in_c(program, cases), strict=True):
        assert (answer.status, answer.again) == (OK, data)
    assert agree(program, cases)[OK] > 900


def test_a_message_cut_off_anywhere_is_refused(program: Program) -> None:
    number = random.Random(1)
    for kind in KINDS:
        data = encode(made(kind, number))[:5000]
        assert OK not in agree(program, [(kind, data[:size]) for size in range(min(len(data), 1500))])


def test_what_is_left_out_is_what_python_takes_it_for(program: Program) -> None:
    number = random.Random(2)
    for kind in KINDS:
        values = [value_of(field, number) for field in fields_of(kind)]
        raw = [msgspec.msgpack.encode(value) for value in values]
        required = sum(field.required for field in fields_of(kind))
        cases = [
            (kind, msgspec.msgpack.encode([msgspec.Raw(one) for one in raw[:some]])) for some in range(len(raw) + 1)
        ]
        cases += [(kind, msgspec.msgpack.encode([*(msgspec.Raw(one) for one in raw), 0]))]
        counted = agree(program, cases)
        assert counted[OK] == len(raw) + 1 - required, kind


def loose(value: Any, number: random.Random) -> bytes:
    """A value in any of the forms that msgpack has for it, and now and then as something else."""
    if number.random() < 0.02:
        wrong = (
            None,
            True,
            0,
            -1,
            2**63,
            2**64 - 1,
            1.0,
            "x",
            b"x",
            [],
            {},
            {"a": 1},
            [[]],
            msgspec.msgpack.Ext(5, b"x"),
        )
        return msgspec.msgpack.encode(number.choice(wrong))
    if isinstance(value, msgspec.Struct):
        value = msgspec.structs.astuple(value)
    if isinstance(value, list | tuple):
        inner = b"".join(loose(one, number) for one in value)
        return number.choice((b"\xdc" + struct.pack(">H", len(value)), b"\xdd" + struct.pack(">I", len(value)))) + inner
    if isinstance(value, bool) or value is None:
        return msgspec.msgpack.encode(value)
    if isinstance(value, float):
        forms = [msgspec.msgpack.encode(value), b"\xca" + struct.pack(">I", number.getrandbits(32))]
        return number.choice([*forms, loose(number.choice((-1, 0, -(2**63), 2**64 - 1, 2**53 + 1)), number)])
    if isinstance(value, int):
        forms = [msgspec.msgpack.encode(value)]
        for code, form in zip(range(0xCC, 0xD4), [">B", ">H", ">I", ">Q", ">b", ">h", ">i", ">q"], strict=True):
            try:
                forms.append(bytes([code]) + struct.pack(form, value))
            except struct.error:
                continue
        return number.choice(forms)
    data, codes = (value.encode(), 0xD9) if isinstance(value, str) else (value, 0xC4)
    power = number.choice([power for power in range(3) if len(data) < 256 ** (1 << power)])
    return bytes([codes + power]) + len(data).to_bytes(1 << power, "big") + data


def mutated(data: bytes, number: random.Random) -> bytes:
    """Nearly a message."""
    changed = bytearray(data)
    for _ in range(number.choice((1, 1, 1, 2, 5))):
        at, way = number.randrange(len(changed) + 1), number.randrange(7)
        if number.random() < 0.3:
            at = min(at, number.randrange(8))
        if way == 0 and at < len(changed):
            changed[at] = number.getrandbits(8)
        elif way == 1 and at < len(changed):
            changed[at] ^= 1 << number.randrange(8)
        elif way == 2:
            changed[at:at] = number.randbytes(number.choice((1, 1, 4)))
        elif way == 3:
            del changed[at : at + number.choice((1, 1, 9))]
        elif way == 4:
            changed[at : at + number.choice((0, 1, 5))] = number.choice(HEADS)
        elif way == 5 and at < len(changed):
            changed[at] = number.choice(
                (0x80, 0x90, 0x91, 0xA0, 0xC0, 0xC1, 0xC2, 0xCA, 0xCB, 0xD4, 0xD6, 0xDF, 0xED, 0xFF)
            )
        elif way == 6:
            del changed[at:]
    return bytes(changed)


def cases(seed: int, count: int) -> Iterator[Case]:
    number, bases = random.Random(seed), []
    for kind in KINDS:
        while sum(one is kind for one, _ in bases) < 12:
            message = made(kind, number)
            if len(data := encode(message)) < 1500:
                bases.append((kind, data))
                bases.append((kind, loose(message, number)))
    for index in range(count):
        kind, data = number.choice(bases)
        way = index % 8
        if way == 0:
            kind = number.choice(KINDS)
            data = loose(made(kind, number), number)[:3000] if index % 64 == 0 else data
            yield kind, data
        elif way == 1:
            yield kind, number.randbytes(number.choice((0, 1, 2, 10, 60)))
        elif way == 2:
            yield kind, bytes([data[0], number.choice((VERSION - 1, VERSION + 1, 0xFF, 0xC3))]) + data[2:]
        elif way == 3:
            yield number.choice(KINDS), data
        else:
            yield kind, mutated(data, number)


@pytest.mark.first
def test_c_and_python_agree_on_whatever_arrives(program: Program) -> None:
    counted = agree(program, cases(3, 12_000))
    assert min(counted[OK], counted[NO_MESSAGE], counted[OTHER_VERSION]) > 500, counted


@pytest.mark.long
def test_another_processor_does_the_same(tmp_path: Path) -> None:
    needs(CROSS, EMULATOR)
    program, number = build(CROSS, tmp_path), random.Random(6)
    agree(program, cases(6, 4000))
    assert agree(program, [(kind, encode(made(kind, number))) for kind in KINDS for _ in range(30)])[OK] > 250


@pytest.mark.long
def test_c_and_python_agree_on_a_million(program: Program) -> None:
    for seed in range(50):
        agree(program, cases(1000 + seed, 20_000))


@pytest.mark.parametrize("head", HEADS, ids=bytes.hex)
def test_what_claims_to_be_huge_is_refused_at_each_place(program: Program, head: bytes) -> None:
    data = encode(ModelUpdate(VERSION, 1, 1, 0, "contact-map", (1.0, 2.0), (3.0,), 0.0, True, "", "bank", b"map"))
    cases = [(ModelUpdate, data[:at] + head + data[at + keep :]) for at in range(len(data)) for keep in (0, 1)]
    assert OK not in agree(program, cases) or head[0] in (0xC4, 0xD9)


def test_limits_are_those_of_python(program: Program) -> None:
    hello, command = (14 and VERSION), [VERSION, 1, 1, 0.0, 0, False]
    texts = ("\U0001f9e4" * 64, "\U0001f9e4" * 65, "x" * 64, "x" * 65)
    listed: list[list[Any]] = [[*command, text] for text in texts]
    listed += [[*command, "", 0, [0.0] * some] for some in (3, 4)]
    listed += [[VERSION, 1, 1, 0.0, count] for count in (2**63 - 1, 2**63, -1)]
    commands = [(Command, msgspec.msgpack.encode(one)) for one in listed]
    models = [
        [VERSION, 1, 1, 0, "", [1] * some, [1] * most, 0.0, True, "r" * long, "", b"m" * content]
        for some, most, long, content in (
            (4096, 4096, 400, 4096),
            (4097, 0, 0, 0),
            (0, 4097, 0, 0),
            (0, 0, 401, 0),
            (0, 0, 0, 4097),
        )
    ]
    hellos = [
        [hello, 1, 1, role, ["n" * name] * names, ["v" * value] * values]
        for role, name, names, value, values in (
            ("leader", 64, 128, 100, 128), ("leader", 65, 1, 1, 1), ("leader", 1, 129, 1, 1), ("leader", 1, 1, 1024, 1),
            ("leader", 1, 1, 1025, 1), ("leader", 1, 1, 1, 129), ("leader\n", 1, 1, 1, 1), ("", 1, 1, 1, 1),
        )
    ]  # fmt: skip
    rest = [(ModelUpdate, msgspec.msgpack.encode(one)) for one in models]
    rest += [(Hello, msgspec.msgpack.encode(one)) for one in hellos]
    assert agree(program, commands)[OK] == 4
    assert agree(program, rest)[OK] == 3
    large = encode(Hello(VERSION, 1, 1, "leader", (), ("v" * 1000,) * 60))
    assert agree(
        program, [(Hello, large), (Command, bytes(LARGEST_MESSAGE)), (Command, bytes(LARGEST_MESSAGE + 1))]
    ) == {
        TOO_LARGE: 2,
        NO_MESSAGE: 1,
    }


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_utf_8_is_as_strict_as_in_python(program: Program, size: int) -> None:
    number = random.Random(size)
    every = [bytes([first]) for first in range(256)] if size == 1 else []
    edges = (
        0x00,
        0x7F,
        0x80,
        0x8F,
        0x90,
        0x9F,
        0xA0,
        0xBF,
        0xC0,
        0xC1,
        0xC2,
        0xDF,
        0xE0,
        0xED,
        0xEF,
        0xF0,
        0xF4,
        0xF5,
        0xFF,
    )
    every += [bytes(number.choice(edges) for _ in range(size)) for _ in range(3000 if size > 1 else 0)]
    begin = b"\x97" + encode(Command(VERSION, 1, 1, 0.0, 0, False))[1 : -len(b"\xa0\x00\x90\x00\x00")]
    counted = agree(program, [(Command, begin + bytes([0xA0 + size]) + text) for text in every])
    assert counted[OK] > 0 < counted[NO_MESSAGE]


ANYTHING = (
    0, -1, 2**64 - 1, 1.5, None, True,
    "text \u20ac", b"bytes", [], [[1, [2, [3]]]], {}, {"a": {"b": [1]}}, {1: 2, "x": []},
    *(msgspec.msgpack.Ext(5, bytes(size)) for size in (0, 1, 2, 3, 4, 8, 16, 17, 255, 256)), "x" * 300, b"x" * 300,
    [0] * 20, {index: index for index in range(20)},
)  # fmt: skip
"""Whatever a message of another version may hold."""


def test_another_version_is_known_whatever_it_holds(program: Program) -> None:
    versions = (VERSION - 1, VERSION + 1, 0, -1, -(2**63), 2**63, 2**64 - 1, VERSION - 256)
    whole = [msgspec.msgpack.encode([version, 1, one]) for version in versions for one in ANYTHING]
    assert agree(program, [(Command, data) for data in whole]) == {OTHER_VERSION: len(whole)}
    assert agree(program, [(Command, data[:-1]) for data in whole])[OTHER_VERSION] == 0
    assert agree(program, [(Command, data + b"\x00") for data in whole])[OTHER_VERSION] == 0
    none = [msgspec.msgpack.encode([version, 1]) for version in ("14", 14.0, 15.0, None, True, [15])]
    assert agree(program, [(Command, data) for data in none]) == {NO_MESSAGE: len(none)}


def test_no_message_is_larger_than_it_is_said_to_be() -> None:
    space = sum(9 if field.kind != "flag" else 1 for field in fields_of(fields_of(KINDS[2])[-1].record))  # type: ignore[arg-type]
    assert room_of(KINDS[2]) >= space
    assert max(map(room_of, KINDS)) == LARGEST_MESSAGE
    longest = Command(2**63 - 1, 2**63 - 1, 2**63 - 1, 1.5, 2**63 - 1, True, "\U0001f9e4" * 64, 2**63 - 1, (1.5,) * 3,
                      2**63 - 1, 2**63 - 1)  # fmt: skip
    assert len(encode(longest)) <= room_of(Command) < len(encode(longest)) + 24


SENDER = """
#include "foretouch_wire.h"
#include <stdio.h>
#include <string.h>

int main(void)
{
    static const double parameters[] = {1000.0, 2.0, 1.5};
    static const foretouch_text names[] = {{"material", 8}}, values[] = {{"foam", 4}};
    uint8_t bytes[400];
    foretouch_model_update model;
    foretouch_model_update_init(&model);
    model.sequence = 7;
    model.law = foretouch_text_of("hunt-crossley");
    model.parameters = (foretouch_numbers){3, parameters, {NULL, 0}};
    model.valid = true;
    fwrite(bytes, 1, foretouch_model_update_encode(&model, bytes, sizeof bytes), stdout);
    foretouch_hello hello;
    foretouch_hello_init(&hello);
    if (foretouch_hello_encode(&hello, bytes, sizeof bytes) != 0)
        return 1; /* "" is no role */
    hello.role = foretouch_text_of("leader");
    hello.names = (foretouch_texts){1, names, {NULL, 0}};
    hello.values = (foretouch_texts){1, values, {NULL, 0}};
    fwrite(bytes, 1, foretouch_hello_encode(&hello, bytes, sizeof bytes), stdout);
    foretouch_command command;
    foretouch_command_init(&command);
    command.place_count = 4;
    if (foretouch_command_encode(&command, bytes, sizeof bytes) != 0)
        return 2; /* its place has three numbers */
    command.place_count = UINT32_MAX;
    if (foretouch_command_encode(&command, bytes, sizeof bytes) != 0)
        return 2;
    command.place_count = 0;
    command.sequence = UINT64_C(1) << 63;
    if (foretouch_command_encode(&command, bytes, sizeof bytes) != 0)
        return 3;
    command.sequence = 1;
    command.holder = (foretouch_text){"\\xed\\xa0\\x80", 3};
    if (foretouch_command_encode(&command, bytes, sizeof bytes) != 0)
        return 4; /* half of a surrogate pair */
    if (foretouch_command_decode(NULL, 0, &command) != FORETOUCH_NO_MESSAGE)
        return 5;
    return 0;
}
"""


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.first
def test_a_program_in_c_sends_what_python_reads(compiler: str, tmp_path: Path) -> None:
    write_sources(tmp_path)
    (tmp_path / "sender.c").write_text(SENDER)
    files = ["sender.c", "foretouch_wire.c", "-o", "sender"]
    subprocess.run([compiler, *STRICT, *SANITIZED, *files], cwd=tmp_path, check=True)
    output = subprocess.run([tmp_path / "sender"], check=True, capture_output=True).stdout
    model = ModelUpdate(VERSION, 7, 0, 0, "hunt-crossley", (1000.0, 2.0, 1.5), (), 0.0, True, "", "", b"")
    hello = Hello(VERSION, 0, 0, "leader", ("material",), ("foam",))
    assert output == encode(model) + encode(hello)
    assert decode(output[: len(encode(model))], ModelUpdate) == model


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.first
def test_it_needs_memcpy_and_memset_alone(compiler: str, tmp_path: Path) -> None:
    write_sources(tmp_path)
    for flags in (("-O2",), ("-Os",)):
        subprocess.run([compiler, *STRICT, *flags, "-c", "foretouch_wire.c", "-o", "wire.o"], cwd=tmp_path, check=True)
        listed = subprocess.run(["nm", "wire.o"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
        symbols = [line.split()[-2:] for line in listed.splitlines()]
        assert {name for kind, name in symbols if kind == "U"} <= {"memcpy", "memset"}
        assert all(name.startswith("foretouch_") for kind, name in symbols if kind == "T")
        assert not [name for kind, name in symbols if kind in "BDC"]  # nothing that could be written to


@pytest.mark.parametrize("target", ["x86_64", "aarch64", "armv7a-none-eabihf", "i386", "wasm32"])
@pytest.mark.first
def test_it_compiles_where_there_is_no_library(target: str, tmp_path: Path) -> None:
    needs("clang")
    write_sources(tmp_path)
    flags = (*STRICT, "-O2", "-ffreestanding", f"--target={target}")
    subprocess.run(["clang", *flags, "-c", "foretouch_wire.c", "-o", "wire.o"], cwd=tmp_path, check=True)


def test_the_header_is_c_plus_plus_too(tmp_path: Path) -> None:
    needs("g++")
    write_sources(tmp_path)
    (tmp_path / "uses.cpp").write_text('#include "foretouch_wire.h"\nforetouch_command command;\n')
    subprocess.run(
        ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-c", "uses.cpp"], cwd=tmp_path, check=True
    )


def test_every_message_between_the_sides_is_there() -> None:
    assert {"command", "model_update", "telemetry", "leader_state", "field_update", "fixture_belief", "stop",
            "emergency_stop", "hello"} <= {snake(kind) for kind in KINDS}  # fmt: skip
    assert all(field.about for kind in KINDS for field in fields_of(kind))
    assert issubclass(KINDS[0], Message)
