"""The page of the wire format is current, and its vectors, its decoder and its program in C do what it says."""

from __future__ import annotations

import importlib
import json
import math
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import numpy as np
import pytest
from wire_c import COMPILERS, NO_MESSAGE, OK, OTHER_VERSION, SANITIZED, STRICT, Case, build, in_c, said, write_sources

from foretouch.errors import DecodeError, PeerVersionError
from foretouch.export.wire import WireField, fields_of, kinds
from foretouch.link import ZenohLink, free_endpoint
from foretouch.messages import CHANNELS, Command, Message, decode, encode
from foretouch.models.contact_map.layout import Map
from foretouch.models.contact_map.wire import shrunk, unpack

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "wire.md").read_text()
VECTORS = json.loads((DOCS / "wire-vectors.json").read_text())
KINDS = {channel.kind.__name__: channel.kind for channel in CHANNELS.values()}
NUMBERS = {"NaN": math.nan, "infinity": math.inf, "-infinity": -math.inf}


@pytest.fixture(scope="module")
def script() -> Iterator[ModuleType]:
    sys.path.insert(0, str(DOCS))
    try:
        yield importlib.import_module("write_wire")
    finally:
        sys.path.remove(str(DOCS))


def test_the_page_and_the_vectors_are_current(script: ModuleType) -> None:
    again = "run .venv/bin/python docs/write_wire.py"
    assert script.filled(PAGE) == PAGE, again
    assert script.everything() == (DOCS / "wire-vectors.json").read_text(), again
    assert {found["name"] for found in script.BLOCK.finditer(PAGE)} == set(script.blocks())


def value_of(field: WireField, value: Any) -> Any:
    """A value as the vectors write it."""
    if field.record is not None:
        return None if value is None else made(field.record, value)
    if field.kind == "list of numbers":
        return tuple(NUMBERS.get(str(one), one) for one in value)
    if field.kind == "number":
        return float(NUMBERS.get(str(value), value))
    converted: dict[str, Callable[[Any], Any]] = {
        "version": int, "count": int, "flag": bool, "text": str, "bytes": bytes.fromhex, "list of texts": tuple
    }  # fmt: skip
    return converted[field.kind](value)


def made(kind: type[msgspec.Struct], fields: dict[str, Any]) -> Any:
    """The message of these fields, all of which have to be named."""
    assert tuple(fields) == kind.__struct_fields__
    return kind(*(value_of(field, fields[field.name]) for field in fields_of(kind)))


def read_cases() -> list[tuple[Case, Message, bytes]]:
    """Bytes of each vector that is read, its message, and the bytes that are written for it."""
    found = []
    for one in VECTORS["read"]:
        kind, data = KINDS[one["message"]], bytes.fromhex(one["bytes"])
        found.append(((kind, data), made(kind, one["fields"]), bytes.fromhex(one.get("written", one["bytes"]))))
    return found


def test_python_reads_and_writes_what_the_vectors_say() -> None:
    assert len(VECTORS["read"]) > 3 * len(KINDS)
    for (kind, data), message, written in read_cases():
        assert encode(message) == written
        assert encode(msgspec.msgpack.decode(data, type=kind)) == written
        decode(data, kind)
    for one in VECTORS["refused"]:
        error = {"no message": DecodeError, "other version": PeerVersionError}[one["status"]]
        with pytest.raises(error):
            decode(bytes.fromhex(one["bytes"]), KINDS[one["message"]])


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.first
def test_c_reads_and_writes_what_the_vectors_say(compiler: str, tmp_path: Path) -> None:
    program = build(compiler, tmp_path)
    vectors = [one for one in read_cases() if one[0][0] in kinds()]
    for (_, message, written), answer in zip(vectors, in_c(program, [one[0] for one in vectors]), strict=True):
        assert answer == (OK, written, said(message))
    refused = [(KINDS[one["message"]], bytes.fromhex(one["bytes"])) for one in VECTORS["refused"]]
    said_of_each = {"no message": NO_MESSAGE, "other version": OTHER_VERSION}
    expected = [said_of_each[one["status"]] for one in VECTORS["refused"]]
    assert [answer.status for answer in in_c(program, refused)] == expected


