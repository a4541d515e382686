"""Reads STL as text, line by line: trimesh passes over what it cannot read, and a hole in a surface is felt."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError

__all__ = ["is_text_stl", "read_text_stl"]

FACET: Final = ("facet normal", "outer loop", "vertex", "vertex", "vertex", "endloop", "endfacet")
"""Lines of a triangle, by what they begin with; a normal and each vertex have three numbers behind it."""

_head = struct.Struct("<80sI")  # of a binary file: whatever one likes, and how many triangles of 50 bytes follow


def is_text_stl(file: Path) -> bool:
    """Whether an STL is text: it begins with ``solid``, and is not as long as its binary head says."""
    if file.suffix.lower() != ".stl":
        return False
    with file.open("rb") as opened:
        head = opened.read(_head.size)
    if len(head) == _head.size and file.stat().st_size == _head.size + 50 * _head.unpack(head)[1]:
        return False
    return head.lstrip().lower().startswith(b"solid")


def read_text_stl(file: Path) -> NDArray[np.float64]:
    """The corners, three a triangle, shape (3 n, 3).

    Raises:
        InputError: A line that is out of place, or whose numbers are none; the message names it.
    """
    corners: list[float] = []
    place = 0
    with file.open(encoding="ascii", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            words = line.split()
            if not words or (place == 0 and words[0].lower() in ("solid", "endsolid")):
                continue
            wanted = FACET[place]
            length = len(wanted.split())
            values = _numbers(words[length:])
            right = " ".join(words[:length]).lower() == wanted
            if not right or len(values) != (3 if wanted in ("vertex", "facet normal") else 0) or None in values:
                shown = " ".join(words)[:60]
                rule = f"this line of an STL is to be {wanted!r}" + " and three numbers" * (place in (0, 2, 3, 4))
                raise InputError(f"{file}, row {number}: {shown!r}: {rule}: export it again")
            if wanted == "vertex":
                corners += values  # type: ignore[arg-type]
            place = (place + 1) % len(FACET)
    if place:
        raise InputError(f"{file}: it ends within a triangle: it is cut off")
    return np.array(corners).reshape(-1, 3)


def _numbers(words: list[str]) -> list[float | None]:
    """What the words say; None for what is no number."""
    values: list[float | None] = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            values.append(None)
    return values
