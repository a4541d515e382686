"""What goes with every message: its number, when it was sent, and by whom."""

from __future__ import annotations

import struct

__all__ = ["attachment"]

_LAYOUT = struct.Struct("<qqB16s")


def attachment(number: int, sent_ns: int, gid: bytes) -> bytes:
    """The 33 bytes of an attachment, as Zenoh's serialiser makes them of two integers and an array.

    Little endian: the number (int64), the time (int64), the length of what follows (16, one byte), the identifier; see
    "Publishers" in ``docs/design.md`` of `rmw_zenoh_cpp`. So it is since its 0.2.4 (Jazzy) and 0.6.0 (Kilted, Rolling);
    before, names stood between the numbers. A message without an attachment is dropped there.

    Args:
        number: Of the message at its publisher, from 1.
        sent_ns: Nanoseconds since 1970 when it was sent.
        gid: Identifier of the publisher, 16 bytes.
    """
    return _LAYOUT.pack(number, sent_ns, len(gid), gid)
