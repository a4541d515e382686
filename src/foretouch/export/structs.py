"""Records in C: a struct of each, with the comments of its fields, and what a new one holds."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from foretouch.core.records import Record

PREFIX = "foretouch_"
WIDTH = 120  # Longest line of the header
TYPES = {"f8": "double", "f4": "float", "i8": "int64_t", "i4": "int32_t", "u1": "uint8_t", "i1": "int8_t", "b1": "bool"}
"""C's types by NumPy's."""

_FIELD = re.compile(r"^    (\w+): .*?(?:#(?! type:) *(.*))?$", re.MULTILINE)
_MODULES = re.compile(r"^(?:[a-z_]+\.)+")  # before the name of a class or a function in them
_SECTION = re.compile(r"(Args|Returns|Raises):\n")
_ARGUMENT = re.compile(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Struct:
    """A record as it is in C.

    Attributes:
        kind: The record.
        name: In C, without `PREFIX`.
        described: A class whose docstring describes the fields as its arguments, where the record's lines do not.
    """

    kind: type[Record]
    name: str
    described: type | None = None


def records_in(kind: type[Record]) -> Iterator[type[Record]]:
    """The records that one is made of, each after those that it is made of itself, and last that one."""
    seen: dict[type[Record], None] = {}
    for field in _fields(kind).values():
        if issubclass(field.base.type, Record):
            seen |= dict.fromkeys(records_in(field.base.type))
    yield from seen | {kind: None}


def snake(kind: type) -> str:
    """Name of a class as C writes it: ``ModelUpdate`` is ``model_update``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", kind.__name__).lower()


def _fields(kind: type[Record]) -> dict[str, np.dtype[Any]]:
    layout = kind.layout
    return {name: layout[name] for name in layout.names or ()}


def comments(kind: type[Record]) -> dict[str, str]:
    """What the lines of a record's class say of its fields."""
    return {name: said or "" for name, said in _FIELD.findall(inspect.getsource(kind))}


def arguments(described: type) -> dict[str, str]:
    """What a class's docstring says of its arguments."""
    said = inspect.getdoc(described) or ""
    return {name: " ".join(text.split()).rstrip(".") for name, text in _ARGUMENT.findall(said.partition("Args:")[2])}


def comment(text: str, indent: str = "") -> str:
    """A comment of C, as wide as the header; what a docstring lists stays a list."""
    plain = re.sub(r"``?([^`]*)``?", lambda name: _called(_MODULES.sub("", name[1])), text).replace("*/", "* /")
    lines: list[str] = []
    for paragraph in plain.split("\n\n"):
        listed = _SECTION.match(paragraph)
        items = [" ".join(item.split()) for item in re.split(r"\n    (?! )", paragraph)] if listed else [paragraph]
        wrapped = [line for item in items for line in _wrapped(item, indent, "  " if item != items[0] else "")]
        lines += ["", *wrapped] if lines else wrapped
    inner = "\n".join(f"{indent}   {line}" if line else "" for line in lines).lstrip()
    return f"{indent}/* {inner} */"


def _wrapped(text: str, indent: str, before: str) -> list[str]:
    width = WIDTH - len(indent) - 6
    return textwrap.wrap(" ".join(text.split()), width, initial_indent=before, subsequent_indent=2 * before)


TAKEN = re.compile(
    "asm|auto|catch|class|const|delete|do|double|export|extern|float|friend|goto|inline|int|long|mutable|namespace|new|"
    "operator|private|protected|public|register|restrict|short|signed|sizeof|static|struct|switch|template|this|throw|"
    "typedef|typename|union|unsigned|using|virtual|void|volatile"
)
"""Words of C and C++ that a field in Python may be called."""


def in_c(name: str) -> str:
    """A field's or parameter's name in C."""
    return f"{name}_" if TAKEN.fullmatch(name) else name


CALLED = {"Memory": "safety", "Status": "follower_status", "Leader": "leader", "Following": "follower"}
"""What classes are called in C that descriptions name."""


def _called(name: str) -> str:
    owner, dot, rest = name.partition(".")
    return (PREFIX + CALLED[owner] if owner in CALLED else owner) + dot + rest


def sentence(kind: type) -> str:
    """The first paragraph of a docstring."""
    return (inspect.getdoc(kind) or "").partition("\n\n")[0]


def declared(struct: Struct, names: dict[type[Record], str]) -> str:
    """The struct in C.

    Args:
        struct: Of a record.
        names: What the records in it are called.
    """
    own = PREFIX + struct.name
    said = comments(struct.kind) | (arguments(struct.described) if struct.described else {})
    lines = [comment(sentence(struct.kind)), f"typedef struct {own} {{"]
    for name, field in _fields(struct.kind).items():
        base = field.base.type
        kind = PREFIX + names[base] if issubclass(base, Record) else TYPES[field.base.str[1:]]
        sizes = "".join(f"[{size}]" for size in field.shape)
        lines += [_member(f"    {kind} {in_c(name)}{sizes};", said.get(name, ""))]
    return "\n".join([*lines, f"}} {own};"])


def checked(struct: Struct) -> str:
    """Assertions of C that the struct is placed as the record is."""
    layout, own = struct.kind.layout, PREFIX + struct.name
    sizes = [f"FORETOUCH_CHECK(sizeof({own}) == {layout.itemsize});"]
    fields: dict[str, Any] = dict(layout.fields or {})
    return "\n".join(
        [*sizes, *(f"FORETOUCH_CHECK(offsetof({own}, {in_c(name)}) == {fields[name][1]});" for name in fields)]
    )


def _member(line: str, said: str) -> str:
    """A field with its comment: behind it where there is room, and above it where not."""
    if not said:
        return line
    behind = f"{line} {comment(said)}"
    return behind if "\n" not in behind and len(behind) <= WIDTH else f"{comment(said, '    ')}\n{line}"