@pytest.mark.network
def test_a_program_that_knows_the_page_alone_is_heard() -> None:
    zenoh = pytest.importorskip("zenoh")
    config, endpoint = zenoh.Config(), free_endpoint()
    settings = re.findall(r"^\| (`[a-z/_, `]+`) \| `(\w+)` \|$", PAGE, re.MULTILINE)
    assert len(settings) == 5
    for names, value in settings:
        for name in re.findall(r"`([a-z/_]+)`", names):
            config.insert_json5(name, value if value in ("true", "false") else json.dumps(value))
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    (_, data), message, _ = next(one for one in read_cases() if one[0][0] is Command)
    with ZenohLink(listen=[endpoint], subscribe=["command"]) as link, zenoh.open(config) as session:
        publisher = session.declare_publisher("foretouch/command", congestion_control=zenoh.CongestionControl.DROP)
        arrived: list[Any] = []
        end = time.monotonic() + 10.0
        while not arrived and time.monotonic() < end:
            publisher.put(data)
            time.sleep(0.05)
            arrived = link.take("command")
        assert arrived[0][1] == message
        assert link.undecodable == 0


def block(language: str) -> str:
    """The one fenced block of a language."""
    (text,) = re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    return str(text)


@pytest.fixture(scope="module")
def decode_map() -> Callable[[bytes], list[float]]:
    names: dict[str, Any] = {}
    exec(block("python"), names)
    decoder: Callable[[bytes], list[float]] = names["decode_map"]
    return decoder


def test_the_decoder_of_the_page_reads_the_maps_of_the_vectors(decode_map: Callable[[bytes], list[float]]) -> None:
    for one in VECTORS["contact_maps"]:
        numbers = decode_map(bytes.fromhex(one["bytes"]))
        assert {str(index): number for index, number in enumerate(numbers) if number != 0.0} == one["numbers"]


def test_the_decoder_of_the_page_reads_every_map(decode_map: Callable[[bytes], list[float]]) -> None:
    random = np.random.default_rng(5)
    for _ in range(300):
        maps = Map.new()
        learnt, (low, high) = maps[0], np.sort(random.uniform(-0.015, 0.06, 2))
        maps.view(np.float64)[24:] = random.normal(size=maps.view(np.float64).size - 24)
        learnt.lowest, learnt.reached, learnt.place = low, high, random.uniform(-0.01, 0.05)
        learnt.shares[:] = (0.25, 0.5, 0.25) if random.random() < 0.7 else (0.5, 0.5, 0.0)
        content, _, good = shrunk(maps)
        there = unpack(content)
        assert good
        assert there is not None
        assert decode_map(content) == there.view(np.float64).tolist()


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.first
def test_the_program_of_the_page_compiles_and_runs(compiler: str, tmp_path: Path) -> None:
    write_sources(tmp_path)
    model = encode(made(KINDS["ModelUpdate"], VECTORS["read"][3]["fields"]))
    arrived = ", ".join(map(str, model))
    text = (
        f'#include "foretouch_wire.h"\nint main(void)\n{{\nstatic const uint8_t arrived[] = {{{arrived}}};\n'
        f"const size_t arrived_size = sizeof arrived;\n{block('c').replace('    size_t count', '    count')}"
        "return size == 0 || count != 3;\n}\n"
    )
    (tmp_path / "page.c").write_text(
        text.replace("foretouch_model_update model;", "size_t count = 0;\nforetouch_model_update model;")
    )
    files = ["page.c", "foretouch_wire.c", "-o", "page"]
    subprocess.run([compiler, *STRICT, *SANITIZED, *files], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "page"], check=True)
