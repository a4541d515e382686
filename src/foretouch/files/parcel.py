"""Python values on their way between two processes of ours, arrays beside them: mapped there, not copied."""

from __future__ import annotations

import mmap
import os
import pickle
import struct
from typing import Any, Final

_end = struct.Struct("<Q")
ALIGNED: Final = 64
"""Arrays begin at multiples of this [bytes], as NumPy's own do."""


def write_parcel(descriptor: int, value: object) -> None:
    """Write a value to an empty file: arrays first, then what refers to them."""
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    with os.fdopen(os.dup(descriptor), "wb") as file:
        spans = []
        for buffer in buffers:
            with buffer.raw() as raw:
                file.write(bytes(-file.tell() % ALIGNED))
                spans.append((file.tell(), raw.nbytes, raw.readonly))
                file.write(raw)
        tail = pickle.dumps((spans, body), protocol=5)
        file.write(tail + _end.pack(len(tail)))


def open_parcel(descriptor: int) -> Any:
    """The value in a file that `write_parcel` wrote in a process of ours; its arrays are views of that file."""
    content = memoryview(mmap.mmap(descriptor, 0, access=mmap.ACCESS_COPY))
    (length,) = _end.unpack(content[-_end.size :])
    spans, body = pickle.loads(content[-_end.size - length : -_end.size])
    parts = []
    for start, size, fixed in spans:
        part = content[start : start + size]
        parts.append(part.toreadonly() if fixed else part)
    return pickle.loads(body, buffers=parts)
